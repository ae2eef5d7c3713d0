import pytest

from service.cli.numbers import circle, read_numbers


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
