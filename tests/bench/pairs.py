"""The pairs that jobs are measured on, made once by the simulated camera and kept."""

from __future__ import annotations

import io
import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

import drivers

_ENLARGED = 2


@dataclass(frozen=True)
class Made:
    """How a pair is made. address: of the simulated camera. enlarged: times, in both axes."""

    address: str
    lights: int
    megapixels: float
    enlarged: int = 1


PAIRS = {
    "jpeg3_n2": Made("sim://studio?lights=2&width=2000&height=1500&format=jpeg", 2, 3),
    "jpeg12_n2": Made("sim://studio?lights=2&width=4000&height=3000&format=jpeg", 2, 12),
    "raw12_n3": Made("sim://studio?lights=3&width=4000&height=3000&scene=objects", 3, 12),
    "raw24_n3": Made("sim://studio?lights=3&width=6000&height=4000", 3, 24),
    "jpeg48_n2": Made(
        "sim://studio?lights=2&width=4000&height=3000&format=jpeg", 2, 48, enlarged=_ENLARGED
    ),
}
"""48 megapixels are twelve, enlarged: the simulated sensor ends at 36."""


def pair_files(name: str) -> tuple[Path, Path]:
    """Files of a pair of PAIRS, photograph without the flash first; made where missing."""
    made = PAIRS[name]
    base = os.environ.get("XDG_CACHE_HOME")
    folder = (Path(base) if base else Path.home() / ".cache") / "lightlayers" / "bench" / name
    suffix = "jpg" if "jpeg" in made.address else "dng"
    paths = folder / f"no_flash.{suffix}", folder / f"flash.{suffix}"
    if not all(path.exists() for path in paths):
        folder.mkdir(parents=True, exist_ok=True)
        with drivers.open_camera(made.address) as camera:
            pair = drivers.capture_pair(camera)
        for path, shot in zip(paths, (pair.no_flash, pair.flash), strict=True):
            content = shot.best if made.enlarged == 1 else _enlarged(shot.best, made.enlarged)
            path.write_bytes(content)
    return paths


def _enlarged(jpeg: bytes, times: int) -> bytes:
    picture = Image.open(io.BytesIO(jpeg))
    pixels = np.asarray(picture.convert("RGB"))
    large = cv2.resize(pixels, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    file = io.BytesIO()
    exif = picture.info.get("exif", b"")
    Image.fromarray(large).save(file, "JPEG", quality=95, subsampling="4:4:4", exif=exif)
    return file.getvalue()
