from __future__ import annotations

from pipeline.spectra.families import FAMILIES
from tests.evaluation.known_lamps import (
    Named,
    Pinned,
    confusion_rows,
    family_of,
    family_rows,
    pin_rows,
)


def test_a_lamps_family_is_that_of_its_name() -> None:
    names = ("LED Phosphor 3000K", "LED Hybrid 2", "HPS 70 W", "Metal Halide 4", "Plasma")
    families = ["white LED", "white LED", "sodium", "mercury or metal halide", None]
    assert [family_of(name) for name in names] == families


def test_families_are_told_by_the_confidence_given() -> None:
    named = [
        Named("sodium", "sodium", 0.4),
        Named("sodium", "xenon", 0.5),
        Named("xenon", "xenon", 0.8),
        Named("xenon", "xenon", 0.9),
        Named("xenon", "sodium", 1.0),
    ]
    assert family_rows(named)[1:] == [
        ["0.4 … 0.6", "2", "50%", "0.45"],
        ["0.8 … 1", "3", "67%", "0.90"],
        ["0 … 1", "5", "60%", "0.72"],
    ]


def test_confusions_are_told_by_the_lamps_own_family() -> None:
    named = [Named("sodium", said, 0.5) for said in ("sodium", "incandescent", "incandescent")]
    assert confusion_rows(named) == [
        ["family", *FAMILIES],
        ["sodium", "2", "0", "0", "0", "0", "0", "1", "0"],
    ]


def test_pins_are_told_by_kind_and_right_ones_by_the_worst_third_too() -> None:
    right = [
        Pinned(str(n), "right", snr, n == 5)
        for n, snr in enumerate(
            ((20.0, 21.0), (6.0, 10.0), (30.0, 28.5), (22.0, 22.0), (8.0, 9.0), (25.0, 26.0))
        )
    ]
    absent = [Pinned("0", "absent", (20.0, 12.0), True), Pinned("1", "absent", (10.0, 9.0), False)]
    assert pin_rows([*absent, *right])[1:] == [
        ["right, worst third", "2", "7.0", "9.5", "+2.5", "+1.0", "0%"],
        ["right", "6", "21.0", "21.5", "+1.0", "-1.5", "17%"],
        ["absent", "2", "15.0", "10.5", "-4.5", "-8.0", "50%"],
    ]
