from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import Canceled
from pipeline.estimate import Estimate
from pipeline.light.model import Model, build_model
from pipeline.options import Options
from pipeline.output_names import OUTPUT_NAMES
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import reduce_pair
from pipeline.photometric_stereo.facing import Facing
from pipeline.pictures.clipped import shown_layers
from pipeline.pictures.shown import shown_gain
from pipeline.pictures.white_balance import whites_of
from pipeline.progress import Progress
from pipeline.results.pictures import Pictures, overview, render
from pipeline.spectra.cameras import Camera, srgb_stand_in
from pipeline.spectra.lights import find_light
from tests.surfaces import wall

NAMES = ("white_balanced_1", "white_balanced_2", "normals", "normals_confidence", "response")


@pytest.fixture(scope="module")
def model_with_response(camera: Camera) -> Model:
    return build_model(camera, find_light("xenon"), find_light("D65"), "wpca", srgb_stand_in())


@pytest.fixture
def seen_whole(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    model_with_response: Model,
) -> Callable[..., Pictures]:
    """Make the overview of the pair that `rendered` renders."""

    def run(
        *wanted: str, method: Literal["best", "paper"] = "best", pair: Pair | None = None
    ) -> Pictures:
        pair = pair or exact(warm_to_cool)[0]
        lamps, changes = lamps_of(warm_to_cool), np.stack([np.eye(3)] * 3)
        reduced = reduce_pair(pair)
        names = frozenset(wanted)
        estimate = Estimate(reduced, model_with_response, lamps, None, changes)
        return overview(pair, estimate, method, names)

    return run


@pytest.fixture
def facing() -> Facing:
    """A surface of the picture's size that faces the camera, known in its upper half."""
    return wall(np.arange(64)[:, None] < np.full((64, 96), 32), 1.5, 3)


@pytest.fixture
def rendered(
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    model_with_response: Model,
    facing: Facing,
) -> Callable[..., Pictures]:
    """Render the pictures that a set of outputs needs, put together from strips of so many rows."""

    def run(*wanted: str, **more: Any) -> Pictures:
        pair = more.get("pair") or exact(warm_to_cool)[0]
        rows = more.get("strip_rows", 256)
        estimate = Estimate(
            reduce_pair(pair),
            model_with_response,
            lamps_of(warm_to_cool),
            more.get("facing", facing),
            more.get("changes", np.stack([np.eye(3)] * 3)),
        )
        strips = list(
            render(
                pair,
                estimate,
                Options(method=more.get("method", "best")),
                frozenset(wanted),
                more.get("progress", Progress()),
                rows,
            )
        )
        assert [strip.rows.start for strip in strips] == list(range(0, 64, rows))
        joined: Any = {
            name: None
            if getattr(strips[0], name) is None
            else np.concatenate([getattr(strip, name) for strip in strips])
            for name in (*NAMES, "confidence")
        }
        layers, shown = (
            np.concatenate([getattr(strip, name) for strip in strips], axis=1)
            for name in ("layers", "shown_layers")
        )
        return Pictures(rows=slice(0, 64), layers=layers, shown_layers=shown, **joined)

    return run


@pytest.mark.parametrize(
    ("wanted", "made"),
    [
        ((), set()),
        (("confidence.tif", "residual.png"), set()),
        (("layers.exr", "lamps.tif", "gamma.png"), set()),
        (("white_balanced_1.jpg",), {"white_balanced_1"}),
        (("white_balanced_1.tif",), {"white_balanced_1"}),
        (("white_balanced_2.tif",), {"white_balanced_2"}),
        (("white_balanced.exr",), {"white_balanced_1", "white_balanced_2"}),
        (("white_balanced_2.jpg",), {"white_balanced_2"}),
        (("normals.png",), {"normals"}),
        (("normals.exr",), {"normals"}),
        (("depth.exr",), set()),
        (("normals_confidence.tif",), {"normals", "normals_confidence"}),
        (("surface.glb",), {"white_balanced_1", "normals"}),
        (("response.jpg",), {"response"}),
        (("response_lamps.jpg",), {"response"}),
        (("response.exr",), {"response"}),
        (OUTPUT_NAMES, set(NAMES)),
    ],
)
def test_only_pictures_that_are_wanted_are_made(
    rendered: Callable[..., Pictures], wanted: tuple[str, ...], made: set[str]
) -> None:
    pictures = rendered(*wanted)

    assert {name for name in NAMES if getattr(pictures, name) is not None} == made
    assert pictures.layers.shape == (3, 64, 96, 3)


