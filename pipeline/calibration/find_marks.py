"""Marks that were left out: where the chart or sphere of a pair is, and a picture of it."""

from __future__ import annotations

import io
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.calibration.chart_layout import CORNER_NAMES
from pipeline.calibration.find_chart import find_charts
from pipeline.calibration.find_sphere import find_spheres
from pipeline.calibration.options import Corners, Point
from pipeline.errors import MarkError
from pipeline.images.area_means import area_means, size_within
from pipeline.options import Circle
from pipeline.pair.pair import Pair

MARKS = "marks.jpg"
"""The file that shows what was read."""

_LONG_SIDE = 1600  # pixels of the picture with the marks
_COLOUR = (255, 0, 200)  # RGB that few scenes hold


def find_chart(pair: Pair) -> Corners:
    """Find the one ColorChecker. Raises MarkError where there is none, or more than one."""
    found = find_charts(np.maximum(pair.flash_part(), 0))
    if not found:  # where the flash does not reach it, reading it says so
        found = find_charts(np.maximum(pair.no_flash, 0))
    _check_one(
        len(found),
        "ColorChecker",
        "all 24 patches must be in the picture, evenly lit by the flash, not clipped and not "
        "covered",
        "the option chart, the middles of its outer patches; a grey card needs card, a circle "
        "on it",
    )
    a, b, c, d = ((float(x), float(y)) for x, y in found[0].corners)
    return (a, b, c, d)


def find_sphere(pair: Pair, mirror: bool, focal_px: float) -> Circle:
    """Find the outline of the one sphere; focal_px: focal length in pixels.

    Raises MarkError, OptionError for a sphere too near to the camera.
    """
    found = find_spheres(pair.no_flash[:], pair.flash_part(), mirror, focal_px)
    kind = "mirror sphere" if mirror else "matt grey sphere"
    advice = "all of it must be in the picture, lit by a flash at the camera"
    _check_one(len(found), kind, advice, "the option sphere, its outline")
    return found[0]


def draw_marks(pair: Pair, corners: Sequence[Point] | None, circle: Circle | None) -> bytes:
    """Draw marks into the photograph with the flash, a JPEG for people to check."""
    height, width = pair.unusable.shape
    size = size_within((width, height), _LONG_SIDE)
    scale = size[0] / width
    light = area_means(pair.flash, size)
    high = np.maximum(np.quantile(light.reshape(-1, 3), 0.99, axis=0), 1e-9)
    screen = (np.clip(light / high, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    thick = max(1, round(max(size) / 600))
    if corners is not None:
        places = np.round(np.array(corners) * scale).astype(np.int32)
        cv2.polylines(screen, [places], True, _COLOUR, thick, cv2.LINE_AA)
        middle_y = places[:, 1].mean()
        for (x, y), name in zip(places.tolist(), CORNER_NAMES, strict=True):
            cv2.circle(screen, (x, y), 3 * thick, _COLOUR, thick, cv2.LINE_AA)
            _name_corner(screen, name, (x, y), -1 if y < middle_y else 1, thick)
    if circle is not None:
        middle = (round(circle.x * scale), round(circle.y * scale))
        cv2.circle(screen, middle, round(circle.radius * scale), _COLOUR, thick, cv2.LINE_AA)
        cv2.drawMarker(screen, middle, _COLOUR, cv2.MARKER_CROSS, 10 * thick, thick)
    file = io.BytesIO()
    PillowImage.fromarray(screen).save(file, "JPEG", quality=90)
    return file.getvalue()


def _check_one(count: int, what: str, advice: str, mark: str) -> None:
    if count == 0:
        raise MarkError(f"No {what} was found: {advice}. If it is there, give {mark}.")
    if count > 1:
        raise MarkError(
            f"{count} things look like a {what}: leave one in the picture, or give {mark}."
        )


def _name_corner(
    screen: NDArray[np.uint8], name: str, at: tuple[int, int], side: int, thick: int
) -> None:
    """Write a name over (side -1) or under (1) a corner, off the chart's lines, in the picture."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.4 * thick
    (length, tall), below = cv2.getTextSize(name, font, size, thick)
    height, width = screen.shape[:2]
    x = max(min(at[0] - length // 2, width - length - thick), thick)
    y = at[1] + side * 5 * thick + (tall if side > 0 else -below)
    y = max(min(y, height - below - thick), tall + thick)
    cv2.putText(screen, name, (x, y), font, size, _COLOUR, thick)
