"""Memory of pictures that can be given back before the picture ends."""

from __future__ import annotations

import contextlib
import ctypes
import math
import mmap
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32

_Scalar = TypeVar("_Scalar", bound=np.generic)

_malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)


def empty_image(*shape: int) -> Floats32:
    """Make a float32 array (H, …) whose rows release_rows can give back. Raises MemoryError."""
    return _empty(shape, np.dtype(np.float32))


def empty_codes(shape: tuple[int, ...], kind: type[_Scalar]) -> NDArray[_Scalar]:
    """Make such an array of code values of that type. Raises MemoryError."""
    return _empty(shape, np.dtype(kind))


def releasable(values: NDArray[_Scalar]) -> NDArray[_Scalar]:
    """Return an array (H, …) whose rows release_rows can give back: this one or a copy.

    Raises MemoryError.
    """
    if isinstance(values.base, mmap.mmap):
        return values
    copy: NDArray[_Scalar] = _empty(values.shape, values.dtype)
    copy[...] = values
    return copy


def release_rows(image: NDArray[Any], stop: int) -> None:
    """Give the memory of the rows before `stop` back; they are 0 from then on, at the latest.

    Arrays that were made elsewhere stay as they are.
    """
    if isinstance(image.base, mmap.mmap):
        whole_pages = max(stop, 0) * image.strides[0] // mmap.PAGESIZE * mmap.PAGESIZE
        if whole_pages:
            image.base.madvise(mmap.MADV_DONTNEED, 0, whole_pages)


def trim_memory() -> None:
    """Give freed memory that glibc's allocator holds on to back; nothing where there is another."""
    if _malloc_trim is not None:
        _malloc_trim(0)


def _empty(shape: tuple[int, ...], kind: np.dtype[Any]) -> NDArray[Any]:
    size = max(math.prod(shape), 1) * kind.itemsize
    try:
        memory = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError from error
    with contextlib.suppress(OSError):  # a kernel may have no huge pages
        memory.madvise(mmap.MADV_HUGEPAGE)
    return np.ndarray(shape, kind, memory)
