"""Places where the flash part holds light of the lamps, for their shadows moved.

On one surface the flash's light has one colour. Where the flash part's colour steps, another
surface begins, and the photograph without the flash steps alike. Where that one does not, a shadow
of the lamps fell elsewhere when the flash fired.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from cv2.typing import MatLike

from pipeline.arrays import Floats, Floats32
from pipeline.images.blocks import sums_of_blocks
from pipeline.images.disc import disc
from pipeline.images.frames import Image, Mask, Plane
from pipeline.pair.reduced import ReducedPair
from pipeline.run_warnings import Code, RunWarning

# Chosen on development scenes (docs/trials/moved_shadows.md)
_LONG_SIDE = 256  # blocks, at which steps are looked for
_BLUR = 1.5  # blocks
_STEP = 0.02  # natural logarithm of colour from block to block; fainter steps tell nothing
_SIGNIFICANT = 4.0  # standard deviations
_GRADIENT_NOISE = 0.027  # variance of a gradient after the blur, relative to a block's
_UNLIKE = 0.8  # of a step of the flash part, by which the other photograph's differs from it
_SPECK = 12  # blocks; fewer are chance
_REACH = 40.0  # blocks beside a step, of which it tells
_APART, _FAR_APART = 0.1, 0.2  # natural logarithm of colour, from most of the picture's
_RIM, _FAR_RIM = 5, 2  # blocks beside what is apart
_LEAST_LEFT = 1 / 3  # of the usable blocks; else there are no surfaces to tell by
_NOTABLE = 0.05  # share; still pairs have up to .046
_CORNERS = 0.03  # share; so much may lie where rims of paint and of still shadows meet


@dataclass(frozen=True)
class MovedShadows:
    """What find_moved_shadows finds.

    places: bool (h, w), the blocks that lamps are not to be told by. surely: (h, w), those among
    them that a moved shadow lies in, whose layers no flash part tells; none where these are so few
    that none need be one. share: of the usable blocks, 0…1, as many are so without those beside.
    """

    places: Mask
    surely: Mask
    share: float


def find_moved_shadows(reduced: ReducedPair, something_moved: bool) -> MovedShadows | None:
    """Find what lies at or between steps of colour that only the flash part has.

    something_moved: whether the photographs show other things; else there must be much of it. None
    where no shadow moved, or where too little else would be left to tell lamps by; and for
    photographs that a camera rendered, whose curve makes steps of its own, or a flash part that was
    given alone.
    """
    if reduced.rendered or reduced.flash_only:
        return None
    usable = reduced.usable
    side = -(-max(usable.shape) // _LONG_SIDE)
    open_blocks = usable[..., None].astype(np.float64)
    count = sums_of_blocks(open_blocks, side)
    known = count[..., 0] > side**2 / 2
    if not known.any():
        return None
    count = np.maximum(count, 1.0)
    no_flash, flash, variance = (
        sums_of_blocks(image * open_blocks, side) / count
        for image in (reduced.no_flash, reduced.flash, reduced.flash_variance)
    )
    steps = _unlike_steps(no_flash, flash, variance / count, known)
    colour = np.stack([_integrated(steps[:, :, band]) for band in range(steps.shape[2])], axis=-1)
    apart = np.linalg.norm(colour - np.median(colour[known], axis=0), axis=-1)
    share = float(np.mean(apart[known] > _FAR_APART))
    if not something_moved and share <= _NOTABLE:
        return None
    places, surely = (
        usable & _enlarged(cv2.dilate((apart > least).astype(np.uint8), disc(rim)), side, usable)
        for least, rim in ((_APART, _RIM), (_FAR_APART, _FAR_RIM))
    )
    if np.count_nonzero(places) > (1 - _LEAST_LEFT) * np.count_nonzero(usable):
        return None
    return MovedShadows(places, surely & (share > _CORNERS), share)


def moved_shadows_warning(share: float) -> RunWarning:
    """Tell of what was left out, and what to do. share: of the picture, 0…1."""
    message = (
        f"In {share:.1%} of the picture light of the lamps is in what the flash added, as where a "
        "shadow moved between the photographs: no lamp was told by it, and its layers are filled "
        "in from their surroundings. Keep people and things still, yourself among them, and take "
        "the two photographs in quick succession."
    )
    return RunWarning(Code.MOVED, message, {"share": share})


def _enlarged(blocks: MatLike, side: int, usable: Mask) -> Mask:
    """Which blocks (h, w) of usable lie in these larger ones, so many to a side; no other does."""
    inside = np.zeros_like(usable)
    height, width = (side * larger for larger in blocks.shape)
    inside[:height, :width] = (blocks > 0).repeat(side, axis=0).repeat(side, axis=1)
    return inside


def _unlike_steps(no_flash: Floats, flash: Floats, variance: Floats, known: Mask) -> Floats32:
    """Steps (h, w, 2, 2) of the flash part's two colours in x and y, 0 where the other has them.

    variance: of the flash part, of independent blocks.
    """
    before, part = (_blurred(image, known) for image in (no_flash, flash))
    shared, own = _steps(before), _steps(part)
    relative = variance / np.square(part)
    noise = _GRADIENT_NOISE * (relative[..., [0, 2]] + relative[..., [1]])
    least = _STEP**2 + _SIGNIFICANT**2 * noise
    clear = (np.square(own).sum(axis=3) / least).sum(axis=2) > 1
    apart, size = (np.square(each).sum(axis=(2, 3)) for each in (own - shared, own))
    found = known & clear & (apart > _UNLIKE**2 * size)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8))
    large = stats[:, cv2.CC_STAT_AREA] >= _SPECK
    large[0] = False  # the background
    return np.where(large[labels][..., None, None], own, np.float32(0.0))


def _blurred(image: Floats, known: Mask) -> Image:
    """Means (h, w, 3) over what is known around each block, > 0."""
    weights = known.astype(np.float32)
    blurred = cv2.GaussianBlur(image * weights[..., None], (0, 0), _BLUR)
    blurred = blurred / np.maximum(cv2.GaussianBlur(weights, (0, 0), _BLUR), 1e-3)[..., None]
    return np.maximum(blurred, 1e-5).astype(np.float32)


def _steps(image: Image) -> Floats32:
    """Of the logarithms of red and blue over green (h, w, 2, 2), from block to block in x and y."""
    logs = np.log(image)
    colours = np.ascontiguousarray(logs[..., [0, 2]] - logs[..., [1]])
    steps = [cv2.Sobel(colours, -1, 1 - axis, axis, scale=0.125) for axis in (0, 1)]
    return np.stack(steps, axis=-1)


def _integrated(steps: Floats32) -> Plane:
    """What has steps (h, w, 2) in x and y and goes back to 0 beside them, (h, w).

    The screened Poisson equation, Bhat et al., "Fourier Analysis of the 2D Screened Poisson
    Equation for Gradient Domain Problems", ECCV 2008, solved by cosines.
    """
    height, width = steps.shape[:2]
    x, y = np.moveaxis(np.pad(steps, ((0, height % 2), (0, width % 2), (0, 0))), 2, 0)
    x, y = (x[:, 1:] + x[:, :-1]) / 2, (y[1:] + y[:-1]) / 2
    divergence = np.diff(x, axis=1, prepend=0, append=0) + np.diff(y, axis=0, prepend=0, append=0)
    down, across = (2 * np.cos(np.pi * np.arange(n) / n) - 2 for n in divergence.shape)
    curvature = down[:, None] + across - 1 / _REACH**2
    field = cv2.idct(cv2.dct(divergence.astype(np.float32)) / curvature.astype(np.float32))
    return np.asarray(field[:height, :width])
