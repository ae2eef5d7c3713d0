"""Where the patches of a ColorChecker are, and what light they show."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.calibration.chart_layout import (
    CORNER_NAMES,
    CORNERS,
    PLACES,
    colour_misfit,
    tint_misfit,
)
from pipeline.calibration.evenness import check_even
from pipeline.calibration.lamps_and_flash import mean_light
from pipeline.calibration.marks import disc
from pipeline.calibration.options import Point
from pipeline.calibration.patches import Patches
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.frames import Mask
from pipeline.options import Circle
from pipeline.pair.pair import Pair
from pipeline.spectra.colorchecker import COLUMNS, ROWS, colorchecker_spectra

_HALF_SIDE = 0.25  # of the distance of two patches' middles; a patch has 0.46
_NO_CHART = 0.3  # relative error of any 3 × 3 matrix from XYZ to what was read
_TINTS = 0.35  # error of their tints, by the spread of these: beyond, they are other patches
_FINER = 4  # bits of a pixel that OpenCV draws with


def read_chart(pair: Pair, corners: Sequence[Point]) -> Patches:
    """Read the flash's light on the 24 patches.

    corners: middles (x, y) of the outer patches dark skin, bluish green, black and white, in
    pixels of the pair. Raises OptionError where the corners are outside or in another order,
    UnusablePairError where patches are clipped, or the flash leaves some in the dark.
    """
    height, width = pair.unusable.shape
    quad = np.array(corners, np.float32)
    _check_corners(quad, width, height)
    lights = []
    to_picture = np.asarray(
        cv2.getPerspectiveTransform(CORNERS.astype(np.float32), quad), np.float64
    )
    for number, (column, row) in enumerate(PLACES):
        what = f"patch {number + 1} of the chart"
        lights.append(mean_light(pair, _patch(to_picture, column, row, (height, width)), what))
    flash = np.array([light.flash for light in lights])
    _check_order(flash)
    middle = np.array([COLUMNS - 1, ROWS - 1]) / 2
    return Patches(
        flash=flash,
        variance=np.array([light.flash_variance for light in lights]),
        reflectances=colorchecker_spectra(),
        places=(PLACES - middle) / middle[0],
    )


def read_card(pair: Pair, circle: Circle) -> Patches:
    """Read the flash's light on a grey card, as a single patch.

    Raises OptionError for a circle outside, or around more than one even surface,
    UnusablePairError where it is clipped or unlit.
    """
    mask = disc(pair.unusable.shape, circle, "grey card")
    light = mean_light(pair, mask, "the grey card")
    check_even(pair, mask)
    flat = np.ones((1, colorchecker_spectra().shape[1]))
    return Patches(light.flash[None], light.flash_variance[None], flat, np.zeros((1, 2)))


def _check_corners(quad: Floats32, width: int, height: int) -> None:
    if not ((quad >= 0).all() and (quad <= (width, height)).all()):
        raise OptionError(
            f"The corners of the chart are not all inside the photograph of {width} × {height} "
            "pixels: check their coordinates."
        )
    if not cv2.isContourConvex(quad):
        raise OptionError(
            "The corners of the chart cross each other: mark the middles of dark skin, bluish "
            "green, black and white, one after the other around the chart."
        )


def _patch(to_picture: Floats64, column: float, row: float, shape: tuple[int, int]) -> Mask:
    """Pixels of the inner half of a patch."""
    around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * _HALF_SIDE + (column, row)
    corners = cv2.perspectiveTransform(around[None].astype(np.float64), to_picture)[0]
    mask = np.zeros(shape, np.uint8)
    fixed = np.round((corners - 0.5) * 2**_FINER).astype(np.int32)
    cv2.fillConvexPoly(mask, fixed, 1, shift=_FINER)
    return np.asarray(mask.astype(bool))


def _check_order(flash: Floats64) -> None:
    """Raise OptionError unless the corners in this order explain the colours best.

    UnusablePairError where they would under an even flash.
    """
    numbers = np.arange(ROWS * COLUMNS).reshape(ROWS, COLUMNS)
    orders = {
        (0, 1, 2, 3): numbers,
        (2, 3, 0, 1): numbers[::-1, ::-1],
        (1, 0, 3, 2): numbers[:, ::-1],
        (3, 2, 1, 0): numbers[::-1],
    }
    misfits = {corners: colour_misfit(flash[order.ravel()]) for corners, order in orders.items()}
    best = min(misfits, key=lambda corners: misfits[corners])
    if misfits[best] > _NO_CHART and tint_misfit(flash) < _TINTS:
        raise UnusablePairError(
            "The patches have the tints of a ColorChecker, but not its brightness: keep shadows "
            "off the chart, and check that the corners are the middles of its outer patches."
        )
    if misfits[best] > _NO_CHART:
        raise OptionError(
            "What the corners enclose does not look like a ColorChecker of 24 patches: mark the "
            "middles of dark skin, bluish green, black and white, in this order."
        )
    if best != (0, 1, 2, 3):
        places = ", ".join(f"{CORNER_NAMES[place]}'s" for place in best)
        raise OptionError(
            "The chart is turned or mirrored: the corners should be dark skin, bluish green, "
            f"black and white, and what was given looks like {places}."
        )
