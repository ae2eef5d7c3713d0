from __future__ import annotations

from tests.bench.page import row


def test_pixels_are_told_in_millions_and_frames_by_the_second() -> None:
    told = row("processor", 2, (1920, 1080), (2_073_600, 518_400), 238, (4.0, 1.19))
    assert told == "| processor | 2 | 1920 × 1080 | 2.07 | 0.52 | 60 | 5 |"
