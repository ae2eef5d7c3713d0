from __future__ import annotations

import errno
import mmap
from pathlib import Path

import numpy as np
import pytest

from pipeline.images.memory import empty_codes, empty_image, releasable, release_rows, trim_memory


def test_rows_that_are_given_back_are_black_and_the_others_stay() -> None:
    image = empty_image(300, 50, 3)
    image[:] = 0.5

    release_rows(image, 200)

    row = mmap.PAGESIZE // image.strides[0] + 1
    assert not image[: 200 - row].any()
    assert (image[200:] == 0.5).all()


@pytest.mark.parametrize("stop", [-64, 0])
def test_no_row_is_given_back_before_the_first(stop: int) -> None:
    image = empty_image(300, 50, 3)
    image[:] = 0.5

    release_rows(image, stop)

    assert (image == 0.5).all()


def test_images_of_other_memory_stay_as_they_are() -> None:
    image = np.full((300, 50, 3), 0.5, np.float32)

    release_rows(image, 200)

    assert (image == 0.5).all()


def test_a_kernel_without_huge_pages_gives_memory_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Refusing(mmap.mmap):
        def madvise(self, option: int, *place: int) -> None:
            if option == mmap.MADV_HUGEPAGE:
                raise OSError(errno.EINVAL, "Invalid argument")
            super().madvise(option, *place)

    monkeypatch.setattr("pipeline.images.memory.mmap.mmap", Refusing)

    assert empty_image(3, 2, 3).shape == (3, 2, 3)


def test_an_image_that_memory_cannot_hold_is_a_memory_error() -> None:
    with pytest.raises(MemoryError):
        empty_image(2**20, 2**24, 3)


def test_freed_memory_is_given_back() -> None:
    """Arrays too small for maps of their own, under one that stays."""
    freed = [np.ones(2**12) for _ in range(4000)]
    stays = np.ones(2**12)
    del freed
    before = resident_mib()

    trim_memory()

    assert before - resident_mib() > 60
    assert stays.all()


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * mmap.PAGESIZE / 2**20


def test_a_copy_can_be_given_back_and_the_original_stays() -> None:
    codes = np.full((300, 50, 3), 7, np.uint8)
    turned = codes.swapaxes(0, 1)

    copy = releasable(turned)
    assert copy.dtype == np.uint8
    np.testing.assert_array_equal(copy, turned)
    release_rows(copy, 50)

    assert not copy[:40].any() and codes.all()


def test_rows_that_can_be_given_back_are_not_copied() -> None:
    codes = empty_codes((300, 50, 3), np.uint8)
    codes[:] = 7

    assert releasable(codes) is codes
    turned = releasable(codes[:, ::-1])
    release_rows(turned, 300)

    assert (codes == 7).all()
