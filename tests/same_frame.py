"""Files that hold the same photograph."""

from __future__ import annotations

import numpy as np

from pipeline.decode import decode, read_header


def assert_same(data: bytes, twin: bytes) -> None:
    """Fail where two files are read otherwise, or hold hardly more than one value."""
    assert read_header(data) == read_header(twin)
    frame, expected = decode(data), decode(twin)
    np.testing.assert_array_equal(frame.pixels[:], expected.pixels[:])
    np.testing.assert_array_equal(frame.saturated, expected.saturated)
    np.testing.assert_array_equal(frame.xyz_to_camera, expected.xyz_to_camera)
    assert (frame.make, frame.exposure) == (expected.make, expected.exposure)
    assert frame.pixels[:].std() > 0.1
