from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.errors import UnusablePairError
from pipeline.images.frames import Frame
from pipeline.lamps.whose_colours import (
    camera_doubts,
    camera_warnings,
    likely_camera,
    names_no_camera,
)
from pipeline.light.model import Model, build_model
from pipeline.matrixfit.fit import Fit, FitInput, first_fit
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import reduce_pair
from pipeline.run_warnings import Code
from pipeline.spectra.cameras import Camera, find_camera, srgb_stand_in, typical_sensor
from pipeline.spectra.colorimetry import camera_to_xyz
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.reduced_pairs import even, reduced_pair

HEIGHT, WIDTH, PATCH = 64, 96, 4
LAMPS = ("A", "D150", "FL2")
SENSOR, BALANCED = "typical sensor", "typical sensor, balanced for daylight"


@pytest.fixture(scope="module")
def other_sensor(camera: Camera) -> Floats64:
    """Sensitivities (3, W) of a camera that is none of the known ones: 8 nm off, red halved."""
    moved = [np.interp(WAVELENGTHS_NM - 8.0, WAVELENGTHS_NM, s) for s in camera.sensitivities]
    return np.asarray(np.array(moved) * np.array([[0.5], [1.0], [1.0]]))


def converted(s: Floats64, to: str) -> Floats64:
    """What a converter makes of the sensor's values, (3, 3)."""
    matrix: Floats64 = np.eye(3)
    if to == "balanced":
        matrix = np.diag(1 / (s @ find_light("D65")))
    if to == "sRGB":
        matrix = XYZ_TO_SRGB @ camera_to_xyz(s, find_light("D65"), reflectance_spectra())
    return matrix


def photographed(
    s: Floats64, to: str, lamps: tuple[str, ...], pair_of: Callable[..., Pair]
) -> Pair:
    """A pair (64, 96): patches of measured surfaces under lamps that cast shadows."""
    rng = np.random.default_rng(5)
    spectra = reflectance_spectra()
    rows, columns = HEIGHT // PATCH, WIDTH // PATCH
    chosen = spectra[rng.integers(0, len(spectra), rows * columns)]
    v, u = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]
    functions = converted(s, to) @ s

    def lit_by(light: Floats64, strength: Floats64) -> Floats64:
        light = light / (s[1] @ light)
        colours = (chosen * light) @ functions.T
        patches = colours.reshape(rows, columns, 3).repeat(PATCH, axis=0).repeat(PATCH, axis=1)
        return np.asarray(patches * strength[..., None])

    falloff = [0.9 - 0.5 * u, 0.4 + 0.5 * u, 0.4 + 0.4 * v]
    no_flash = np.zeros((HEIGHT, WIDTH, 3))
    for j, name in enumerate(lamps):
        lit = np.where((np.hypot(u - 0.3 - 0.11 * j, v - 0.5) < 0.22), 0.0, falloff[j])
        lit[u + (j - 1) * v < 0.15] = 0.0
        no_flash += lit_by(find_light(name), lit)
    flash = lit_by(find_light("xenon"), 0.7 - 0.6 * ((u - 0.5) ** 2 + (v - 0.5) ** 2))
    scale = 0.9 / max(no_flash.max(), flash.max())
    return pair_of(scale * no_flash, scale * flash)


def build(camera: Camera) -> Model:
    return build_model(camera, find_light("xenon"), find_light("D65"), "wpca")


def chosen_for(
    pair: Any, requested: Literal["auto", 1, 2, 3], sensor: Camera | None = None
) -> Camera:
    return likely_camera(pair, find_light("xenon"), requested, sensor, build)


def doubts_of(pair: Any, lamps: int, camera: Camera, frame: Frame) -> list[str]:
    """Messages of the warnings."""
    warnings = camera_doubts(reduce_pair(pair), lamps, camera, frame, build)
    assert {warning.code for warning in warnings} <= {Code.CAMERA_DOUBTFUL}
    return [warning.message for warning in warnings]


@pytest.mark.parametrize("to", ["sensor", "balanced", "sRGB"])
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("automatic", [True, False], ids=["auto", "given"])
def test_the_pair_tells_whose_colours_it_holds(
    other_sensor: Floats64,
    pair_of: Callable[..., Pair],
    to: str,
    count: Literal[2, 3],
    automatic: bool,
) -> None:
    pair = photographed(other_sensor, to, LAMPS[:count], pair_of)

    chosen = chosen_for(reduce_pair(pair), "auto" if automatic else count)

    assert chosen.name == {"sensor": SENSOR, "balanced": BALANCED, "sRGB": "sRGB"}[to]


