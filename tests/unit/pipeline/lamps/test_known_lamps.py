from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import OptionError
from pipeline.lamps.known_lamps import check_places, find_known
from pipeline.light.model import Model
from pipeline.matrixfit.known import Known
from pipeline.options import Options, Spectrum
from pipeline.pair.reduced import reduce_pair
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light

Find = Callable[..., Known]

SIZE = (96, 64)
LEFT, RIGHT = {"x": 6, "y": 32, "radius": 5}, {"x": 90, "y": 32, "radius": 5}


@pytest.fixture
def find(exact: Callable[..., Any], warm_to_cool: Floats64, model: Model) -> Find:
    """Find what options say of the lamps of a scene: a bulb at the left, blue sky at the right."""

    def of_options(
        pinned: Any = (),
        forbidden: Any = (),
        **changes: Any,
    ) -> Known:
        reduced = replace(reduce_pair(exact(warm_to_cool[[0, 2]])[0]), **changes)
        options = Options(pinned_lamps=list(pinned), forbidden_lamps=list(forbidden))
        return find_known(options, reduced, model)

    return of_options


def refusal(find: Find, *known: Any, **changes: Any) -> str:
    with pytest.raises(OptionError) as refused:
        find(*known, **changes)
    return str(refused.value)


def angle(a: Floats64, b: Floats64) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def test_nothing_is_known_without_options(find: Find) -> None:
    known = find()
    assert known.pinned == ()
    assert known.forbidden.shape == (0, 3)


def test_areas_show_the_lamps_that_light_them(
    find: Find, model: Model, warm_to_cool: Floats64
) -> None:
    known = find([LEFT, RIGHT])

    whites = known.matrices @ model.flash_white
    assert angle(whites[0], model.lamp_matrix(warm_to_cool[0]) @ model.flash_white) < 0.3
    assert angle(whites[1], model.lamp_matrix(warm_to_cool[2]) @ model.flash_white) < 0.3


@pytest.mark.parametrize("form", ["name", "table"])
def test_spectra_show_their_lamps(find: Find, camera: Camera, model: Model, form: str) -> None:
    grid = np.arange(380, 785, 5, dtype=float)
    table = Spectrum(wavelength_nm=list(grid), power=list(find_light("A")))

    known = find(["A" if form == "name" else table], ["D65"])

    (pinned,) = known.matrices @ model.flash_white
    assert angle(pinned, camera.sensitivities @ find_light("A")) < 1.0
    assert angle(known.forbidden[0], camera.sensitivities @ find_light("D65")) < 1.0
    assert np.linalg.norm(known.forbidden[0]) == pytest.approx(1)


def test_areas_are_told_from_spectra(find: Find) -> None:
    assert [pin.of_area for pin in find(["D65", LEFT]).pinned] == [False, True]


def test_a_flash_part_alone_is_not_as_noisy_as_a_difference(find: Find) -> None:
    """Of a difference, noise is in both lights, and errors of what is seen are less certain."""
    noise = np.full((64, 96, 3), 1e-4, np.float32)
    part, difference = (
        find([LEFT], flash_only=flash_only, no_flash_variance=noise).pinned[0].term.data
        for flash_only in (True, False)
    )
    np.testing.assert_array_equal(part.u, difference.u)
    assert (difference.covariance[:, 0] > 1.1 * part.covariance[:, 0]).all()


def test_forbidden_areas_are_told_like_pinned_ones(find: Find, model: Model) -> None:
    (pinned,) = find([LEFT]).matrices @ model.flash_white
    assert angle(find((), [LEFT]).forbidden[0], pinned) < 1e-3


def test_an_area_is_given_in_pixels_of_the_photograph(find: Find) -> None:
    """Blocks of four pixels lie in a disc four times as wide."""
    fine = find([LEFT])
    coarse = find([{name: 4 * value for name, value in LEFT.items()}], block=4)
    np.testing.assert_array_equal(fine.matrices, coarse.matrices)


def test_an_area_holds_the_blocks_whose_middles_it_holds(find: Find) -> None:
    """Of twelve around a corner; by corners of theirs it would hold but four of the outer eight."""
    usable = np.zeros((64, 96), dtype=bool)
    usable[[30, 33], 19:21] = usable[31:33, [18, 21]] = True
    area = {"x": 4 * 20, "y": 4 * 32, "radius": 4 * 1.6}
    assert len(find([area], usable=usable, block=4).pinned) == 1


def test_five_blocks_tell_a_light(find: Find) -> None:
    cross = {"x": 20.5, "y": 32.5, "radius": 1.1}
    usable = np.ones((64, 96), dtype=bool)
    assert len(find([cross], usable=usable).pinned) == 1
    usable[32, 20] = False
    assert "clipped, dark" in refusal(find, [cross], usable=usable)


