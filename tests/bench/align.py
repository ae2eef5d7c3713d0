"""Alignment beside align_image_stack of Hugin, where that is installed: CPU and error."""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from statistics import median

import cv2
import numpy as np
import simplejpeg
import tifffile
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.pair.align import estimate_alignment
from tests.bench.pairs import pair_files
from tests.bench.usage import run

HUGIN = "align_image_stack"
_MOTIONS = ((18.0, -11.0, 0.3), (-30.0, 14.0, -0.5), (9.0, 27.0, 0.15))  # px, px, degrees
_FIELD_DEG = 50.0  # across: what align_image_stack takes where a file does not say
_RUNS = 5  # of ours: the first one after another program's takes up to twice as long


def measure(pair: str) -> dict[str, float | None]:
    """Errors in pixels at the corners, median over known motions, and Hugin's CPU over ours.

    Ours is the median of a few runs.
    """
    no_flash, flash = (
        simplejpeg.decode_jpeg(path.read_bytes(), "RGB") for path in pair_files(pair)
    )
    height, width = no_flash.shape[:2]
    ours, seconds, theirs, ratios = [], [], [], []
    for x, y, degrees in _MOTIONS:
        true = _turned(x, y, degrees, width, height)
        moved = _warped(flash, true)
        linear = [np.square(one.astype(np.float32) / 255) for one in (no_flash, moved)]
        taken = []
        for _ in range(_RUNS):
            start = time.process_time()
            found = estimate_alignment(*linear)
            taken.append(time.process_time() - start)
        seconds.append(median(taken))
        ours.append(_corner_error(found.matrix, true, width, height))
        if shutil.which(HUGIN):
            cpu, matrix = _by_hugin(no_flash, moved)
            ratios.append(cpu / seconds[-1])
            if matrix is not None:
                theirs.append(_corner_error(matrix, true, width, height))
    return {
        "cpu_s": median(seconds),
        "error_px": median(ours),
        "hugin_cpu_ratio": median(ratios) if ratios else None,
        "hugin_error_px": median(theirs) if theirs else None,
    }


def _turned(x: float, y: float, degrees: float, width: int, height: int) -> Floats64:
    """Homography of a hand that turns: the middle moves by about x, y pixels, the picture rolls.

    Hugin knows turns of a camera alone, and no picture that merely shifts is one.
    """
    focal = width / 2 / np.tan(np.radians(_FIELD_DEG / 2))
    camera = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    turn, _ = cv2.Rodrigues(np.array([-y / focal, x / focal, np.radians(-degrees)]))
    return np.asarray(camera @ turn @ np.linalg.inv(camera), dtype=np.float64)


def _warped(picture: NDArray[np.uint8], matrix: Floats64) -> NDArray[np.uint8]:
    size = picture.shape[1], picture.shape[0]
    warped = cv2.warpPerspective(
        picture, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(warped, dtype=np.uint8)


def _corner_error(found: Floats64, true: Floats64, width: int, height: int) -> float:
    corners = np.array([[[0, 0], [width, 0], [0, height], [width, height]]], dtype=np.float64)
    off = cv2.perspectiveTransform(corners, found) - cv2.perspectiveTransform(corners, true)
    return float(np.linalg.norm(off, axis=2).mean())


def _by_hugin(
    no_flash: NDArray[np.uint8], moved: NDArray[np.uint8]
) -> tuple[float, Floats64 | None]:
    """CPU seconds, and the homography by what it makes of a picture of coordinates."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{name}.tif" for name in ("a", "b")]
        for path, picture in zip(paths, (no_flash, moved), strict=True):
            tifffile.imwrite(path, picture, photometric="rgb")
        used = run([HUGIN, "-a", f"{folder}/out", "-p", f"{folder}/p.pto", *map(str, paths)])
        aligned = [tifffile.imread(Path(folder) / f"out000{i}.tif")[..., :3] for i in (0, 1)]
        return used.cpu_s, _laid_on(moved, aligned[1], no_flash, aligned[0])


def _laid_on(*pictures: NDArray[np.uint8]) -> Floats64 | None:
    """Homography from the first photograph's pixels to the second's, by features of the results."""
    moved, moved_aligned, reference, reference_aligned = pictures
    to_moved = _features(moved_aligned, moved)
    to_reference = _features(reference, reference_aligned)
    return None if to_moved is None or to_reference is None else to_moved @ to_reference


def _features(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> Floats64 | None:
    """Homography from pixels of a to those of b, two renderings of one photograph."""
    sift = cv2.SIFT.create(4000)
    (first, of_first), (second, of_second) = (
        sift.detectAndCompute(cv2.cvtColor(one, cv2.COLOR_RGB2GRAY), None) for one in (a, b)
    )
    pairs = cv2.BFMatcher(crossCheck=True).match(of_first, of_second)
    source = np.array([first[p.queryIdx].pt for p in pairs])
    target = np.array([second[p.trainIdx].pt for p in pairs])
    found, _ = cv2.findHomography(source, target, cv2.RANSAC, 0.5)
    return None if found is None else np.asarray(found, dtype=np.float64)
