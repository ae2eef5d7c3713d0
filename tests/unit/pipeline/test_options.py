from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from pipeline.options import Circle, DirectedLight, Options, Sensitivities, Spectrum
from pipeline.output_names import OUTPUT_NAMES

DIRECTION = {"direction": [0, 0, 1]}
AREA = {"x": 10, "y": 20, "radius": 5}
RANGE: list[float] = [400, 500, 600, 700]
LONG = {"wavelength_nm": [400 + row / 5 for row in range(2001)], "power": [1] * 2001}
SENSOR = {"wavelength_nm": RANGE, "r": [1] * 4, "g": [1] * 4, "b": [1] * 4}


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
        pinned_lamps=["A", Circle(x=1, y=2.5, radius=3)],
        forbidden_lamps=[Spectrum(wavelength_nm=RANGE, power=[1, 1, 1, 1])],
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
        ({"exposure_ratio": 9.99e-4}, "greater than or equal to 0.001"),
        ({"exposure_ratio": 1001}, "less than or equal to 1000"),
        ({"exposure_ratio": float("nan")}, "exposure_ratio"),
        ({"exposure_ratio": float("inf")}, "exposure_ratio"),
        ({"focal_px": 0}, "focal_px"),
        ({"focal_px": 9.99}, "greater than or equal to 10"),
        ({"focal_px": 1.01e6}, "less than or equal to 1000000"),
        ({"focal_px": float("inf")}, "focal_px"),
        ({"light_directions": [DIRECTION]}, "light_directions"),
        ({"light_directions": [DIRECTION] * 4}, "light_directions"),
        ({"light_directions": [{**DIRECTION, "strength": 0}] * 3}, "strength"),
        ({"light_directions": [{**DIRECTION, "strength": 9.9e-7}] * 3}, "strength"),
        ({"light_directions": [{**DIRECTION, "strength": 1.1e6}] * 3}, "strength"),
        ({"light_directions": [{"direction": [0, 0]}] * 3}, "direction"),
        ({"light_directions": [{"direction": [0, 0, 0]}] * 3}, "zero in all three"),
        ({"light_directions": [{**DIRECTION, "rgb": [0, 0, 0]}] * 3}, "zero in all three"),
        ({"light_directions": [{**DIRECTION, "rgb": [0, -1, 0]}] * 3}, "rgb.1"),
        ({"light_directions": [{**DIRECTION, "rgb": [-1, -1, -1]}] * 3}, "rgb.0"),
        ({"light_directions": [{**DIRECTION, "rgb": [1, 1, float("nan")]}] * 3}, "rgb.2"),
        ({"light_directions": [{"direction": [0, 0, float("nan")]}] * 3}, "direction"),
        ({"light_directions": [{**DIRECTION, "color": "red"}] * 3}, "color"),
        ({"outputs": "some"}, "outputs"),
        ({"colour": "red"}, "colour"),
        ({"pinned_lamps": "A"}, "valid list"),
        ({"pinned_lamps": [7]}, "pinned_lamps.0.name"),
        ({"pinned_lamps": [None]}, "pinned_lamps.0.name"),
        ({"pinned_lamps": [{**AREA, "radius": 0}]}, "pinned_lamps.0.area.radius"),
        ({"pinned_lamps": [{**AREA, "radius": -1}]}, "pinned_lamps.0.area.radius"),
        ({"pinned_lamps": ["A", {"x": 1, "y": 2}]}, "pinned_lamps.1.area.radius"),
        ({"pinned_lamps": [{**AREA, "y": float("inf")}]}, "pinned_lamps.0.area.y"),
        ({"pinned_lamps": [{**AREA, "z": 1}]}, "pinned_lamps.0.area.z"),
        ({"forbidden_lamps": [{"wavelength_nm": RANGE, "power": [1]}]}, "forbidden_lamps.0.table"),
        ({"flash_spectrum": LONG}, "Spectrum].wavelength_nm"),
        ({"flash_spectrum": LONG | {"wavelength_nm": RANGE}}, "Spectrum].power"),
        ({"pinned_lamps": [LONG]}, "pinned_lamps.0.table.power"),
        ({"camera": SENSOR | {"r": [1] * 2001}}, "Sensitivities].r"),
        ({"camera": SENSOR | {"g": [1] * 2001}}, "Sensitivities].g"),
        ({"response": SENSOR | {"b": [1] * 2001}}, "Sensitivities].b"),
        ({"response": SENSOR | {"wavelength_nm": [1] * 2001}}, "Sensitivities].wavelength_nm"),
        ({"camera": "x" * 201}, "camera"),
        ({"response": "x" * 201}, "response"),
        ({"flash_spectrum": "x" * 201}, "flash_spectrum"),
        ({"neutral": "x" * 201}, "neutral"),
        ({"forbidden_lamps": ["x" * 201]}, "forbidden_lamps.0.name"),
        ({"outputs": ["layers.exr"] * 101}, "at most 100"),
        ({"pinned_lamps": ["A", "B", "C", "E"]}, "at most 3"),
        ({"forbidden_lamps": [f"D{k}" for k in range(40, 51)]}, "at most 10"),
        ({"pinned_lamps": [AREA, AREA]}, "the same lamp is pinned twice"),
        ({"forbidden_lamps": ["A", "A"]}, "the same lamp is forbidden twice"),
        ({"pinned_lamps": [AREA], "forbidden_lamps": ["A", AREA]}, "pinned and forbidden at once"),
        ({"lights": 1, "pinned_lamps": ["A", "B"]}, "2 lamps are pinned and only 1 asked for"),
        (
            {"light_directions": [DIRECTION] * 2, "pinned_lamps": ["A", "B", "C"]},
            "3 lamps are pinned and only 2 asked for",
        ),
        (
            {"light_directions": [DIRECTION] * 2, "lights": 3},
            "2 light directions, and 3 lamps are asked for; give a direction for each",
        ),
        ({"method": "paper", "pinned_lamps": ["A"]}, "no room for pinned or forbidden"),
        ({"method": "paper", "forbidden_lamps": ["A"]}, "no room for pinned or forbidden"),
    ],
)
def test_what_cannot_be_is_refused_by_name(options: dict[str, Any], part: str) -> None:
    assert part in reason(options)


