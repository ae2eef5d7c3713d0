from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.calibration.mirror_sphere import mirror_lamps
from pipeline.errors import OptionError, UnusablePairError
from pipeline.options import Circle
from pipeline.pair.pair import Pair
from tests.cluttered import FOCAL_PX, Plan, Room, photograph_room
from tests.targets import Shot

LARGE = Plan(share=(0.5, 0.6), blur_px=0.0, exposure=0.2)


@pytest.fixture(scope="module")
def room() -> Room:
    return photograph_room("mirror", 5, LARGE)


@pytest.fixture(scope="module")
def pair(room: Room, pair_of: Callable[..., Pair]) -> Pair:
    return pair_of(Shot(room.frames, (b"", b"")))


def _degrees(room: Room, found: np.ndarray) -> np.ndarray:
    return np.asarray(np.degrees(np.arccos(np.clip(room.directions @ found.T, -1, 1))).min(axis=1))


def test_highlights_tell_where_lamps_are(room: Room, pair: Pair) -> None:
    assert room.circle is not None
    found = mirror_lamps(pair, room.circle, "auto", FOCAL_PX)
    assert len(found.directions) == 2
    assert _degrees(room, found.directions).max() < 1.0
    assert found.flash_aside_deg is not None
    assert found.flash_aside_deg < 1.0
    assert found.misfit is None
    # by an outline a hundredth aside: 2 · 0.01 rad of a highlight amid, more to the edge
    half_angles = np.arccos(found.directions[:, 2]) / 2
    expected = np.degrees(0.02) / np.cos(half_angles)
    np.testing.assert_allclose(found.deviations_deg, expected, rtol=1e-9)


def test_a_flash_that_the_sphere_does_not_show_has_no_angle(room: Room, pair: Pair) -> None:
    assert room.circle is not None
    unlit = replace(pair, flash=pair.no_flash)
    assert mirror_lamps(unlit, room.circle, "auto", FOCAL_PX).flash_aside_deg is None


def test_where_the_flash_is_tells_its_own_light_alone(room: Room, pair: Pair) -> None:
    """In a room of which the sphere shows the lamps, and all around them is black."""
    assert room.circle is not None
    seen = pair.no_flash[:]
    bright = seen.sum(axis=2, keepdims=True) > 0.25 * seen.sum(axis=2).max()
    black = np.where(bright, seen, 0).astype(np.float32)
    dark = replace(pair, no_flash=black, flash=black + pair.flash_part())
    alone = replace(dark, flash=pair.flash_part(), flash_only=True)

    found = [mirror_lamps(one, room.circle, "auto", FOCAL_PX) for one in (pair, dark, alone)]

    expected, *others = (one.flash_aside_deg for one in found)
    assert expected is not None
    assert expected < 1.0
    assert others == pytest.approx([expected, expected], abs=0.01)


def test_highlights_that_are_not_clipped_tell_strengths_and_colours(
    pair_of: Callable[..., Pair],
) -> None:
    dark = photograph_room("mirror", 5, Plan(share=(0.5, 0.6), blur_px=0.0, exposure=0.05))
    assert dark.circle is not None
    found = mirror_lamps(pair_of(Shot(dark.frames, (b"", b""))), dark.circle, 2, FOCAL_PX)
    assert not np.isnan(found.colours).any()
    order = np.argmax(dark.directions @ found.directions.T, axis=1)
    ours = found.colours[order] / found.colours.max()
    true = dark.colours / dark.colours.max()
    np.testing.assert_allclose(ours / ours[0, 1], true / true[0, 1], rtol=0.12)


def test_clipped_highlights_tell_no_colours(pair_of: Callable[..., Pair]) -> None:
    bright = photograph_room("mirror", 5, Plan(share=(0.5, 0.6), blur_px=0.0, exposure=2.0))
    assert bright.circle is not None
    found = mirror_lamps(pair_of(Shot(bright.frames, (b"", b""))), bright.circle, 2, FOCAL_PX)
    assert np.isnan(found.colours).all()
    assert _degrees(bright, found.directions).max() < 1.0


def test_floats_that_go_on_above_1_have_no_clipped_highlights(pair_of: Callable[..., Pair]) -> None:
    dark = photograph_room("mirror", 5, Plan(share=(0.5, 0.6), blur_px=0.0, exposure=0.05))
    assert dark.circle is not None
    pair = pair_of(Shot(dark.frames, (b"", b"")))
    bright = replace(
        pair, no_flash=pair.no_flash[:] * 20, flash=pair.flash[:] * 20, clipping=np.inf
    )

    found, expected = (mirror_lamps(one, dark.circle, 2, FOCAL_PX) for one in (bright, pair))

    np.testing.assert_allclose(found.colours, expected.colours, rtol=1e-4)


def _bulb_and(pair: Pair, other: tuple[slice, slice], light: float, brightest: float) -> Pair:
    """A bulb of 4 by 4 pixels, and another lamp of so much light on a sphere that is dim else."""
    room = np.full((128, 128, 3), 0.0004, np.float32)
    room[40:44, 40:44] = brightest
    rows, columns = (part.stop - part.start for part in other)
    room[other] = light * 16 * brightest / (rows * columns)
    blurred = np.asarray(cv2.GaussianBlur(room, (0, 0), 0.8), np.float32)
    return replace(pair, no_flash=blurred, flash=blurred, unusable=np.zeros((128, 128), bool))


