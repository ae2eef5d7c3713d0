"""By how much more one photograph of a pair is blurred than the other, and blurring that as much.

A hand that shakes while the room's light is gathered, or a focus that differs, blurs one
photograph; the flash freezes the other. What both show of the surfaces, steps relative to what
lies around, then differs by a diffusion. Source: Favaro, Soatto, Burger & Osher, "Shape from
Defocus via Diffusion", PAMI 2008, with one diffusion for the whole picture, in two dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.images.blocks import any_in_blocks
from pipeline.images.coded_image import CodedImage
from pipeline.images.frames import Image, Mask, Photograph
from pipeline.images.memory import empty_image
from pipeline.pair.ratios import Ratios

# In blocks of the ratios; chosen on development scenes (docs/trials/blur.md)
_FINE = 0.7  # what is finer is noise, and too steep for a diffusion
_LOCAL = 4.0  # what is smoother is light
_DARK = 0.02  # of the 95th percentile, added to what is around
_DARK_QUANTILE = 0.95
_WINDOW = 7  # over which the steps of both must agree
_AGREEING = 0.95  # correlation of steps; edges of shadows are in one photograph alone
_STRONG = 0.5  # quantile of the steps' squares in a window
_CLIPPED_REACH, _BORDER = 9, 6
_ROUNDS, _SETTLED, _REWEIGHTED = 3, 0.05, 6
_SAMPLED = 5_000  # blocks by which a round tells
_SPARSE = 8  # blocks between those that tell quantiles
_TUKEY, _MAD = 4.685, 1.4826  # as pipeline.pair.refine
_PARTS = 4  # to a side, without each of which the blur is found anew: jackknife
_FEW = 0.08  # of the blocks; fewer that agree tell nothing
_SURELY = 5.0  # standard errors
_LEAST = 0.33  # variance; shadows, and laying by hand motion, seem to blur by up to .3
_LEAST_OF_FLASH = 1.2  # the same of the flash photograph, which has shadows and gloss of its own
_WIDEST = 3.5  # standard deviations that a kernel reaches
_LOST = 0.1  # of a pixel's light that may come from unusable ones
_MIRRORED = cv2.BORDER_REFLECT_101
_SHARP: Floats64 = np.zeros((2, 2))


@dataclass(frozen=True)
class RelativeBlur:
    """What lies between the sharpness of two photographs, as Gaussians.

    no_flash: float64 (2, 2), covariance over (x, y) in pixels² of the Gaussian by which the
    photograph without the flash is blurred more; all 0 where it is not. flash_px: standard
    deviation in pixels by which the flash photograph is blurred more, in the direction in which
    it is most; 0 where it is not.
    """

    no_flash: Floats64
    flash_px: float

    @property
    def no_flash_px(self) -> float:
        """Standard deviation of no_flash in the direction in which it is widest, in pixels."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.no_flash)[-1], 0.0)))


def find_relative_blur(ratios: Ratios, unusable: Mask) -> RelativeBlur | None:
    """Tell which photograph of a pair is less sharp, and by how much; None where neither surely is.

    ratios: of the flash photograph over the other; their scale does not matter. unusable: bool
    (H, W), of the pixels. Dark blocks count, too: outlines before them are as sharp in both.
    Variances below a third of a block's side, squared, are not looked for: they cost little.
    """
    no_flash = ratios.no_flash.astype(np.float32)
    flash = np.exp(ratios.logs).astype(np.float32) * no_flash
    usable = ~any_in_blocks(unusable, ratios.block)
    found = _compared(no_flash, flash, usable)
    if found is None:
        wide = _compared(_halved(no_flash), _halved(flash), ~any_in_blocks(~usable, 2))
        found = wide and _compared(no_flash, flash, usable, 4 * wide[0])
    return None if found is None else _surely(*found, ratios.block)


def blurred(photograph: Photograph, kernel: Floats32, own: bool = False) -> Image:
    """Blur a photograph (H, W, 3) by a kernel (n, n): float32 (H, W, 3).

    own: whether nobody else holds its pixels; it is then written over where it is an array.
    """
    light, out = photograph[:], None if isinstance(photograph, CodedImage) else photograph
    if out is None or not own:
        out = empty_image(*photograph.shape)
    cv2.filter2D(light, -1, kernel, dst=out, borderType=_MIRRORED)
    return out


