"""Pairs that moved, flickered or were exposed otherwise than the files say, by command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image as PillowImage
from PIL.TiffImagePlugin import IFDRational

FLAGS = ("--camera", "Nikon D5100", "--lights", 2, "--outputs", "layers.exr")
STEADY = (*FLAGS, "--no-align")
"""Where nothing is to be laid on anything."""


def write_pair(folder: Path, no_flash: Any, flash: Any) -> tuple[Path, Path]:
    """Float TIFFs with the noise of a sensor: 20,000 electrons at white, 5 from reading."""
    rng = np.random.default_rng(7)
    paths = folder / "one.tif", folder / "two.tif"
    for path, light in zip(paths, (no_flash, flash), strict=True):
        deviation = np.sqrt(np.maximum(light, 0) / 2e4 + (5 / 2e4) ** 2)
        noisy = (light + rng.normal(size=light.shape) * deviation).astype(np.float32)
        tifffile.imwrite(path, noisy, photometric="rgb", metadata=None)
    return paths


def write_jpeg(path: Path, light: Any, time_s: float) -> Path:
    """A JPEG whose EXIF tells of f/8, ISO 100 and that time."""
    code = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.abs(light) ** (1 / 2.4) - 0.055)
    picture = PillowImage.fromarray(np.rint(255 * np.clip(code, 0, 1)).astype(np.uint8))
    exif = PillowImage.Exif()
    facts = {0x829A: IFDRational(time_s), 0x829D: IFDRational(8), 0x8827: 100}
    exif.get_ifd(0x8769).update(facts)
    picture.save(path, "JPEG", quality=98, subsampling=0, exif=exif)
    return path


@pytest.fixture(scope="module")
def truth(scene: Callable[..., Any]) -> Any:
    """Of a small scene, on which runs are short."""
    return scene(2, size=(180, 120)).truth


@pytest.fixture(scope="module")
def light(truth: Any) -> tuple[Any, Any]:
    """What the lamps and what the flash gives."""
    return truth.layers.sum(0), truth.flash


@pytest.fixture(scope="module")
def short_reach(light: tuple[Any, Any]) -> Any:
    return reaching_no_further(light[1])


def reaching_no_further(part: Any) -> Any:
    """Light of a flash that the back of the room gets next to nothing of."""
    part = part.copy()
    part[: len(part) // 3] *= 0.01
    return part


def warnings_of(results: Any) -> list[str]:
    return [warning["message"] for warning in results.manifest["warnings"]]


def test_a_still_pair_is_not_warned_of(
    scene: Callable[..., Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    truth = scene(2).truth
    lamps = truth.layers.sum(0)
    pair = write_pair(tmp_path, lamps, lamps + truth.flash)

    results = separated(pair, *FLAGS, "--exposure-ratio", 1)

    assert warnings_of(results) == []
    assert results.manifest["moved"] == 0
    assert results.manifest["alignment"]["applied"] is False
    assert results.manifest["alignment"]["parallax"] == 0
    assert results.manifest["exposure_source"] == "option"


def test_a_shaken_photograph_is_told_and_its_layers_are_nearly_as_good(
    truth: Any, light: tuple[Any, Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """The hand shook by four pixels while the room's light was gathered."""
    lamps, part = light
    line = np.zeros((7, 7))
    cv2.line(line, (1, 2), (5, 4), 1.0, 1, cv2.LINE_AA)
    layers = np.stack([cv2.filter2D(one, -1, line / line.sum()) for one in truth.layers])
    (tmp_path / "still").mkdir()
    pairs = (
        write_pair(tmp_path / "still", lamps, lamps + part),
        write_pair(tmp_path, layers.sum(0), lamps + part),
    )

    still, results = (separated(pair, *STEADY, "--exposure-ratio", 1) for pair in pairs)

    (warning,) = warnings_of(results)
    assert "without the flash is less sharp than the other" in warning
    assert "Use a tripod" in warning
    shaken, at_rest = results.layer_snr_db(replace(truth, layers=layers)), still.layer_snr_db(truth)
    assert min(shaken) > min(at_rest) - 3 > 15