@pytest.mark.parametrize("requested", ["auto", 1])
@pytest.mark.parametrize("to", ["sensor", "sRGB"])
def test_under_one_lamp_it_tells_too(
    other_sensor: Floats64,
    pair_of: Callable[..., Pair],
    to: str,
    requested: Literal["auto", 1],
) -> None:
    pair = photographed(other_sensor, to, LAMPS[:1], pair_of)

    assert chosen_for(reduce_pair(pair), requested).name == {"sensor": SENSOR}.get(to, to)


def test_a_balanced_sensor_sees_daylight_as_white(
    other_sensor: Floats64, pair_of: Callable[..., Pair]
) -> None:
    pair = photographed(other_sensor, "balanced", LAMPS[:2], pair_of)

    white = chosen_for(reduce_pair(pair), 2).sensitivities @ find_light("D65")

    np.testing.assert_allclose(white / white[1], 1.0, rtol=1e-9)


def test_a_pair_that_tells_nothing_is_taken_for_srgb() -> None:
    """Estimating the lamps then says that too few pixels are usable."""
    dark = reduced_pair(even(0.0, 0.0, 0.0), even(0.0, 0.0, 0.0))

    assert chosen_for(dark, "auto") is srgb_stand_in()


def test_a_pair_without_blue_is_taken_for_srgb(
    other_sensor: Floats64, pair_of: Callable[..., Pair]
) -> None:
    pair = photographed(other_sensor, "sensor", LAMPS[:2], pair_of)
    without = np.array([1.0, 1.0, 0.0])
    part = pair.flash[:] - pair.no_flash[:]

    chosen = chosen_for(reduce_pair(pair_of(pair.no_flash[:] * without, part * without)), 2)

    assert chosen is srgb_stand_in()


