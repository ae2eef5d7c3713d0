"""Compile what jobs run, once, where the service is installed: python -m service.compile.

Numba keeps what it compiles beside the source, or in NUMBA_CACHE_DIR, and tables of colour-science
are kept there, too. Without this the first jobs after an installation would pay for it.
"""

from __future__ import annotations

import gc
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import drivers
from pipeline.compiling import CACHE
from pipeline.images.area_strips import AreaStrips
from pipeline.options import Options
from pipeline.pair.one_surface import Neighbours
from pipeline.pair.tone_curve import NO_CONTRAST
from pipeline.photometric_stereo.detail import surface_normals
from pipeline.photometric_stereo.solve import Surface
from pipeline.pictures.clipped import shown_layers
from pipeline.process import separate_files
from pipeline.progress import Progress
from pipeline.separation.fill_alike import fill_alike
from pipeline.separation.separation import Strip

_SIZE = "width=96&height=64&noise=off"
_GARBAGE = 100_000  # objects between collections, which take a good part of the compiler's time
_MOTION_PX = 3  # enough for the flash photograph to be laid on the other


def main() -> None:
    """Separate tiny pairs of the simulated camera, and call the loops that these do not reach."""
    if CACHE.unwritable:
        sys.exit(f"{CACHE.unwritable} cannot be written, so that nothing compiled would be kept.")
    gc.set_threshold(_GARBAGE)
    _separate(f"sim://studio?lights=1&{_SIZE}", {"lights": 1})
    for count in (2, 3):
        _separate_moved(f"sim://studio?lights={count}&format=jpeg&{_SIZE}", {"lights": count})
    _call_others()


def _call_others() -> None:
    """Call what clipped light, curves and balances, a smaller picture, gaps and normals take."""
    side = 4
    image = np.ones((side, side, 3), np.float32)
    for count in (1, 2, 3):
        shown_layers(np.stack(count * [image]), np.ones((count, 3)), 1.0)
    AreaStrips((side, side), (side // 2, side // 2)).add(image)
    NO_CONTRAST.photograph(image)
    numbers = np.zeros((2, side), int)
    neighbours = Neighbours(np.ones((4, side, 3)), 1.0, numbers, np.zeros((2, side)))
    neighbours.through(NO_CONTRAST).height(np.zeros(2), (0.1, 0.2))
    fill_alike(image, image, np.zeros((side, side), np.float32), image, image)
    rows, lamps = slice(0, side), np.eye(3)
    ones, known = np.ones((side, side, 3)), np.ones((side, side), bool)
    surface = Surface(
        block=2,
        mask=known,
        cut=~known,
        w=ones,
        z=ones[..., 0],
        lit=ones,
        deviations=np.zeros((side, side, 3, 3)),
        correction=ones,
        directions=lamps,
        matrices=np.stack(3 * [lamps]),
        misfit=0.0,
        unexplained=0.0,
        strengths=np.ones(3),
        turned_deg=0.0,
        focal_px=1.0,
    )
    strip = Strip(rows, image[None], image, image, image[..., 0])
    surface_normals(strip, surface)


def _separate(address: str, options: dict[str, Any]) -> None:
    with drivers.open_camera(address) as camera, tempfile.TemporaryDirectory() as folder:
        pair = drivers.capture_pair(camera)
        files = pair.no_flash.best, pair.flash.best
        separate_files(*files, Options(**options), Path(folder), Progress())


def _separate_moved(address: str, options: dict[str, Any]) -> None:
    """Separate a pair whose flash photograph was taken from a little beside."""
    with drivers.open_camera(address) as camera, tempfile.TemporaryDirectory() as folder:
        pair = drivers.capture_pair(camera)
        flash = np.asarray(cv2.imdecode(np.frombuffer(pair.flash.best, np.uint8), cv2.IMREAD_COLOR))
        moved = cv2.imencode(".png", np.roll(flash, _MOTION_PX, axis=1))[1].tobytes()
        separate_files(pair.no_flash.best, moved, Options(**options), Path(folder), Progress())


if __name__ == "__main__":
    main()
