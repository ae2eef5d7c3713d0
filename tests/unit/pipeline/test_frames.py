from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.frames import Exposure, Frame


def test_relative_exposure_is_time_times_speed_over_square_of_f_number() -> None:
    assert Exposure(time_s=0.5, iso=400, f_number=2).relative == pytest.approx(50)


@pytest.mark.parametrize(
    "exposure",
    [
        Exposure(),
        Exposure(iso=100, f_number=2),
        Exposure(time_s=0.1, f_number=2),
        Exposure(time_s=0.1, iso=100),
        Exposure(time_s=0.0, iso=100, f_number=2),
        Exposure(time_s=0.1, iso=0.0, f_number=2),
        Exposure(time_s=0.1, iso=100, f_number=0.0),
    ],
)
def test_an_exposure_with_a_part_unknown_is_unknown(exposure: Exposure) -> None:
    assert exposure.relative is None


def test_size_is_width_and_height(frame: Callable[..., Frame]) -> None:
    assert frame(np.zeros((20, 30, 3))).size == (30, 20)


def test_facts_are_the_frame_without_the_memory_of_its_pixels(
    frame: Callable[..., Frame],
) -> None:
    given = frame(np.full((20, 30, 3), 0.5), make="Nikon")

    facts = given.facts()

    assert (facts.size, facts.make, facts.sha256) == ((30, 20), "Nikon", given.sha256)
    assert facts.pixels.base is not given.pixels
    assert facts.pixels.strides == (0, 0, 0)
    assert facts.saturated.strides == (0, 0)
