import pytest

from service.cli.numbers import circle, lamps_asked_for, read_numbers


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("1,2.5,-3", [1, 2.5, -3]), ("7", [7]), ("1,x", None), ("lamp.csv", None), ("", None)],
)
def test_numbers_have_commas_between_them(text: str, numbers: list[float] | None) -> None:
    assert read_numbers(text) == numbers


def test_a_circle_is_three_numbers() -> None:
    assert circle([1, 2, 3]) == {"x": 1, "y": 2, "radius": 3}
    with pytest.raises(ValueError, match="shorter"):
        circle([1, 2])


@pytest.mark.parametrize(
    ("text", "number"),
    [("2", 2), ("0", 0), ("auto", "auto"), ("-1", "-1"), ("", ""), ("9" * 5000, "9" * 5000)],
)
def test_a_number_of_lamps_is_a_number_or_a_word(text: str, number: int | str) -> None:
    assert lamps_asked_for(text) == number