@pytest.mark.parametrize(
    ("other", "light"),
    [
        (np.s_[70:84, 70:84], 1.0),
        (np.s_[70:74, 70:74], 0.2),
        (np.s_[40:52, 48:60], 1.0),
        (np.s_[70:77, 70:77], 0.2),
    ],
    ids=["a soft box", "a fill lamp", "a soft box close by", "a dim and wide one"],
)
def test_lamps_much_dimmer_than_the_brightest_are_found(
    pair: Pair, other: tuple[slice, slice], light: float
) -> None:
    shown = _bulb_and(pair, other, light, 0.5)
    found = mirror_lamps(shown, Circle(x=64, y=64, radius=60), "auto", FOCAL_PX)
    greens = sorted(found.colours[:, 1] / found.colours[:, 1].max())
    assert greens == pytest.approx(sorted([light, 1.0]), rel=0.12)


def test_what_is_lit_and_gives_a_twentieth_of_the_light_is_no_lamp(pair: Pair) -> None:
    shown = _bulb_and(pair, np.s_[70:77, 70:77], 0.04, 0.5)
    found = mirror_lamps(shown, Circle(x=64, y=64, radius=60), "auto", FOCAL_PX)
    assert len(found.directions) == 1


def test_beside_a_clipped_lamp_a_dim_one_may_be_a_wall(pair: Pair) -> None:
    shown = _bulb_and(pair, np.s_[70:84, 70:84], 1.0, 2.0)
    cut = replace(shown, no_flash=np.minimum(shown.no_flash[:], 1.0))
    found = mirror_lamps(cut, Circle(x=64, y=64, radius=60), "auto", FOCAL_PX)
    assert len(found.directions) == 1
    assert np.isnan(found.colours).all()


def test_a_sphere_without_highlights_is_refused(pair_of: Callable[..., Pair]) -> None:
    matt = photograph_room("matt", 5, LARGE)
    assert matt.circle is not None
    with pytest.raises(UnusablePairError, match="0 highlights of lamps"):
        mirror_lamps(pair_of(Shot(matt.frames, (b"", b""))), matt.circle, "auto", FOCAL_PX)


def test_a_channel_without_light_is_zero(pair: Pair) -> None:
    """However far noise takes it below."""
    red = np.zeros((64, 64, 3), np.float32)
    red[20:24, 30:34] = 0.5, 0.1, -0.02
    dim = replace(pair, no_flash=red, flash=red, unusable=np.zeros((64, 64), bool))
    found = mirror_lamps(dim, Circle(x=32, y=32, radius=30), 1, FOCAL_PX)
    assert found.colours[0] == pytest.approx([1, 0.2, 0])


def test_thousands_of_hot_pixels_take_no_more_memory_than_a_few(pair: Pair) -> None:
    noisy = np.full_like(pair.no_flash[:], 0.01)
    noisy[::4, ::4] = 0.5
    height, width = noisy.shape[:2]
    sphere = Circle(x=width / 2, y=height / 2, radius=0.45 * min(height, width))
    hot = replace(pair, no_flash=noisy, flash=noisy)
    tracemalloc.start()
    try:
        with pytest.raises(UnusablePairError, match="0 highlights of lamps"):
            mirror_lamps(hot, sphere, "auto", FOCAL_PX)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 40 * height * width


def test_highlights_at_the_border_of_the_picture_are_seen_whole(pair: Pair) -> None:
    """Of a sphere that touches it, where a highlight's surroundings are cut off."""
    white = np.zeros((64, 64, 3), np.float32)
    white[30:34, 1:3] = white[1:3, 30:34] = 0.5
    flat = np.zeros((64, 64), bool)
    small = replace(pair, no_flash=white, flash=white, unusable=flat)
    found = mirror_lamps(small, Circle(x=32, y=32, radius=32), 2, FOCAL_PX)
    # both in the same place of the outline but for a quarter of a turn
    one, other = found.directions
    assert one[[0, 2]] == pytest.approx([-other[1], other[2]])
    assert found.colours == pytest.approx(np.full((2, 3), found.colours[0, 0]))


def test_more_lamps_than_it_shows_are_refused(room: Room, pair: Pair) -> None:
    assert room.circle is not None
    with pytest.raises(
        UnusablePairError, match=r"2 highlights of lamps, where 3 were looked for: .* every lamp"
    ):
        mirror_lamps(pair, room.circle, 3, FOCAL_PX)


@pytest.mark.parametrize(
    ("spots", "count", "said"),
    [
        (0, "auto", "0 highlights of lamps, where one to three were looked for: "),
        (0, 1, "0 highlights of lamps, where 1 was looked for: "),
        (1, 2, "1 highlight of a lamp, where 2 were looked for: "),
        (4, "auto", "4 highlights of lamps, where one to three were looked for: "),
    ],
)
def test_the_number_asked_for_is_told(pair: Pair, spots: int, count: Any, said: str) -> None:
    light = np.zeros((64, 64, 3), np.float32)
    for left in range(16, 16 + 8 * spots, 8):
        light[30:34, left : left + 4] = 0.5
    shown = replace(pair, no_flash=light, flash=light, unusable=np.zeros((64, 64), bool))
    with pytest.raises(UnusablePairError, match=f"The sphere shows {said}"):
        mirror_lamps(shown, Circle(x=32, y=32, radius=30), count, FOCAL_PX)


def test_a_tiny_sphere_is_refused(pair: Pair) -> None:
    with pytest.raises(OptionError, match="a radius of only 5 pixels"):
        mirror_lamps(pair, Circle(x=50, y=50, radius=5), "auto", FOCAL_PX)