def test_a_camera_that_makes_no_sense_of_any_pixel_is_not_taken(
    other_sensor: Floats64, pair_of: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(given: FitInput, lamps: int) -> Fit:
        if (
            given.model.camera.sensitivities < 0
        ).any():  # sRGB's functions alone have negative parts
            raise UnusablePairError("hardly any pixel agrees")
        return first_fit(given, lamps)

    monkeypatch.setattr("pipeline.lamps.whose_colours.first_fit", failing)
    pair = photographed(other_sensor, "sRGB", LAMPS[:2], pair_of)

    assert chosen_for(reduce_pair(pair), 2).name == BALANCED


# a camera that EXIF names


@pytest.mark.parametrize("requested", ["auto", 2])
@pytest.mark.parametrize(("to", "added"), [("sensor", ""), ("balanced", ", balanced for daylight")])
def test_values_of_the_sensor_that_is_named_are_taken_as_such(
    other_sensor: Floats64,
    pair_of: Callable[..., Pair],
    requested: Literal["auto", 2],
    to: str,
    added: str,
) -> None:
    other = Camera("Other", other_sensor, "measured")
    pair = photographed(other_sensor, to, LAMPS[:2], pair_of)

    assert chosen_for(reduce_pair(pair), requested, other).name == f"Other{added}"


def test_srgb_is_told_from_what_the_named_sensor_gives(
    other_sensor: Floats64, pair_of: Callable[..., Pair]
) -> None:
    other = Camera("Other", other_sensor, "measured")
    pair = photographed(other_sensor, "sRGB", LAMPS, pair_of)

    assert chosen_for(reduce_pair(pair), 3, other) is srgb_stand_in()


def test_where_few_shadows_have_edges_the_name_is_believed(
    other_sensor: Floats64, pair_of: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.lamps.whose_colours.first_fit", lambda *_: pytest.fail("fitted"))
    other = Camera("Other", other_sensor, "measured")
    pair = photographed(other_sensor, "sRGB", LAMPS[:2], pair_of)

    assert chosen_for(reduce_pair(pair), 2, other).name == "Other, balanced for daylight"


def test_of_a_pair_that_tells_nothing_the_name_is_believed(camera: Camera) -> None:
    dark = reduced_pair(even(0.0, 0.0, 0.0), even(0.0, 0.0, 0.0))

    assert chosen_for(dark, "auto", camera) is camera


# a camera that somebody names


@pytest.fixture(scope="module")
def linear(frame: Callable[..., Frame]) -> Frame:
    return frame(np.zeros((2, 2, 3)), encoding="linear")


def test_the_camera_that_took_the_pair_is_not_doubted(
    other_sensor: Floats64, pair_of: Callable[..., Pair], linear: Frame
) -> None:
    pair = photographed(other_sensor, "sensor", LAMPS, pair_of)

    assert not doubts_of(pair, 3, Camera("Other", other_sensor, "file"), linear)


@pytest.mark.parametrize("encoding", ["linear", "raw"])
def test_another_camera_is_doubted(
    other_sensor: Floats64, pair_of: Callable[..., Pair], frame: Callable[..., Frame], encoding: str
) -> None:
    pair = photographed(other_sensor, "sensor", LAMPS, pair_of)
    photograph = frame(np.zeros((2, 2, 3)), encoding=encoding, make="Nikon D5100")
    named = find_camera("Sigma SD1 Merrill", photograph)

    (message,) = doubts_of(pair, 3, named, photograph)

    assert "A typical sensor explains the photographs much better" in message


def test_a_sensor_that_is_named_for_srgb_is_doubted(
    other_sensor: Floats64, pair_of: Callable[..., Pair], linear: Frame
) -> None:
    pair = photographed(other_sensor, "sRGB", LAMPS, pair_of)

    (message,) = doubts_of(pair, 3, Camera("Other", other_sensor, "file"), linear)

    assert "like linear sRGB" in message


def test_the_typical_sensor_itself_is_not_compared_with_itself(
    other_sensor: Floats64,
    pair_of: Callable[..., Pair],
    frame: Callable[..., Frame],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = photographed(other_sensor, "sensor", LAMPS, pair_of)
    raw = frame(np.zeros((2, 2, 3)), encoding="raw")
    monkeypatch.setattr("pipeline.lamps.whose_colours.first_fit", lambda *_: pytest.fail("fitted"))

    assert not doubts_of(pair, 3, typical_sensor(), raw)


@pytest.fixture
def costs(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """What each camera's fit is to cost, by its name; others cost nothing."""
    table: dict[str, float] = {}
    monkeypatch.setattr(
        "pipeline.lamps.whose_colours._Fits.cost", lambda _, camera: table.get(camera.name, 0.0)
    )
    return table


@pytest.fixture(scope="module")
def edged(other_sensor: Floats64, pair_of: Callable[..., Pair]) -> Pair:
    """A pair whose shadows have many edges."""
    return photographed(other_sensor, "sensor", LAMPS, pair_of)


@pytest.mark.parametrize(
    ("cost", "sensor", "srgb", "doubted"),
    [
        (59.0, 0.0, 500.0, None),
        (61.0, 0.0, 500.0, "typical sensor"),
        (89.0, 500.0, 0.0, None),
        (91.0, 500.0, 0.0, "linear sRGB"),
        (200.0, 0.0, 20.0, "typical sensor"),
        (200.0, 60.0, 0.0, "linear sRGB"),
    ],
)
def test_a_camera_is_doubted_where_another_is_much_likelier(
    edged: Pair,
    linear: Frame,
    costs: dict[str, float],
    other_sensor: Floats64,
    cost: float,
    sensor: float,
    srgb: float,
    doubted: str | None,
) -> None:
    costs.update({"Other": cost, "typical sensor": sensor, "sRGB": srgb})

    messages = doubts_of(edged, 2, Camera("Other", other_sensor, "file"), linear)

    assert [doubted in text for text in messages if doubted] == ([True] if doubted else [])
    assert len(messages) == (doubted is not None)


@pytest.mark.parametrize("likelier", ["typical sensor", "sRGB"])
@pytest.mark.parametrize(("cost", "doubted"), [(199.0, False), (201.0, True)])
def test_where_one_lamp_was_found_it_takes_more_to_doubt_a_camera(
    edged: Pair,
    linear: Frame,
    costs: dict[str, float],
    other_sensor: Floats64,
    likelier: str,
    cost: float,
    doubted: bool,
) -> None:
    """A wrong camera may hide a lamp; of one lamp alone the fits of two are chance."""
    costs.update({"Other": cost, "typical sensor": cost, "sRGB": cost, likelier: 0.0})

    messages = doubts_of(edged, 1, Camera("Other", other_sensor, "file"), linear)

    assert bool(messages) is doubted


@pytest.mark.parametrize(("lamps", "fitted"), [(1, {2}), (2, {2}), (3, {2, 3})])
def test_a_camera_is_doubted_by_two_lamps_and_by_as_many_as_were_found(
    edged: Pair,
    linear: Frame,
    other_sensor: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    lamps: int,
    fitted: set[int],
) -> None:
    asked: list[tuple[str, int]] = []

    def noting(given: FitInput, number: int) -> Fit:
        asked.append((given.model.camera.name, number))
        return Fit(np.eye(3)[None].repeat(number, axis=0), 0.0)

    monkeypatch.setattr("pipeline.lamps.whose_colours.first_fit", noting)

    doubts_of(edged, lamps, Camera("Other", other_sensor, "file"), linear)

    cameras = ("Other", typical_sensor().name, srgb_stand_in().name)
    assert sorted(asked) == sorted((name, number) for name in cameras for number in fitted)


@pytest.mark.parametrize(
    ("two", "three", "doubted"), [(-950.0, -300.0, False), (0.0, -1100.0, True)]
)
def test_three_lamps_that_two_explain_better_speak_against_no_camera(
    edged: Pair,
    linear: Frame,
    other_sensor: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    two: float,
    three: float,
    doubted: bool,
) -> None:
    """Where three are asked for and there are two, a third costs what chance has it cost."""
    costs = {("Other", 2): -1000.0, ("Other", 3): -100.0}
    others = {2: two, 3: three}

    def fitted(given: FitInput, number: int) -> Fit:
        matrices = given.model.lamp_matrix(np.eye(3)[:number])  # against which no prior speaks
        return Fit(matrices, costs.get((given.model.camera.name, number), others[number]))

    monkeypatch.setattr("pipeline.lamps.whose_colours.first_fit", fitted)

    messages = doubts_of(edged, 3, Camera("Other", other_sensor, "file"), linear)

    assert bool(messages) is doubted


@pytest.mark.parametrize(("cost", "chosen"), [(89.0, "Other"), (91.0, "sRGB")])
def test_a_camera_that_exif_names_gives_way_where_srgb_is_much_likelier(
    edged: Pair, costs: dict[str, float], other_sensor: Floats64, cost: float, chosen: str
) -> None:
    costs["Other"] = cost

    assert chosen_for(reduce_pair(edged), 2, Camera("Other", other_sensor, "measured")).name == (
        chosen
    )


@pytest.mark.parametrize(
    ("encoding", "make", "lamps", "doubted"),
    [
        ("srgb", "", 2, False),
        ("raw", "Sigma SD1 Merrill", 2, False),
        ("raw", "", 2, True),
        ("linear", "Sigma SD1 Merrill", 2, True),
    ],
    ids=["rendered", "RAW of that camera", "RAW", "linear of that camera"],
)
def test_what_tells_nothing_or_is_confirmed_is_not_looked_at(
    edged: Pair,
    frame: Callable[..., Frame],
    costs: dict[str, float],
    encoding: str,
    make: str,
    lamps: int,
    doubted: bool,
) -> None:
    photograph = frame(np.zeros((2, 2, 3)), encoding=encoding, make=make)
    camera = find_camera("Sigma SD1 Merrill", photograph)
    costs[camera.name] = 1000.0

    assert bool(doubts_of(edged, lamps, camera, photograph)) is doubted


@pytest.mark.parametrize(
    ("asked", "encoding", "make", "unknown"),
    [
        (None, "linear", "", True),
        (None, "srgb", "", False),
        (None, "raw", "", False),
        (None, "linear", "Nikon D5100", False),
        ("Nikon D5100", "linear", "", False),
    ],
)
def test_only_linear_files_that_name_no_camera_are_asked(
    frame: Callable[..., Frame], asked: str | None, encoding: str, make: str, unknown: bool
) -> None:
    photograph = frame(np.zeros((2, 2, 3)), encoding=encoding, make=make)

    assert names_no_camera(find_camera(asked, photograph), photograph) is unknown


def test_linear_files_that_say_their_colours_are_not_asked(
    frame: Callable[..., Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "pipeline.lamps.whose_colours.gather_evidence", lambda *_: pytest.fail("asked")
    )
    photograph = frame(np.zeros((2, 2, 3)), profiled=True)
    named = find_camera("Nikon D5100", photograph)
    dark = reduced_pair(even(0.0, 0.0, 0.0), even(0.0, 0.0, 0.0))

    assert names_no_camera(find_camera(None, photograph), photograph) is False
    assert camera_doubts(dark, 2, named, photograph, build) == []


@pytest.mark.parametrize("flattened", [True, False])
def test_a_contrast_that_was_taken_off_is_told(
    frame: Callable[..., Frame], flattened: bool
) -> None:
    """Else people would miss it in their pictures."""
    photograph = frame(np.zeros((2, 2, 3)), encoding="srgb")

    (warning,) = camera_warnings(photograph, srgb_stand_in(), False, flattened)

    assert warning.code is Code.RENDERED_SRGB
    assert ("flatter than the files" in warning.message) is flattened
