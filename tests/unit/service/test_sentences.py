from __future__ import annotations

import pytest
from pydantic import ValidationError

from pipeline.options import Options
from service.sentences import describe_fault, sentence_of


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"lights": 4}, "more than three lamps have no unique answer"),
        ({"focal_px": -1}, "focal_px: Input should be greater than 0."),
        ({"basis": "svd"}, "basis: Input should be 'wpca', 'pca' or 'joint'."),
        ({"lamps": 2}, "lamps: this name is not known."),
        ({"outputs": ["a.gif"]}, "unknown output a.gif"),
    ],
)
def test_a_fault_of_the_options_is_one_sentence(options: dict[str, object], expected: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Options.model_validate(options)
    sentence = sentence_of(caught.value)
    assert expected.lower() in sentence.lower()
    assert sentence.endswith(".")
    assert "\n" not in sentence


@pytest.mark.parametrize(
    ("place", "message", "expected"),
    [
        (("light_directions", 0, "rgb"), "too short.", "light_directions.0.rgb: too short."),
        ((), "value error, too short", "Value error, too short."),
        (("mix",), "Value error, nothing is lit", "mix: nothing is lit."),
    ],
)
def test_a_fault_is_told_with_its_place(
    place: tuple[int | str, ...], message: str, expected: str
) -> None:
    assert describe_fault(place, message) == expected