def test_a_table_of_a_fifth_of_a_nanometre_is_taken() -> None:
    wavelengths = [380 + row / 5 for row in range(2000)]
    table = Spectrum(wavelength_nm=wavelengths, power=[1.0] * 2000)
    assert Options(flash_spectrum=table, camera="x" * 200).flash_spectrum == table


@pytest.mark.parametrize(
    ("options", "number"),
    [
        ({}, "auto"),
        ({"lights": 2}, 2),
        ({"light_directions": [DIRECTION] * 3}, 3),
        ({"light_directions": [DIRECTION] * 2}, 2),
        ({"light_directions": [DIRECTION] * 3, "lights": 1}, 1),
    ],
)
def test_directions_tell_the_number_of_lamps(options: dict[str, Any], number: object) -> None:
    assert Options.model_validate(options).number_of_lamps == number


def test_as_many_lamps_as_are_asked_for_can_be_pinned() -> None:
    options = Options.model_validate({"lights": 2, "pinned_lamps": ["A", AREA]})
    assert options.pinned_lamps == ["A", Circle(x=10, y=20, radius=5)]


def test_unknown_outputs_are_named_with_the_known_ones() -> None:
    said = reason({"outputs": ["layers.exr", "depths.exr", "album.pdf"]})

    assert "unknown output album.pdf, depths.exr" in said
    assert all(name in said for name in OUTPUT_NAMES)


@pytest.mark.parametrize("name", ["response.jpg", "response_lamps.jpg", "response.exr"])
def test_pictures_through_another_camera_need_one(name: str) -> None:
    assert f"{name} needs a response" in reason({"outputs": ["gamma.png", name]})
    assert Options(outputs=[name], response="Nikon D5100").outputs == [name]
    assert Options(outputs="all").response is None


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
