from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from pipeline.calibration import find_marks as module
from pipeline.calibration.chart import read_chart
from pipeline.calibration.find_marks import draw_marks, find_chart, find_sphere
from pipeline.errors import MarkError, UnusablePairError
from pipeline.options import Circle
from pipeline.pair.pair import Pair
from tests.cluttered import Plan, photograph_room
from tests.targets import Shot


@pytest.fixture
def pair(pair_of: Callable[..., Pair]) -> Callable[..., Pair]:
    def build(target: Any, seed: int, plan: Plan | None = None, **more: Any) -> Pair:
        return pair_of(Shot(photograph_room(target, seed, plan).frames, (b"", b"")), **more)

    return build


def test_no_chart_in_view_is_said_and_how_to_mark_it(pair: Callable[..., Pair]) -> None:
    with pytest.raises(MarkError, match=r"No ColorChecker was found: .* give the option chart,"):
        find_chart(pair("none", 1))


def test_two_charts_are_said(pair: Callable[..., Pair]) -> None:
    with pytest.raises(MarkError, match="2 things look like a ColorChecker: leave one"):
        find_chart(pair("chart", 3, Plan(targets=2)))


def test_a_chart_in_the_shadow_of_the_flash_is_said(pair: Callable[..., Pair]) -> None:
    found = pair("chart", 1, Plan(shadow=True))
    with pytest.raises(UnusablePairError, match="The flash does not reach patch"):
        read_chart(found, find_chart(found))


def test_an_overexposed_chart_is_refused(pair: Callable[..., Pair]) -> None:
    bright = photograph_room("chart", 1, Plan(exposure=2.5))
    clipped = (bright.frames[1] >= 1).any(axis=2)
    found = pair("chart", 1, Plan(exposure=2.5), unusable=clipped)
    with pytest.raises((MarkError, UnusablePairError), match=r"clipped"):
        read_chart(found, find_chart(found))


def test_no_sphere_is_said(pair: Callable[..., Pair]) -> None:
    with pytest.raises(MarkError, match=r"No matt grey sphere was found.* give the option sphere,"):
        find_sphere(pair("none", 1), False, 1000.0)


def test_marks_are_drawn_where_they_are(pair: Callable[..., Pair]) -> None:
    found = pair("none", 2)
    plain = np.asarray(Image.open(io.BytesIO(draw_marks(found, None, None))), int)
    circle = Circle(x=300, y=200, radius=80)
    marked = np.asarray(Image.open(io.BytesIO(draw_marks(found, None, circle))), int)
    changed = np.abs(marked - plain).sum(axis=2) > 120
    y, x = np.nonzero(changed)
    away = np.hypot(x - 300, y - 200)
    assert changed[200, 380] or changed[200, 379]
    assert ((away < 15) | (np.abs(away - 80) < 10)).all()


@pytest.fixture
def reduced(pair_of: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch) -> Pair:
    """A black pair of 600 × 400 pixels, of which the picture with the marks shows each second."""
    monkeypatch.setattr(module, "_LONG_SIDE", 300)
    black = np.zeros((400, 600, 3))
    return pair_of(Shot((black, black), (b"", b"")))


def test_a_circle_lies_where_it_is_in_a_picture_made_smaller(reduced: Pair) -> None:
    drawn = draw_marks(reduced, None, Circle(x=400, y=200, radius=120))
    marked = np.asarray(Image.open(io.BytesIO(drawn)), int)
    assert marked.shape == (200, 300, 3)
    y, x = np.nonzero(marked.sum(axis=2) > 120)
    away = np.hypot(x - 200, y - 100)
    assert ((away < 9) | (np.abs(away - 60) < 4)).all()
    ring = np.abs(away - 60) < 4
    assert (x[ring].min(), x[ring].max()) == (pytest.approx(140, abs=2), pytest.approx(260, abs=2))


def test_a_chart_is_outlined_and_its_corners_are_named_in_a_picture_made_smaller(
    reduced: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners = ((100.0, 60.0), (500.0, 80.0), (480.0, 340.0), (120.0, 320.0))
    named: dict[str, tuple[int, int]] = {}
    monkeypatch.setattr(cv2, "putText", lambda _, name, where, *__: named.update({name: where}))
    drawn = draw_marks(reduced, corners, None)
    lit = np.asarray(Image.open(io.BytesIO(drawn)), int).sum(axis=2) > 120
    for (left, top), (right, bottom) in zip(corners, corners[1:] + corners[:1], strict=True):
        x, y = round((left + right) / 4), round((top + bottom) / 4)
        assert lit[y - 1 : y + 2, x - 1 : x + 2].any()
    columns = np.flatnonzero(lit.any(axis=0))
    assert (columns[0], columns[-1]) == (pytest.approx(47, abs=2), pytest.approx(253, abs=2))
    for (corner_x, corner_y), (name, (start, base)) in zip(corners, named.items(), strict=True):
        middle = start + cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)[0][0] / 2
        assert middle == pytest.approx(corner_x / 2, abs=1)
        assert base < corner_y / 2 - 4 if corner_y < 200 else base > corner_y / 2 + 8
    assert list(named) == ["dark skin", "bluish green", "black", "white"]


def test_names_of_a_chart_that_fills_the_picture_are_whole_and_off_its_lines(
    reduced: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    corners = ((40.0, 40.0), (560.0, 40.0), (560.0, 360.0), (40.0, 360.0))
    named = np.asarray(Image.open(io.BytesIO(draw_marks(reduced, corners, None))), int)
    monkeypatch.setattr(cv2, "putText", lambda *_: None)
    outline = np.asarray(Image.open(io.BytesIO(draw_marks(reduced, corners, None))), int)
    words = np.abs(named - outline).sum(axis=2) > 200
    rows, columns = np.nonzero(words)
    assert ((rows < 20) | (rows > 180)).all()
    assert columns.min() > 0 and columns.max() < 299
    for corner in (np.s_[:20, :100], np.s_[:20, 200:], np.s_[181:, 200:], np.s_[181:, :100]):
        assert words[corner].sum() > 30
