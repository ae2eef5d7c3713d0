"""Want of memory, known and told alike by jobs and by the command line."""

from __future__ import annotations

import errno

TOO_LITTLE_MEMORY = "The photographs need more memory than there is for them; send smaller ones."

_CV_NO_MEMORY = -4  # cv::Error::StsNoMem


def wants_memory(error: Exception) -> bool:
    """Tell whether an error of Python, the system or OpenCV says that memory is short.

    To be asked while it is handled: OpenCV has the code of its latest error alone.
    """
    return (
        isinstance(error, MemoryError)
        or getattr(error, "errno", None) == errno.ENOMEM
        or getattr(error, "code", None) == _CV_NO_MEMORY
    )
