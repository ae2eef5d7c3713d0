from __future__ import annotations

import numpy as np
import pytest

from pipeline.calibration import find_chart as module
from pipeline.calibration.find_chart import _colours, find_charts
from tests.cluttered import Plan, Room, photograph_room


def _flash(room: Room) -> np.ndarray:
    return np.maximum(room.frames[1] - room.frames[0], 0)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_turned_and_tilted_chart_is_found_among_other_things(seed: int) -> None:
    room = photograph_room("chart", seed)
    (found,) = find_charts(_flash(room))
    assert room.corners is not None
    pitch = np.linalg.norm(room.corners[1] - room.corners[0]) / 5
    assert np.abs(found.corners - room.corners).max() < 0.03 * pitch
    assert found.patches >= 20
    assert found.misfit < 0.12


def test_both_of_two_charts_are_found() -> None:
    assert len(find_charts(_flash(photograph_room("chart", 3, Plan(targets=2))))) == 2


@pytest.mark.parametrize(
    ("target", "plan"), [("none", Plan()), ("chart", Plan(cut=0.4)), ("chart", Plan(shadow=True))]
)
def test_what_is_no_whole_chart_is_not_taken_for_one(target: str, plan: Plan) -> None:
    room = photograph_room("chart" if target == "chart" else "none", 4, plan)
    assert find_charts(_flash(room)) == []


def test_a_chequered_wall_is_seen_not_to_be_one_by_its_colours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Thousands of places on it could hold a chart, each of which takes milliseconds to look at."""
    looked_at: list[int] = []
    monkeypatch.setattr(module, "_chart", lambda *_: looked_at.append(1))
    y, x = np.mgrid[:200, :300] // 10
    assert find_charts(np.repeat(((x + y) % 2 * 0.8 + 0.1)[..., None], 3, axis=2)) == []
    assert looked_at == []


def test_a_black_picture_holds_nothing() -> None:
    assert find_charts(np.zeros((60, 90, 3))) == []


@pytest.mark.parametrize(("x", "inside"), [(8.0, True), (7.9, False), (52.0, True), (52.1, False)])
def test_patches_whose_frames_leave_the_picture_are_not_read(x: float, inside: bool) -> None:
    light = np.full((40, 60, 3), 0.5, np.float32)
    grid = np.full((24, 2), 20.0)
    grid[7, 0] = x
    colours = _colours(light, grid, pitch=20.0)
    assert (colours is not None) == inside
    if colours is not None:
        np.testing.assert_array_equal(colours, np.full((24, 3), 0.5))