def blur_kernel(covariance: Floats64) -> Floats32:
    """A kernel (n, n) that sums to 1, of a covariance (2, 2) ≥ 0 over (x, y), in pixels².

    As many explicit steps of anisotropic diffusion (Weickert 1998) as keep it near a Gaussian: the
    covariance is exact also below a pixel, where a sampled Gaussian's is not.
    """
    widest = np.sqrt(np.linalg.eigvalsh(covariance)[-1])
    size = 2 * (int(np.ceil(_WIDEST * widest)) + 1) + 1
    angles = 2 * np.pi * np.fft.fftfreq(size)
    x, y = angles[None], angles[:, None]
    steps = max(int(np.ceil(2 * np.trace(covariance))), 1)
    (xx, xy), (_, yy) = covariance / steps
    one = 1 - xx * (1 - np.cos(x)) - yy * (1 - np.cos(y)) - xy * np.sin(x) * np.sin(y)
    return np.asarray(np.fft.fftshift(np.fft.ifft2(one**steps).real), np.float32)


def blurred_mask(unusable: Mask, kernel: Floats32) -> Mask:
    """Pixels (H, W) of which unusable ones make up a tenth or more after a blur."""
    spread = cv2.filter2D(unusable.astype(np.float32), -1, kernel, borderType=_MIRRORED)
    return np.asarray(unusable | (spread > _LOST))


def _halved(light: Image) -> Image:
    """Means of 2×2 blocks, in which a wide blur is half as wide."""
    rows, columns = (length // 2 for length in light.shape[:2])
    whole, size = light[: 2 * rows, : 2 * columns], (max(columns, 1), max(rows, 1))
    return np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)


def _compared(
    no_flash: Image, flash: Image, usable: Mask, covariance: Floats64 = _SHARP
) -> tuple[Floats64, Floats64] | None:
    """What _difference finds of two photographs, from a first covariance (2, 2) on."""
    steps, usable, result = _steps(no_flash), _open_blocks(usable), None
    for _ in range(_ROUNDS):
        more = _positive(covariance)
        found = _difference(steps, _steps(blurred(flash, blur_kernel(more))), usable)
        if found is None:
            return None
        covariance = more + found[0]
        result = covariance, found[1]
        if np.abs(_positive(covariance) - more).max() < _SETTLED:
            break
    return result


def _open_blocks(usable: Mask) -> Mask:
    """Blocks away from unusable ones and from the border."""
    around = np.ones((_CLIPPED_REACH, _CLIPPED_REACH), np.uint8)
    eroded = cv2.erode(usable.astype(np.uint8), around)
    inside = np.zeros_like(usable)
    inside[_BORDER:-_BORDER, _BORDER:-_BORDER] = eroded[_BORDER:-_BORDER, _BORDER:-_BORDER] > 0
    return inside


def _steps(light: Image) -> Image:
    """Steps of reflectance (h, w, 3), relative to the light around."""
    bright = np.quantile(light.reshape(-1, 3)[::_SPARSE], _DARK_QUANTILE, axis=0)
    around = cv2.GaussianBlur(light, (0, 0), _LOCAL) + np.float32(_DARK * bright)
    relative = cv2.GaussianBlur(light, (0, 0), _FINE) / around
    return np.asarray(relative - cv2.GaussianBlur(relative, (0, 0), _LOCAL), np.float32)


