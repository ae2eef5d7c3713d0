"""Helpers of all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import NoReturn

import pytest

# before numpy loads: its threads wait for each other where other programs keep the processors busy,
# and small matrices then take twenty times as long
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def lacking() -> Callable[[str], NoReturn]:
    """End a test that needs a program this machine lacks; continuous integration lacks nothing."""

    def end(program: str) -> NoReturn:
        reason = f"{program} is not installed"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)

    return end
