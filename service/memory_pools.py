"""The memory of a process with many threads, which keeps what each of them once needed."""

from __future__ import annotations

import ctypes

_M_ARENA_MAX = -8


def share_memory(pools: int) -> None:
    """Have the threads of this process take their memory from so many pools (glibc).

    By itself it makes up to eight for each processor, and each keeps what its threads once needed.
    To be called before the first thread; without glibc it does nothing.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_ARENA_MAX, pools)
