from __future__ import annotations

from pipeline.images.data_window import size_of_window


def test_a_window_holds_its_last_pixel_and_begins_anywhere() -> None:
    assert size_of_window((0, 0), (0, 0)) == (1, 1)
    assert size_of_window((-10, 5), (9, 14)) == (20, 10)
