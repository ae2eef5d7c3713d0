from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from pipeline.options import OUTPUT_NAMES, DirectedLight, Options, Sensitivities, Spectrum

DIRECTION = {"direction": [0, 0, 1]}
RANGE: list[float] = [400, 500, 600, 700]


def reason(options: dict[str, Any]) -> str:
    """What is said of options that cannot be."""
    with pytest.raises(ValidationError) as refused:
        Options.model_validate(options)
    return str(refused.value)


def test_nothing_need_be_said() -> None:
    options = Options()

    assert options.lights == "auto"
    assert options.method == "best"
    assert options.basis == "wpca"
    assert options.camera is None
    assert options.flash_spectrum == "xenon"
    assert options.encoding == "auto"
    assert options.exposure_ratio is None
    assert options.align
    assert not options.flash_only
    assert options.neutral == "D65"
    assert options.outputs == "default"


def test_options_survive_json() -> None:
    options = Options(
        lights=3,
        camera=Sensitivities(wavelength_nm=RANGE, r=[0, 0, 1, 1], g=[0, 1, 1, 0], b=[1, 1, 0, 0]),
        flash_spectrum=Spectrum(wavelength_nm=RANGE, power=[1, 1, 1, 1]),
        light_directions=[DirectedLight(direction=(0, 0, 1), strength=0.5, rgb=(1, 0.5, 0.2))] * 3,
        outputs=["gamma.png"],
    )

    assert Options.model_validate_json(options.model_dump_json()) == options


@pytest.mark.parametrize("lights", [4, 5, 100])
def test_more_than_three_lamps_are_refused_with_the_reason(lights: int) -> None:
    assert "more than three lamps have no unique answer" in reason({"lights": lights})


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ({"lights": 0}, "lights"),
        ({"lights": -1}, "lights"),
        ({"lights": 1.5}, "lights"),
        ({"lights": "two"}, "lights"),
        ({"method": "worst"}, "method"),
        ({"basis": "ica"}, "basis"),
        ({"encoding": "gamma"}, "encoding"),
        ({"exposure_ratio": 0}, "exposure_ratio"),
        ({"exposure_ratio": -1}, "exposure_ratio"),
        ({"exposure_ratio": float("nan")}, "exposure_ratio"),
        ({"exposure_ratio": float("inf")}, "exposure_ratio"),
        ({"focal_px": 0}, "focal_px"),
        ({"focal_px": float("inf")}, "focal_px"),
        ({"light_directions": [DIRECTION]}, "light_directions"),
        ({"light_directions": [DIRECTION] * 4}, "light_directions"),
        ({"light_directions": [{**DIRECTION, "strength": 0}] * 3}, "strength"),
        ({"light_directions": [{"direction": [0, 0]}] * 3}, "direction"),
        ({"light_directions": [{"direction": [0, 0, 0]}] * 3}, "zero in all three"),
        ({"light_directions": [{**DIRECTION, "rgb": [0, 0, 0]}] * 3}, "zero in all three"),
        ({"light_directions": [{"direction": [0, 0, float("nan")]}] * 3}, "direction"),
        ({"light_directions": [{**DIRECTION, "color": "red"}] * 3}, "color"),
        ({"outputs": "some"}, "outputs"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_what_cannot_be_is_refused_by_name(options: dict[str, Any], part: str) -> None:
    assert part in reason(options)


def test_unknown_outputs_are_named_with_the_known_ones() -> None:
    said = reason({"outputs": ["layers.exr", "depths.exr", "album.pdf"]})

    assert "unknown output album.pdf, depths.exr" in said
    assert all(name in said for name in OUTPUT_NAMES)


@pytest.mark.parametrize(
    ("nm", "power", "words"),
    [
        (RANGE, [1, 1, 1], "as long as wavelength_nm"),
        ([400, 600, 500, 700], [1, 1, 1, 1], "must ascend"),
        ([400, 500, 500, 700], [1, 1, 1, 1], "must ascend"),
        ([430, 500, 600, 700], [1, 1, 1, 1], "must cover 420 to 660 nm"),
        ([400, 500, 600, 650], [1, 1, 1, 1], "must cover 420 to 660 nm"),
        (RANGE, [0, 0, 0, 0], "must not be all zero"),
        (RANGE, [1, -1, 1, 1], "greater than or equal to 0"),
        (RANGE, [1, float("inf"), 1, 1], "finite"),
        ([700], [1], "at least 2"),
    ],
)
def test_tables_of_light_that_cannot_be_are_refused(
    nm: list[float], power: list[float], words: str
) -> None:
    assert words in reason({"flash_spectrum": {"wavelength_nm": nm, "power": power}})


def test_a_camera_whose_channel_sees_nothing_is_refused() -> None:
    table = {"wavelength_nm": RANGE, "r": [0, 0, 1, 1], "g": [0, 0, 0, 0], "b": [1, 1, 0, 0]}

    assert "must not be all zero" in reason({"camera": table})


def test_options_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Options().lights = 2
