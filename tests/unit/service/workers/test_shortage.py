from __future__ import annotations

import errno

import cv2
import numpy as np
import pytest

from service.workers.shortage import wants_memory


@pytest.mark.parametrize("error", [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory")])
def test_want_of_memory_is_known(error: Exception) -> None:
    assert wants_memory(error)


@pytest.mark.parametrize("error", [ValueError("memory"), OSError(errno.ENOSPC, "No space left")])
def test_other_errors_are_none(error: Exception) -> None:
    assert not wants_memory(error)


@pytest.mark.parametrize(("pixels", "wanting"), [(2**30, True), (-5, False)])
def test_of_opencv_want_of_memory_alone_is(pixels: int, wanting: bool) -> None:
    with pytest.raises(cv2.error) as caught:
        cv2.copyMakeBorder(np.zeros((1, 1), np.uint8), 0, pixels, 0, pixels, cv2.BORDER_CONSTANT)
    assert wants_memory(caught.value) is wanting
