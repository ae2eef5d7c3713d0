"""From a pair of photographs to the light of every lamp. Arrays and files; no HTTP, no queue.

What is named here is imported when it is asked for, so that who needs the options alone, like the
API, is spared the rest.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.options import Options
    from pipeline.pair.pair_checks import check_pair
    from pipeline.process import separate_files
    from pipeline.progress import Progress

__all__ = ["Options", "Progress", "check_pair", "separate_files"]

_PLACES = {
    "Options": "pipeline.options",
    "Progress": "pipeline.progress",
    "check_pair": "pipeline.pair.pair_checks",
    "separate_files": "pipeline.process",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)
