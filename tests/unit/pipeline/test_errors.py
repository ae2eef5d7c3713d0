from __future__ import annotations

import errno
import os

from pipeline.errors import reason_of


def test_the_reason_is_the_systems_in_small_letters() -> None:
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "results/lamp1.tif")
    assert reason_of(full) == "no space left on device"
    assert reason_of(OSError("a driver's own words")) == "unknown reason"
