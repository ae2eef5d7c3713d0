"""Compile what jobs run, once, where the service is installed: python -m service.compile.

Numba keeps what it compiles beside the source, or in NUMBA_CACHE_DIR, and tables of colour-science
are kept there, too. Without this the first jobs after an installation would pay for it.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import drivers
from pipeline.compiling import CACHE
from pipeline.images.strips import STRIP_ROWS
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress

_SIZE = "width=96&height=64&noise=off"
_MOTION_PX = 3  # enough for the flash photograph to be laid on the other


def main() -> None:
    """Separate tiny pairs of the simulated camera in every way that compiled code takes."""
    if CACHE.unwritable:
        sys.exit(f"{CACHE.unwritable} cannot be written, so that nothing compiled would be kept.")
    for count in (1, 2, 3):
        for rows in (24, STRIP_ROWS):  # one strip alone lies otherwise in memory than several
            _separate(f"sim://studio?lights={count}&{_SIZE}", {"lights": count}, rows)
        _separate_moved(f"sim://studio?lights={count}&format=jpeg&{_SIZE}", {"lights": count})
    objects = f"sim://studio?scene=objects&lights=3&{_SIZE}"
    truth = drivers.simulated_truth(objects)
    lights = [{"direction": tuple(one)} for one in truth.directions.tolist()]
    _separate(objects, {"lights": 3, "light_directions": lights}, STRIP_ROWS)


def _separate(address: str, options: dict[str, Any], strip_rows: int) -> None:
    with drivers.open_camera(address) as camera, tempfile.TemporaryDirectory() as folder:
        pair = drivers.capture_pair(camera)
        files = pair.no_flash.best, pair.flash.best
        separate_files(*files, Options(**options), Path(folder), Progress(), strip_rows)


def _separate_moved(address: str, options: dict[str, Any]) -> None:
    """Separate a pair whose flash photograph was taken from a little beside."""
    with drivers.open_camera(address) as camera, tempfile.TemporaryDirectory() as folder:
        pair = drivers.capture_pair(camera)
        flash = np.asarray(cv2.imdecode(np.frombuffer(pair.flash.best, np.uint8), cv2.IMREAD_COLOR))
        moved = cv2.imencode(".png", np.roll(flash, _MOTION_PX, axis=1))[1].tobytes()
        separate_files(pair.no_flash.best, moved, Options(**options), Path(folder), Progress())


if __name__ == "__main__":
    main()
