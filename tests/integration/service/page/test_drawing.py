"""What the mixer draws, by the processor and by WebGL, in a real browser on a real service."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from pipeline.arrays import Floats32
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.encode.exr import ExrFile
from pipeline.encode.jpeg import to_srgb8
from pipeline.mixes.mix import mix_matrices
from pipeline.mixes.mix_options import LampMix, Mix, MixBasis
from tests.integration.service.page.looking import drawn, open_mixer, result, shown, strip
from tests.layers import layers_of, planes_of

UNTOLD = """() => {
  const ask = WebGL2RenderingContext.prototype.getExtension;
  WebGL2RenderingContext.prototype.getExtension = function (name) {
    return name === "WEBGL_debug_renderer_info" ? null : ask.call(this, name);
  };
}"""
"""Chromium keeps to itself that its WebGL is software."""
KIND = "(canvas) => canvas.getContext('2d') ? 'processor' : 'graphics'"


@pytest.fixture(params=["processor", "graphics"])
def painted(request: pytest.FixtureRequest, page: Page) -> Page:
    """A page that draws by the processor, and one that draws by WebGL."""
    if request.param == "graphics":
        page.add_init_script(f"({UNTOLD})()")
    return page


def layers_of_job(service: Any, job: dict[str, Any]) -> Floats32:
    """Light of both lamps: (lamps, height, width, 3)."""
    return layers_of(planes_of(result(service, job, "layers.exr")), 2)


def expected(
    service: Any, job: dict[str, Any], layers: Floats32, *lamps: LampMix
) -> NDArray[np.int64]:
    """Code values of a mix, by the pipeline."""
    manifest = json.loads(result(service, job, "manifest.json"))
    matrices = mix_matrices(MixBasis.model_validate(manifest["mix"]), Mix(lamps=list(lamps)))
    linear = sum(
        layer @ np.asarray(matrix).T for layer, matrix in zip(layers, matrices, strict=True)
    )
    return to_srgb8(np.asarray(linear, np.float32)).astype(int)


def test_both_ways_of_drawing_show_the_mix_of_the_files(
    painted: Page, request: pytest.FixtureRequest, done: dict[str, Any], service: Any
) -> None:
    canvas = open_mixer(painted, done)
    assert canvas.evaluate(KIND) == request.node.callspec.params["painted"]
    layers = layers_of_job(service, done)
    size = layers.shape[2], layers.shape[1]
    untouched = expected(service, done, layers, LampMix(), LampMix())
    assert np.abs(shown(painted, size) - untouched).max() <= 2

    strip(painted, 1).get_by_role("slider", name="Exposure").fill("-1.5")
    strip(painted, 1).get_by_label("Neutral").check(force=True)
    strip(painted, 2).get_by_role("slider", name="Exposure").fill("1")
    mixed = expected(service, done, layers, LampMix(ev=-1.5, neutral=True), LampMix(ev=1))
    assert np.abs(shown(painted, size) - mixed).max() <= 2

    painted.get_by_label("Before").fill("50")
    halves = shown(painted, size)
    middle = size[0] // 2
    left, right = slice(0, middle - 2), slice(middle + 2, None)
    assert np.abs(halves[:, left] - untouched[:, left]).max() <= 2
    assert np.abs(halves[:, right] - mixed[:, right]).max() <= 2


def test_both_ways_show_light_of_no_luminance_as_the_files_do(
    painted: Page, done: dict[str, Any], service: Any
) -> None:
    """As if the camera's matrix took all light to a deep blue, which has negative luminance."""
    deep_blue = np.array([[0.1, 0.0, -0.1], [-0.2, 0.05, -0.3], [0.0, 0.0, 2.0]])
    manifest = json.loads(result(service, done, "manifest.json"))
    manifest["mix"]["to_xyz"] = (np.linalg.inv(XYZ_TO_SRGB) @ deep_blue).tolist()
    painted.route("**/results", lambda route: route.fulfill(json=manifest))
    open_mixer(painted, done)
    linear = (layers_of_job(service, done).sum(axis=0) @ deep_blue.T).astype(np.float32)
    luminance = linear @ np.linalg.inv(XYZ_TO_SRGB)[1]
    assert (luminance < 0).mean() > 0.5

    found = shown(painted, (linear.shape[1], linear.shape[0]))

    assert np.abs(found - to_srgb8(linear).astype(int)).max() <= 2
    assert np.median(found[..., 2]) > 30


def test_of_rounded_light_both_ways_show_the_codes_of_the_files(
    painted: Page, done: dict[str, Any], service: Any
) -> None:
    """Bright mixes show the 16-bit floats of the preview: given these, the files are the same."""
    open_mixer(painted, done)
    rounded = layers_of_job(service, done).astype(np.float16).astype(np.float32)
    for lamp in (1, 2):
        strip(painted, lamp).get_by_role("slider", name="Exposure").fill("2")
    bright = expected(service, done, rounded, LampMix(ev=2), LampMix(ev=2))
    assert np.abs(shown(painted, (rounded.shape[2], rounded.shape[1])) - bright).max() <= 1


def test_enlarged_the_pixels_are_those_of_the_photograph(
    painted: Page, done: dict[str, Any], service: Any, tmp_path: Path
) -> None:
    """The preview is given half as large as the photograph, as that of a larger one is."""
    layers = layers_of_job(service, done)
    halved = layers.reshape(2, layers.shape[1] // 2, 2, layers.shape[2] // 2, 2, 3).mean((2, 4))
    file = ExrFile(tmp_path / "preview.exr", (halved.shape[2], halved.shape[1]), half=True)
    sure = np.ones(halved.shape[1:3], np.float32)
    file.write({"lamp1": halved[0], "lamp2": halved[1], "Y": sure})
    file.close()
    painted.route("**/preview.exr", lambda route: route.fulfill(path=tmp_path / "preview.exr"))
    asked: list[str] = []
    painted.on("request", lambda one: asked.append(one.url) if "/area?" in one.url else None)
    open_mixer(painted, done)
    strip(painted, 2).get_by_role("slider", name="Exposure").fill("-1")
    size = layers.shape[2], layers.shape[1]
    found = shown(painted, size)
    assert [url.partition("?")[2] for url in asked] == ["left=0&top=0&width=300&height=200"]
    wanted = expected(service, done, layers, LampMix(), LampMix(ev=-1))
    assert np.abs(found - wanted).max() <= 2


def test_without_webgl_there_is_a_mixer(page: Page, done: dict[str, Any]) -> None:
    page.add_init_script(
        """const context = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
          return kind === "webgl2" ? null : context.call(this, kind, ...more);
        };"""
    )
    canvas = open_mixer(page, done)
    before = canvas.screenshot()
    strip(page, 1).get_by_role("slider", name="Exposure").fill("-3")
    drawn(page)
    assert canvas.screenshot() != before
    expect(page.get_by_role("alert")).to_have_count(0)


def test_a_picture_too_long_for_the_card_is_drawn_by_the_processor(
    page: Page, done: dict[str, Any]
) -> None:
    """Which would draw nothing of it, and say nothing: a preview may be of any length."""
    page.add_init_script(f"({UNTOLD})()")
    page.add_init_script(
        """const ask = WebGL2RenderingContext.prototype.getParameter;
        WebGL2RenderingContext.prototype.getParameter = function (name) {
          return name === this.MAX_TEXTURE_SIZE ? 299 : ask.call(this, name);
        };"""
    )
    assert open_mixer(page, done).evaluate(KIND) == "processor"