def _difference(steps: Image, other: Image, usable: Mask) -> tuple[Floats64, Floats64] | None:
    """The covariance that the first photograph's blur has beyond the other's, in blocks².

    Returns it, (2, 2), and the covariance (3, 3) of its entries xx, xy, yy; None where too little
    agrees. Robust least squares (Holland & Welsch 1977): first − other = ½ ∇·C∇ of their mean.
    """
    places = np.flatnonzero(_agreeing(steps, other, usable))
    if len(places) < _FEW * usable.size:
        return None
    places = places[:: -(-len(places) // _SAMPLED)]
    slopes = _second_derivatives(np.float32(0.5) * (steps + other), places)
    change = (steps - other).reshape(-1, 3)[places].ravel().astype(np.float64)
    weights: Floats64 = np.ones(len(change))
    entries: Floats64 = np.zeros(3)
    for _ in range(_REWEIGHTED):
        weighted = slopes * weights[:, None]
        entries = _solved(weighted.T @ slopes, weighted.T @ change)
        off = np.abs(change - slopes @ entries)
        far: Floats64 = off / (_TUKEY * _MAD * np.median(off) + 1e-12)
        weights = np.square(np.maximum(1 - far**2, 0.0))
    part = np.repeat(_parts(usable.shape).ravel()[places], 3)
    return _matrix(entries), _jackknifed(slopes, change, weights, part)


def _agreeing(steps: Image, other: Image, usable: Mask) -> Mask:
    """Blocks around which both photographs show the same steps, and strong ones."""
    own, others, shared = (
        cv2.blur((one * two).sum(axis=2), (_WINDOW, _WINDOW))
        for one, two in ((steps, steps), (other, other), (steps, other))
    )
    if not usable.any():
        return usable
    strong = others > np.quantile(others[usable][::_SPARSE], _STRONG)
    alike = shared > _AGREEING * np.sqrt(np.maximum(own * others, 0.0))
    return np.asarray(usable & strong & alike)


def _second_derivatives(steps: Image, places: NDArray[np.intp]) -> Floats64:
    """½ ∂²/∂x², ∂²/∂x∂y and ½ ∂²/∂y² of (h, w, 3) in some blocks, (3·blocks, 3)."""
    same, slope, bend = (np.array(taps) for taps in ([1.0], [-0.5, 0.0, 0.5], [0.5, -1.0, 0.5]))
    kinds = ((bend, same), (slope, slope), (same, bend))
    filtered = (cv2.sepFilter2D(steps, -1, x, y).reshape(-1, 3)[places] for x, y in kinds)
    return np.stack([one.ravel() for one in filtered], axis=-1).astype(np.float64)


def _parts(shape: tuple[int, ...]) -> Floats64:
    """Which of 4 × 4 parts of the picture each block (h, w) lies in, 0…15."""
    rows, columns = (np.arange(length) * _PARTS // length for length in shape)
    return np.asarray(rows[:, None] * _PARTS + columns, np.float64)


def _jackknifed(slopes: Floats64, change: Floats64, weights: Floats64, part: Floats64) -> Floats64:
    """Covariance (3, 3) of a least squares solution, by leaving out a part at a time."""
    weighted = slopes * weights[:, None]
    normal, right = weighted.T @ slopes, weighted.T @ change
    without = []
    for one in np.unique(part):
        own = part == one
        less = normal - weighted[own].T @ slopes[own], right - weighted[own].T @ change[own]
        without.append(_solved(*less))
    off = np.array(without) - np.mean(without, axis=0)
    return np.asarray((len(off) - 1) / len(off) * off.T @ off)


def _solved(normal: Floats64, right: Floats64) -> Floats64:
    """Least squares; what stripes leave open is 0."""
    return np.asarray(np.linalg.lstsq(normal, right, rcond=1e-6)[0])


def _surely(covariance: Floats64, error: Floats64, block: int) -> RelativeBlur | None:
    """What is sure of a covariance in blocks² with the given error of its entries, in pixels."""
    variances, axes = np.linalg.eigh(covariance)
    errors = [_SURELY * _deviation(axis, error) for axis in axes.T]
    no_flash, flash_px = np.zeros((2, 2)), 0.0
    if variances[1] > max(_LEAST, errors[1]):
        no_flash = block**2 * _positive(covariance)
    if -variances[0] > max(_LEAST_OF_FLASH, errors[0]):
        flash_px = block * float(np.sqrt(-variances[0]))
    found = RelativeBlur(no_flash, flash_px)
    return found if no_flash.any() or flash_px else None


def _deviation(axis: Floats64, error: Floats64) -> float:
    """Standard error of the variance along an axis (2,)."""
    x, y = axis
    by_entry = np.array([x * x, 2 * x * y, y * y])
    return float(np.sqrt(max(by_entry @ error @ by_entry, 0.0)))


def _positive(covariance: Floats64) -> Floats64:
    """The part of a symmetric matrix whose eigenvalues are positive."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)


def _matrix(entries: Floats64) -> Floats64:
    """(2, 2) of xx, xy, yy."""
    return entries[[0, 1, 1, 2]].reshape(2, 2)
