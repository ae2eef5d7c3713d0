"""What the leanest known route of every stage costs for a pair, without what makes it right.

Decode by libjpeg-turbo or unpacking and edge-aware demosaicing, alignment by one multi-scale ECC
on gradients of a quarter of the size, per-pixel work at five times a copy of its bytes (what C
reached), bytes of the same files written and hashed, imports.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rawpy
import simplejpeg
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from tests.bench.usage import python, run

Codes = NDArray[np.integer[Any]]

_C_OVER_COPY = 5.0
_ALIGN_SCALE = 0.25
_QUALITY = 92
_IMPORTS = "import cv2, numba, numpy, rawpy, tifffile"


def floor(no_flash: Path, flash: Path, lights: int) -> dict[str, float]:
    """CPU seconds by stage."""
    start = time.process_time()
    pictures = [_decoded(path) for path in (no_flash, flash)]
    seconds = {"decode": time.process_time() - start}
    before, after = map(_light, pictures)

    start = time.process_time()
    moved = _aligned(before, after)
    seconds["align"] = time.process_time() - start

    copy = np.copy(moved)  # into memory that is there: strips use the same again and again
    start = time.process_time()
    for _ in range(lights + 1):  # two are read, N + 2 written, by halves
        np.copyto(copy, moved)
    seconds["layers"] = _C_OVER_COPY * (time.process_time() - start)

    codes = np.clip(moved * 255, 0, 255).astype(np.uint8)
    halves = copy.astype(np.float16)
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for i in range(lights + 1):
            _write(Path(folder) / f"{i}.exr", halves.data)
            if i < lights:
                _write(Path(folder) / f"{i}.tif", codes.data)
                _write(Path(folder) / f"{i}.tif.low", codes.data)  # 16 bits
        for i in range(lights + 2):
            jpeg = simplejpeg.encode_jpeg(codes, _QUALITY, "RGB", "444")
            _write(Path(folder) / f"{i}.jpg", memoryview(jpeg))
    seconds["encode"] = time.process_time() - start
    seconds["imports"] = run(python("-c", _IMPORTS)).cpu_s
    return seconds


def _decoded(path: Path) -> Codes:
    """Code values (H, W, 3) of 8 or 16 bits."""
    if path.suffix == ".jpg":
        return np.asarray(simplejpeg.decode_jpeg(path.read_bytes(), "RGB"))
    with rawpy.imread(str(path)) as raw:
        mosaic = np.array(raw.raw_image_visible)  # else it is gone with the file
    return np.asarray(cv2.demosaicing(mosaic, cv2.COLOR_BayerRG2RGB_EA))


def _light(codes: Codes) -> Floats32:
    """Code values as shares of the largest."""
    return np.multiply(codes, np.float32(1 / np.iinfo(codes.dtype).max), dtype=np.float32)


def _aligned(reference: Floats32, sample: Floats32) -> Floats32:
    gradients = []
    for picture in (reference, sample):
        small = cv2.resize(
            picture, None, fx=_ALIGN_SCALE, fy=_ALIGN_SCALE, interpolation=cv2.INTER_AREA
        )
        grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)
        length = cv2.magnitude(cv2.Sobel(grey, -1, 1, 0), cv2.Sobel(grey, -1, 0, 1))
        gradients.append(length / (cv2.blur(length, (31, 31)) + np.float32(1e-4)))
    parameters = cv2.ECCParameters()
    parameters.motionType = cv2.MOTION_HOMOGRAPHY
    start = np.eye(3, dtype=np.float32)
    _, matrix = cv2.findTransformECCMultiScale(gradients[0], gradients[1], start, parameters)
    small_to_full = np.diag([1 / _ALIGN_SCALE, 1 / _ALIGN_SCALE, 1])
    matrix = small_to_full @ matrix @ np.linalg.inv(small_to_full)
    size = sample.shape[1::-1]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(sample, matrix, size, flags=flags))


def _write(path: Path, data: memoryview) -> None:
    path.write_bytes(data)
    hashlib.sha256(data.cast("B")).digest()
