from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.images.frames import Frame
from pipeline.photometric_stereo.focal import focal_length_px
from pipeline.run_warnings import Code


@pytest.mark.parametrize(
    ("given", "in_file", "found"), [(700.0, 900.0, 700.0), (None, 900.0, 900.0)]
)
def test_what_is_given_comes_before_what_the_file_says(
    frame: Callable[..., Frame], given: float | None, in_file: float, found: float
) -> None:
    taken = frame(np.zeros((20, 30, 3)), focal_px=in_file)
    assert focal_length_px(taken, given) == (found, [])


def test_else_a_normal_lens_is_taken_and_warned_of(frame: Callable[..., Frame]) -> None:
    focal_px, warnings = focal_length_px(frame(np.zeros((36, 24, 3))), None)
    assert focal_px == pytest.approx(50)
    assert [one.code for one in warnings] == [Code.FOCAL_LENGTH_ASSUMED]
    assert warnings[0].figures["focal_px"] == pytest.approx(50)