def test_something_that_moved_is_masked_and_warned_of(
    light: tuple[Any, Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """A red ball that rolled to the right: filled in from its surroundings in both places."""
    lamps, part = light
    height, width = lamps.shape[:2]
    photographs = []
    for x, here in ((0.45, lamps), (0.6, lamps + part)):
        ball = np.zeros((height, width))
        cv2.circle(ball, (int(x * width), int(0.3 * height)), height // 8, 1.0, -1, cv2.LINE_AA)
        colour = here.mean((0, 1)) * np.array([1.2, 0.25, 0.2])
        photographs.append(here * (1 - ball[..., None]) + colour * ball[..., None])
    pair = write_pair(tmp_path, *photographs)

    results = separated(pair, *FLAGS, "--exposure-ratio", 1)

    (warning,) = warnings_of(results)
    assert warning.startswith("Something moved between the photographs in ")
    assert "Keep people and things still" in warning
    two_balls = 2 * np.pi * (height // 8) ** 2 / (height * width)
    assert results.manifest["moved"] == pytest.approx(two_balls, rel=0.35)
    assert results.manifest["filled"] >= 0.9 * results.manifest["moved"]


@pytest.mark.parametrize("ratio", [0.5, 2.0])
def test_an_exposure_ratio_that_nobody_wrote_is_found(
    light: tuple[Any, Any],
    short_reach: Any,
    separated: Callable[..., Any],
    tmp_path: Path,
    ratio: float,
) -> None:
    lamps, _ = light
    pair = write_pair(tmp_path, lamps, ratio * (lamps + short_reach))

    results = separated(pair, *STEADY)

    assert results.manifest["exposure_ratio"] == pytest.approx(ratio, rel=0.03)
    assert results.manifest["exposure_source"] == "pixels"
    assert any("was taken" in w for w in warnings_of(results))


@pytest.mark.parametrize("ratio", [0.4, 3.0])
def test_where_the_flash_reaches_everything_colours_tell_the_exposure_ratio(
    light: tuple[Any, Any],
    truth: Any,
    separated: Callable[..., Any],
    tmp_path: Path,
    ratio: float,
) -> None:
    lamps, part = light
    pair = write_pair(tmp_path, lamps, ratio * (lamps + part))

    found, told = (separated(pair, *STEADY, *flags) for flags in ([], ["--exposure-ratio", ratio]))

    assert found.manifest["exposure_ratio"] == pytest.approx(ratio, rel=0.03)
    assert found.manifest["exposure_source"] == "pixels"
    assert any("the flash's light has one colour on one surface" in w for w in warnings_of(found))
    assert min(found.layer_snr_db(truth)) > min(told.layer_snr_db(truth)) - 1
    assert not any("exposure" in w for w in warnings_of(told))


def test_equal_exposures_that_colours_confirm_are_not_warned_of(
    light: tuple[Any, Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    lamps, part = light

    results = separated(write_pair(tmp_path, lamps, lamps + part), *STEADY)

    assert results.manifest["exposure_ratio"] == 1
    assert not any("exposure" in w for w in warnings_of(results))


def test_a_wrong_exposure_ratio_given_is_noticed(
    light: tuple[Any, Any], short_reach: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    lamps, _ = light
    pair = write_pair(tmp_path, lamps, lamps + short_reach)

    wrong = separated(pair, *STEADY, "--exposure-ratio", 1.5)

    assert wrong.manifest["exposure_ratio"] == 1.5
    assert any(
        w.startswith("The exposure ratio given, 1.5, does not fit") for w in warnings_of(wrong)
    )


def test_shadows_of_the_flash_tell_of_a_wrong_exposure_ratio(
    light: tuple[Any, Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """Places that a wrong ratio darkens are told of as that, and not as things that moved.

    A fifth of the flash light comes into its shadows from around, so that no place is without it.
    """
    lamps, part = light
    height, width = lamps.shape[:2]
    pools = np.zeros((height, width))
    for x in (0.25, 0.6):
        cv2.circle(pools, (int(x * width), height // 2), height // 10, 1.0, -1)
    pools = cv2.GaussianBlur(pools, (0, 0), height / 60)[..., None]
    pair = write_pair(tmp_path, lamps, lamps + part * (1 - 0.8 * pools))

    wrong = separated(pair, *STEADY, "--exposure-ratio", 1.5)
    right = separated(pair, *STEADY, "--exposure-ratio", 1)

    assert any(
        w.startswith("The exposure ratio given, 1.5, does not fit") for w in warnings_of(wrong)
    )
    assert not any("moved" in w for w in warnings_of(wrong))
    assert wrong.manifest["moved"] == 0
    assert not any("exposure ratio" in w or "moved" in w for w in warnings_of(right))


def test_a_wrong_exposure_in_the_files_is_noticed(
    scene: Callable[..., Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    truth = scene(2).truth
    lamps = truth.layers.sum(0)
    flash = lamps + reaching_no_further(truth.flash)
    paths = [
        write_jpeg(tmp_path / f"{name}.jpg", values, time_s)
        for name, values, time_s in (
            ("one", lamps, 1 / 60),
            ("two", flash, 1 / 40),
            ("right", flash, 1 / 60),
        )
    ]

    wrong = separated((paths[0], paths[1]), *STEADY)
    right = separated((paths[0], paths[2]), *STEADY)

    assert any(
        w.startswith("The files' exposure ratio, 1.5, does not fit") for w in warnings_of(wrong)
    )
    assert not any("exposure ratio" in w for w in warnings_of(right))


def test_flicker_is_noticed(
    light: tuple[Any, Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """Lamps on the mains, read out row by row: nine bands to the picture."""
    lamps, part = light
    y = np.arange(len(lamps))[:, None, None] / len(lamps)
    waves = [1 + 0.15 * np.sin(2 * np.pi * (9 * y + phase)) for phase in (0.1, 0.45)]
    pair = write_pair(tmp_path, lamps * waves[0], lamps * waves[1] + part)

    results = separated(pair, *STEADY, "--exposure-ratio", 1)

    assert any(
        w.startswith("Bands of ") and "multiple of 1/100 s" in w for w in warnings_of(results)
    )


def test_a_cloud_between_the_photographs_is_noticed(
    light: tuple[Any, Any], short_reach: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    lamps, _ = light
    pair = write_pair(tmp_path, lamps, 0.8 * lamps + short_reach)

    results = separated(pair, *STEADY, "--exposure-ratio", 1)

    assert any("steady light" in w for w in warnings_of(results))
    assert results.manifest["moved"] < 0.01


def test_a_thing_nearer_than_the_rest_is_followed(
    truth: Any, light: tuple[Any, Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """Four pixels of parallax in the lower half."""
    lamps, part = light
    height, width = lamps.shape[:2]
    near = np.clip((np.arange(height) / height - 0.5) / 0.05, 0, 1)[:, None] * np.ones((1, width))
    x = np.arange(width)[None, :] - 4.0 * near
    y = np.arange(height)[:, None] * np.ones((1, width))
    maps = (x.astype(np.float32), y.astype(np.float32))
    flash = lamps + part
    shifted = cv2.remap(flash, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    (tmp_path / "still").mkdir()
    still = write_pair(tmp_path / "still", lamps, flash)
    moved = write_pair(tmp_path, lamps, shifted)

    followed = separated(moved, *FLAGS, "--exposure-ratio", 1)
    left = separated(moved, *FLAGS, "--exposure-ratio", 1, "--no-align")
    without = separated(still, *FLAGS, "--exposure-ratio", 1)

    snr = [np.mean(results.layer_snr_db(truth)) for results in (followed, left, without)]
    assert followed.manifest["alignment"]["parallax"] > 0.05
    assert snr[0] > snr[1] + 2
    assert snr[0] > snr[2] - 5