@pytest.mark.parametrize("place", [{"x": 0, "y": 32}, {"x": 48, "y": 0}, {"x": 95.9, "y": 63.9}])
def test_areas_at_the_border_are_inside(find: Find, place: dict[str, float]) -> None:
    area = {**place, "radius": 5}
    check_places(Options.model_validate({"pinned_lamps": [area]}), SIZE)
    assert len(find([area]).pinned) == 1


@pytest.mark.parametrize(
    "place", [{"x": 96, "y": 3}, {"x": 3, "y": 64}, {"x": 1e9, "y": 3}, {"x": -1, "y": 3}]
)
def test_areas_outside_are_refused(place: dict[str, float]) -> None:
    area = {**place, "radius": 5}
    where = "has its middle at .*, outside of the photograph's 96 × 64 pixels"
    with pytest.raises(OptionError, match=f"^The area of pinned lamp 2 {where}"):
        check_places(Options.model_validate({"pinned_lamps": ["A", area]}), SIZE)
    with pytest.raises(OptionError, match=f"^The area of forbidden lamp 1 {where}"):
        check_places(Options.model_validate({"forbidden_lamps": [area]}), SIZE)


def test_tiny_areas_are_refused_with_a_radius_that_will_do(find: Find) -> None:
    assert "radius of 2 pixels or more" in refusal(find, [{"x": 40, "y": 30, "radius": 1}])
    assert len(find([{"x": 40, "y": 30, "radius": 2}]).pinned) == 1


def test_areas_without_usable_pixels_are_refused(find: Find) -> None:
    usable = np.ones((64, 96), dtype=bool)
    usable[:, :40] = False
    said = refusal(find, [LEFT], usable=usable)
    assert "area of pinned lamp 1 is clipped, dark or out of the flash's reach" in said
    assert len(find([RIGHT], usable=usable).pinned) == 1


@pytest.mark.parametrize("name", ["FL77", "", "1,2"])
def test_unknown_names_are_refused(find: Find, name: str) -> None:
    assert f"No pinned lamp 1 spectrum is called '{name}'" in refusal(find, [name])


@pytest.mark.parametrize("power", [1e-5, 1.0, 1e290])
@pytest.mark.parametrize("from_nm", [720, 775])
def test_a_spectrum_that_the_camera_hardly_sees_is_refused(
    find: Find, from_nm: float, power: float
) -> None:
    beyond = Spectrum(wavelength_nm=[380, from_nm, 780], power=[0, 0, power])
    for known in ([beyond], ()), ((), [beyond]):
        said = refusal(find, *known)
        assert "sees hardly anything of" in said
        assert "lamp 1: check the wavelengths of both" in said


def test_a_deep_red_spectrum_is_seen(find: Find) -> None:
    red = Spectrum(wavelength_nm=[380, 640, 650, 660], power=[0, 0, 1, 0])
    assert np.isfinite(find([red]).matrices).all()


def test_a_spectrum_that_has_no_sum_is_refused(find: Find) -> None:
    endless = Spectrum(wavelength_nm=[380, 780], power=[1e308, 1e308])
    assert "The pinned lamp 1 spectrum is too large" in refusal(find, [endless])
    assert "The forbidden lamp 1 spectrum is too large" in refusal(find, (), [endless])


def test_a_near_name_is_given(find: Find) -> None:
    assert "FL12" in refusal(find, (), ["FL12x"])


def test_one_lamp_cannot_be_pinned_twice(find: Find) -> None:
    near = {**LEFT, "y": 40}
    assert "Pinned lamps 1 and 2 have the same colour" in refusal(find, [LEFT, near])
    assert len(find([LEFT, RIGHT]).pinned) == 2


@pytest.mark.parametrize(("degrees", "same"), [(0.95, True), (1.05, False)])
def test_pinned_lamps_differ_by_a_degree(
    find: Find, camera: Camera, degrees: float, same: bool
) -> None:
    """Of a bulb, and of the bulb with a little daylight."""
    bulb, sky = find_light("A"), find_light("D65")
    seen, other = camera.sensitivities @ bulb, camera.sensitivities @ sky
    along = seen / np.linalg.norm(seen)
    across = other - (other @ along) * along
    # a mixture in which what is across the bulb's colour is tan(angle) of what is along it
    tangent, height = np.tan(np.radians(degrees)), np.linalg.norm(across)
    part = tangent * np.linalg.norm(seen) / (height - tangent * (other @ along))
    grid = list(np.arange(380, 785, 5, dtype=float))
    mixed = Spectrum(wavelength_nm=grid, power=list(bulb + part * sky))

    if same:
        assert "have the same colour" in refusal(find, ["A", mixed])
    else:
        assert len(find(["A", mixed]).pinned) == 2


def test_a_lamp_cannot_be_pinned_and_forbidden(find: Find) -> None:
    said = refusal(find, ["D65", LEFT], [RIGHT, {**LEFT, "y": 40}])
    assert "Pinned lamp 2 is less than 3° in colour from a forbidden one" in said
    assert len(find([LEFT], [RIGHT]).pinned) == 1
