from __future__ import annotations

from typing import Annotated, Literal

import pytest
from pydantic import Field, StrictBool, StrictInt, TypeAdapter, ValidationError

from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import OptionError
from pipeline.options import Options
from service.sentences import describe_fault, in_words, sentence_of

TABLE = {"wavelength_nm": [400, 700], "r": [1, 2], "g": [2, 1], "b": [1, 1]}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"lights": 4}, "more than three lamps have no unique answer"),
        ({"focal_px": -1}, "focal_px: Input should be greater than or equal to 10."),
        ({"basis": "svd"}, "basis: Input should be 'wpca', 'pca' or 'joint'."),
        ({"lamps": 2}, "lamps: this name is not known."),
        ({"outputs": ["a.gif"]}, "unknown output a.gif"),
        ({"outputs": "a.gif"}, "outputs: Input should be 'default' or 'all' or a valid list."),
        ({"outputs": [1, 2]}, "outputs.0: Input should be a valid string."),
        ({"response": 1}, "response: Input should be a valid string or a valid object."),
        ({"light_directions": [1]}, "light direction 1: Input should be a valid object."),
        ({"setup": "my table"}, "setup: such a name has 1 to 40 of the letters"),
        ({"int": 1}, "int: this name is not known."),
        ({"response": {"spectral_data": {}}}, "response.wavelength_nm: Field required."),
        ({"camera": {**TABLE, "version": 2}}, "camera.version: this name is not known."),
        (
            {"response": {"taken_with": {"lens": ""}}},
            "response.taken_with.lens: this name is not known.",
        ),
        ({"lights": 0, "focal_px": -1}, "lights: Input should be 'auto', 1, 2 or 3."),
    ],
)
def test_a_fault_of_the_options_is_one_sentence(options: dict[str, object], expected: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Options.model_validate(options)
    sentence = sentence_of(caught.value)
    assert expected.lower() in sentence.lower()
    assert "function-" not in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, "Field 'kind' required."),
        ({"kind": "lens"}, "'kind' should be one of 'flash', 'camera', 'lamps'."),
        (3, "Input should be a valid object."),
        ({"kind": "flash", "chart": 3}, "flash.chart: Input should be a valid list."),
        (
            {"kind": "flash", "chart": [[1, 2]] * 5},
            "flash.chart: List should have at most 4 items, not 5.",
        ),
        ({"kind": "camera", "chart": [[1, 2]]}, "camera.chart, number 2: Field required."),
    ],
)
def test_a_fault_of_a_calibration_is_one_sentence(options: object, expected: str) -> None:
    with pytest.raises(ValidationError) as caught:
        CALIBRATION_OPTIONS.validate_python(options)
    assert sentence_of(caught.value) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("x", "Invalid JSON: expected value at line 1 column 1."),
        ("{}", "The object should have at least 1 item, not 0."),
        ('{"z": 1}', "z: this name is not known; it should be 'x' or 'y'."),
        ('{"x": "z"}', "x: Input should be a valid integer or a valid boolean."),
    ],
)
def test_a_fault_of_an_object_is_one_sentence(value: str, expected: str) -> None:
    kind = dict[Literal["x", "y"], StrictInt | StrictBool]
    with pytest.raises(ValidationError) as caught:
        TypeAdapter(Annotated[kind, Field(min_length=1)]).validate_json(value)
    assert sentence_of(caught.value) == expected


@pytest.mark.parametrize(
    ("place", "message", "expected"),
    [
        (("light_directions", 0, "rgb"), "too short.", "light direction 1, rgb: too short."),
        (
            ("light_directions", 1, "direction", 2),
            "no",
            "light direction 2, direction, number 3: no.",
        ),
        (("pinned_lamps", 9, "area", "radius"), "no", "pinned lamp 10, radius: no."),
        (("forbidden_lamps", 0, "table"), "no", "forbidden lamp 1: no."),
        (("forbidden_lamps", 0, "name"), "no", "forbidden lamp 1: no."),
        (("mix", "lamps", 1, "name"), "no", "mix.lamp 2, name: no."),
        (("lamps",), "no", "lamps: no."),
        (("rgb", "1" * 10), "no", f"rgb.{'1' * 10}: no."),
        (("lamps", "1" * 5000, "x"), "no", f"lamps.{'1' * 80}….x: no."),
        ((), "value error, too short", "Value error, too short."),
        (("mix",), "Value error, nothing is lit", "mix: nothing is lit."),
    ],
)
def test_a_fault_is_told_with_its_place(
    place: tuple[int | str, ...], message: str, expected: str
) -> None:
    assert describe_fault(place, message) == expected


def test_what_is_refused_in_a_block_is_an_error_with_the_sentence() -> None:
    with pytest.raises(OptionError) as caught, in_words():
        Options.model_validate_json('{"lights": 2, "light": 2}')
    assert str(caught.value) == "light: this name is not known."
