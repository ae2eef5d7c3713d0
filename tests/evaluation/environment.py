"""The environment that workers measure in, the same wherever they run."""

from __future__ import annotations

import os


def settle(own_spectra: bool = False) -> None:
    """Set what the processes that are started from here on inherit.

    own_spectra: whether to leave them the folder of spectra that LIGHTLAYERS_SPECTRA names; a
    pipeline that knows more cameras finds other lamps.
    """
    # before a worker loads numpy: its threads would wait for each other
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    if not own_spectra:
        os.environ.pop("LIGHTLAYERS_SPECTRA", None)
