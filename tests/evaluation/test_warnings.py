from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.run_warnings import Code, RunWarning
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.results import Result
from tests.evaluation.scenes import render_scene, scenes
from tests.evaluation.warnings import (
    CASES,
    Case,
    expectations,
    false_on_clean,
    missed,
    sections,
    shown,
    table,
)

SMALL = (64, 48)
CLEAN = Case("clean", "two", Condition(), None)
WEAK = Case("weak", "two", Condition(), Code.FLASH_TOO_WEAK)
ALIKE = Case("alike", "angle", Condition(), Code.LAMPS_ALIKE)


@pytest.fixture
def result() -> Callable[..., Result]:
    """A result with warnings of some codes."""

    def build(scene: str, *codes: Code, **more: Any) -> Result:
        warnings = tuple(RunWarning(code, "Something.").entry() for code in codes)
        plain = Result(scene, "best", 20.0, None, 2, 2, 1.0, warnings, "", 1.0)
        return replace(plain, **more)

    return build


@pytest.fixture
def cases(result: Callable[..., Result]) -> list[tuple[Case, list[Result]]]:
    """Two clean scenes, one falsely warned of; four weak ones, one silent and one refused."""
    weak = [
        result("w1", Code.FLASH_TOO_WEAK),
        result("w2", Code.FLASH_TOO_WEAK, Code.NUMBER_UNCERTAIN),
        result("w3"),
        result("w4", refusal="Too weak."),
    ]
    return [(CLEAN, [result("c1"), result("c2", Code.MOVED)]), (WEAK, weak)]


def test_what_was_asked_for_is_counted(cases: list[tuple[Case, list[Result]]]) -> None:
    assert shown(cases, Code.FLASH_TOO_WEAK) == (3, 4)
    assert shown(cases, Code.MOVED) == (0, 0)
    assert false_on_clean(cases) == (1, 2)
    assert missed(cases) == ["c2 gets moved", "w3 lacks flash_too_weak"]


def test_the_table_shows_every_warning_that_came(
    cases: list[tuple[Case, list[Result]]],
) -> None:
    assert table(cases) == [
        [
            "scenes",
            "number",
            "`moved`",
            "`flash_too_weak`",
            "`number_uncertain`",
            "none",
            "refused",
        ],
        ["clean", "2", "1", "", "", "1", ""],
        ["weak", "4", "", "**2**", "1", "1", "1"],
    ]


def test_expected_snr_is_compared_with_the_true_one(result: Callable[..., Result]) -> None:
    def alike(expected: float, true: float | None) -> Result:
        figures = {"angle_deg": 2.0, "expected_snr_db": expected}
        warning = RunWarning(Code.LAMPS_ALIKE, "Alike.", figures).entry()
        return result("a", warnings=(warning,), snr_db=true)

    found = [alike(10.0, 12.0), alike(14.0, 9.0), alike(16.0, 15.0), alike(3.0, None)]

    assert expectations({"development": [(ALIKE, found)], "report": []})[1:] == [
        ["development", "3", "14.0", "12.0", "2.0 / 5.0"]
    ]


def test_the_document_says_what_is_not_met(cases: list[tuple[Case, list[Result]]]) -> None:
    text = "\n".join(sections({"development": cases, "report": cases}))

    assert "| `flash_too_weak` on its scenes, ≥ 90% | 3 of 4, **not met** |" in text
    assert "| any warning on clean scenes, ≤ 5% | 1 of 2, **not met** |" in text
    assert "Not as it should be: c2 gets moved; w3 lacks flash_too_weak." in text
    assert "## Report scenes" in text


def test_every_case_has_scenes_in_both_halves() -> None:
    for case in CASES:
        for split in ("development", "report"):
            chosen = case.scenes(split)
            assert 2 <= len(chosen) <= case.most
            assert all(split in scene.name for scene in chosen)


def test_a_weak_flash_is_weak_against_the_lamps() -> None:
    scene = scenes("two", "development")[0]

    plain, weak = (render_scene(scene, SMALL, flash_strength=s) for s in (1.0, 0.25))

    ratio = [r.flash[..., 1].mean() / r.no_flash_frame[..., 1].mean() for r in (plain, weak)]
    np.testing.assert_allclose(ratio, [1.0, 0.25], rtol=1e-3)
    assert weak.no_flash_frame.mean() > plain.no_flash_frame.mean()  # exposed anew


def test_what_is_told_may_be_wrong() -> None:
    scene = scenes("two", "development")[0]

    shot = make_shot(scene, Condition(SMALL, lights=1, exposure_ratio=1.5))

    assert shot.lights == 1
    assert shot.count == 2
    assert shot.options["exposure_ratio"] == 1.5


@pytest.mark.parametrize(("group", "lamps"), [("panels-two", 2), ("panels-three", 3)])
def test_on_panels_no_lamp_is_ever_alone(group: str, lamps: int) -> None:
    rendered = render_scene(scenes(group, "development")[0], SMALL)

    light = rendered.lamps.sum(axis=3)
    shares = light / light.sum(axis=0)

    assert len(shares) == lamps
    assert shares.max() < 0.95
    assert shares.min() > 0.03
    assert (shares.max(axis=(1, 2)) - shares.min(axis=(1, 2))).min() > 0.1
