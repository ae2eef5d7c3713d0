from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from pipeline.calibration.marks import disc, on_screen
from pipeline.errors import OptionError
from pipeline.options import Circle


def test_a_disc_holds_the_pixels_whose_middles_are_within() -> None:
    mask = disc((8, 10), Circle(x=4, y=3, radius=1), "sphere")
    assert np.argwhere(mask).tolist() == [[2, 3], [2, 4], [3, 3], [3, 4]]


@pytest.mark.parametrize(
    ("x", "y", "radius"),
    [
        (5, 4, 4),
        (4, 4, 4),
        (6, 4, 4),
        (5.3, 3.9, 2.71),
        (9.5, 7.5, 0.5),
        (0.4, 0.4, 0.4),
        (3, 3, 2),
    ],
)
def test_a_disc_is_cut_off_nowhere(x: float, y: float, radius: float) -> None:
    v, u = np.indices((8, 10)) + 0.5
    mask = disc((8, 10), Circle(x=x, y=y, radius=radius), "sphere")
    assert mask.tolist() == (np.hypot(u - x, v - y) <= radius).tolist()


def test_a_disc_takes_no_more_memory_than_its_mask() -> None:
    shape = (4000, 6000)
    tracemalloc.start()
    try:
        mask = disc(shape, Circle(x=3000, y=2000, radius=50), "sphere")
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1.1 * mask.nbytes


@pytest.mark.parametrize(("x", "y"), [(1.5, 4), (8.5, 4), (5, 1.5), (5, 6.5)])
def test_a_circle_outside_is_refused(x: float, y: float) -> None:
    with pytest.raises(OptionError, match="circle of the grey card is not wholly inside"):
        disc((8, 10), Circle(x=x, y=y, radius=2), "grey card")


def test_each_channel_fills_8_bits_whatever_the_light() -> None:
    light = np.linspace(0, 1, 300).reshape(10, 10, 3) * (0.01, 1, 30)

    assert on_screen(light).max(axis=(0, 1)).tolist() == [255, 255, 255]
    assert not on_screen(-light).any()
