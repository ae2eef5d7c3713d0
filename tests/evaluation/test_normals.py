from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.evaluation import normals
from tests.evaluation.normals import CONDITIONS, Figures, measure, rows
from tests.evaluation.objects import OBJECTS

BALL = OBJECTS["development"][0]


def test_the_zero_of_the_scale_is_that_of_a_ball() -> None:
    """The mean angle of a ball's lit normals to the camera; half a ball would have 45°."""
    found = measure("measured lamps", BALL, "development", "facing the camera")

    assert 25 < found.error_deg < 40
    assert found.coverage == 1
    assert found.depth_error is None


@pytest.mark.parametrize(
    ("condition", "limit"), [("two lamps", 1.0), ("sensor noise", 3.0), ("directions 10° off", 0.5)]
)
def test_the_product_is_measured_from_file_to_file(condition: str, limit: float) -> None:
    found = measure(condition, BALL, "development", "best")

    assert found.error_deg < limit
    assert found.coverage > 0.98
    assert found.depth_error is not None
    assert found.depth_error < 0.02
    assert not found.refusal
    assert found.unsure_deg is not None and found.sure_deg is not None
    assert found.unsure_deg > 2 * found.sure_deg


def test_a_surface_may_jump() -> None:
    """A ball before another, which would be 22° off as one surface."""
    things = {one.name: one for one in OBJECTS["development"]}

    found = measure("measured lamps", things["plain balls"], "development", "best")

    assert found.error_deg < 0.5
    assert found.coverage > 0.98
    assert found.depth_error is not None
    assert found.depth_error < 0.08


def test_a_refusal_is_told_and_counts_as_wrong() -> None:
    found = measure("two lamps", BALL, "development", "paper")

    assert "three light directions" in found.refusal
    assert found.error_deg == 90
    assert found.coverage == 0


def test_rows_are_medians_and_worst_values() -> None:
    def one(method: str, error: float, depth: float | None) -> Figures:
        sure = None if depth is None else 3 * error
        return Figures(
            "sensor noise", "ball", 1, method, error, 0.5 + error / 10, depth, sure, 1, "", 1
        )

    found = [one("best", error, 0.01 * error) for error in (1.0, 2.0, 4.0)]

    table = rows([*found, one("paper", 30.0, None)])

    assert table[0] == ["", "best", "paper", "coverage", "depth, % of relief", "least / most sure"]
    assert table[1] == [
        "sensor noise",
        "2.00 / 4.00",
        "30.00 / 30.00",
        "0.600",
        "2.00 / 4.00",
        "6.00 / 1.00",
    ]


def test_a_refused_object_has_no_depth_and_so_no_good_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(normals, "_DOCS", tmp_path)
    found = [
        Figures(name, thing.name, thing.materials, "best", 0.5, 1.0, 0.0123, 2.0, 0.3, "", 1.0)
        for name in CONDITIONS
        for thing in OBJECTS["report"]
    ]
    refused = Figures("two lamps", "egg", 1, "best", 90.0, 0.0, None, None, None, "Too dark.", 1.0)
    places = [(one.condition, one.object) for one in found]
    found[places.index(("two lamps", "egg"))] = refused

    normals._write(found, "| |")

    egg = [line for line in (tmp_path / "normals.md").read_text().splitlines() if "| egg |" in line]
    errors, depths = ([cell.strip() for cell in line.split("|")[3:-1]] for line in egg)
    assert errors == [*["0.50"] * (len(CONDITIONS) - 1), "90.00"]
    assert depths == [*["1.23"] * (len(CONDITIONS) - 1), "–"]


def test_conditions_say_what_they_are_named() -> None:
    assert CONDITIONS["directions alone"].said == ("direction",)
    assert CONDITIONS["two lamps"].lamps == (0, 1)
    assert [name for name, one in CONDITIONS.items() if one.noise] == [
        "sensor noise",
        "strengths unknown, noise",
    ]
    assert np.all(["strength" not in CONDITIONS[n].said for n in CONDITIONS if "unknown" in n])