def test_without_directions_and_without_another_camera_there_is_neither_picture(
    rendered: Callable[..., Pictures],
) -> None:
    pictures = rendered(*OUTPUT_NAMES, changes=None, facing=None)

    assert pictures.normals is None
    assert pictures.normals_confidence is None
    assert pictures.response is None
    assert pictures.white_balanced_1 is not None


@pytest.mark.parametrize("method", ["best", "paper"])
@pytest.mark.parametrize("strip_rows", [1, 9, 64])
def test_strips_make_the_same_pictures(
    rendered: Callable[..., Pictures], method: str, strip_rows: int
) -> None:
    """Every pixel of every picture is written, and to the bit the same."""
    whole = rendered(*OUTPUT_NAMES, method=method)
    cut = rendered(*OUTPUT_NAMES, method=method, strip_rows=strip_rows)

    for name in ("layers", *NAMES, "confidence"):
        picture = getattr(cut, name)
        assert picture.dtype == np.float32
        assert name == "normals" or np.isfinite(picture).all()
        np.testing.assert_array_equal(picture, getattr(whole, name))


@pytest.mark.parametrize("method", ["best", "paper"])
def test_the_overview_is_as_bright_as_the_pictures(
    rendered: Callable[..., Pictures], seen_whole: Callable[..., Pictures], method: str
) -> None:
    small = seen_whole(*OUTPUT_NAMES, method=method)
    whole = rendered(*OUTPUT_NAMES, method=method)

    for name in ("white_balanced_1", "white_balanced_2", "response"):
        gains = [shown_gain(getattr(one, name), np.eye(3)) for one in (small, whole)]
        assert gains[0] == pytest.approx(gains[1], rel=0.03)


@pytest.mark.parametrize("whole", [False, True])
def test_floats_that_go_on_above_1_keep_the_colours_of_their_highlights(
    rendered: Callable[..., Pictures],
    seen_whole: Callable[..., Pictures],
    exact: Callable[..., tuple[Pair, Floats64]],
    warm_to_cool: Floats64,
    whole: bool,
) -> None:
    """Under the neutral light, where clipped ones become white."""
    make = rendered if whole else seen_whole
    pair, _ = exact(warm_to_cool, clipping=np.inf)
    light = 20 * pair.no_flash[:]
    bright = replace(pair, no_flash=light, photograph=light, flash=20 * pair.flash[:])

    found, plain = (make("white_balanced.exr", pair=one) for one in (bright, pair))

    for name in ("white_balanced_1", "white_balanced_2"):
        expected = 20 * getattr(plain, name)
        assert np.quantile(expected.max(axis=2), 0.5) > 1
        np.testing.assert_allclose(getattr(found, name), expected, atol=2e-3 * expected.max())


@pytest.mark.parametrize(
    ("wanted", "made"),
    [
        ((), set()),
        (("white_balanced_1.jpg", "normals.png"), {"white_balanced_1"}),
        (("surface.glb",), {"white_balanced_1"}),
        (("white_balanced_2.jpg",), {"white_balanced_2"}),
        (("response_lamps.jpg",), {"response"}),
    ],
)
def test_the_overview_has_what_is_shown(
    seen_whole: Callable[..., Pictures], wanted: tuple[str, ...], made: set[str]
) -> None:
    small = seen_whole(*wanted)

    assert {name for name in NAMES if getattr(small, name) is not None} == made


def test_cancel_stops_the_rendering(rendered: Callable[..., Pictures]) -> None:
    reports: list[float] = []
    progress = Progress(lambda _, part: reports.append(part), lambda: len(reports) == 2)

    with pytest.raises(Canceled):
        rendered(*OUTPUT_NAMES, progress=progress, strip_rows=16)

    assert reports == [0, 0.25]


def test_what_is_shown_of_layers_has_clipped_light_in_its_lamps_colour(
    rendered: Callable[..., Pictures],
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    model_with_response: Model,
) -> None:
    pair = replace(exact(warm_to_cool)[0], clipping=1.0)
    pair.no_flash[:8] = 1.0

    found = rendered("response.jpg", pair=pair)

    whites = whites_of(lamps_of(warm_to_cool), model_with_response)
    shown = shown_layers(found.layers, whites, 1.0)
    np.testing.assert_array_equal(found.shown_layers, shown)
    assert found.response is not None
    np.testing.assert_allclose(found.response, shown.sum(axis=0), rtol=1e-5, atol=1e-6)
    assert (found.response[2] > found.layers.sum(axis=0)[2]).any()
