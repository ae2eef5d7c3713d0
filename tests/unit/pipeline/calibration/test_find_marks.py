from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from PIL import Image

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
        find_sphere(pair("none", 1), mirror=False)


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
