"""By how much more one photograph of a pair is blurred than the other, and blurring that as much.

A hand that shakes while the room's light is gathered, or a focus that differs, blurs one
photograph; the flash freezes the other. What both show of the surfaces, steps relative to what
lies around, then differs by a diffusion, and by a shift: photographs are laid on each other by one
end of a shake. A diffusion is the same by coarse steps as by fine ones; where light falls on things
otherwise, one that grows with the steps is found. Source: Favaro, Soatto, Burger & Osher, "Shape
from Defocus via Diffusion", PAMI 2008, with one diffusion for the whole picture, in two dimensions,
and the shift beside it.
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
_COARSE, _GROWN = 1.4, 1.6  # by what is coarser a blur's variance is not so many times as much
_LOCAL = 4.0  # what is smoother is light
_DARK = 0.02  # of the 95th percentile, added to what is around
_DARK_QUANTILE = 0.95
_WINDOW = 7  # over which the steps of both must agree
_AGREEING = 0.95  # correlation of steps; edges of shadows are in one photograph alone
_STRONG = 0.5  # quantile of the steps' squares in a window
_CLIPPED_REACH, _BORDER = 9, 6
_ROUNDS, _SETTLED, _REWEIGHTED = 6, 0.05, 6
_FARTHEST = 16.0  # blocks of blur or shift; more is chance, and would need a huge kernel
_HALVINGS = 2  # of the size, where a wide blur leaves too little that agrees
_SAMPLED = 5_000  # blocks by which a round tells
_SPARSE = 8  # blocks between those that tell quantiles
_TUKEY, _MAD = 4.685, 1.4826  # as pipeline.pair.refine
_PARTS = 4  # to a side, without each of which the blur is found anew: jackknife
_FEW = 0.08  # of the blocks; fewer that agree tell nothing
_SURELY = 6.0  # standard errors
_LEAST = 0.33  # variance; shadows, and laying by hand motion, seem to blur by up to .3
_LEAST_OF_FLASH = 0.8  # the same of the flash photograph, which has shadows and gloss of its own
_SEEMS_OF_FLASH = 0.5  # of that, by the other being blurred less: then it is looked for
_WIDEST = 3.5  # standard deviations that a kernel reaches
_LOST = 0.1  # of a pixel's light that may come from unusable ones
_MIRRORED = cv2.BORDER_REFLECT_101
_MIDDLE: Floats64 = np.zeros(2)


@dataclass(frozen=True)
class RelativeBlur:
    """What lies between the sharpness of two photographs, as Gaussians.

    no_flash, flash: float64 (2, 2), covariance over (x, y) in pixels² of the Gaussian by which the
    photograph without the flash, and that with it, is blurred more; all 0 where it is not, one of
    them at least is. offset: (2,), from where (x, y) in the flash photograph the light of the
    middle of the other's blur comes, in pixels: what laying the one on the other has left.
    """

    no_flash: Floats64
    flash: Floats64
    offset: Floats64

    @property
    def for_flash(self) -> Floats32:
        """What the flash photograph is to be filtered with to be like the other, for `blurred`."""
        return blur_kernel(self.no_flash, self.offset)

    @property
    def for_no_flash(self) -> Floats32:
        """What the photograph without the flash is to be filtered with to be like the other."""
        return blur_kernel(self.flash)

    @property
    def no_flash_px(self) -> float:
        """Standard deviation of no_flash in the direction in which it is widest, in pixels."""
        return _widest(self.no_flash)

    @property
    def flash_px(self) -> float:
        """Standard deviation of flash in the direction in which it is widest, in pixels."""
        return _widest(self.flash)


def find_relative_blur(ratios: Ratios, unusable: Mask) -> RelativeBlur | None:
    """Tell which photograph of a pair is less sharp, and by how much; None where neither surely is.

    ratios: of the flash photograph over the other; their scale does not matter. unusable: bool
    (H, W), of the pixels. Dark blocks count, too: outlines before them are as sharp in both.
    Variances below a third of a block's side, squared, are not looked for: they cost little. Nor is
    told what is wider by coarser steps, as the shading of shiny things under other light seems.
    """
    no_flash = ratios.no_flash.astype(np.float32)
    flash = np.exp(ratios.logs).astype(np.float32) * no_flash
    usable = ~any_in_blocks(unusable, ratios.block)
    found = _found(no_flash, flash, usable, _HALVINGS)
    of_no_flash = _sure(no_flash, flash, usable, found, _LEAST)
    of_flash = None
    if found is None or np.linalg.eigvalsh(found.covariance)[0] < -_SEEMS_OF_FLASH:
        # a photograph is blurred to be like the other, not sharpened
        back = _found(flash, no_flash, usable, _HALVINGS)
        of_flash = _sure(flash, no_flash, usable, back, _LEAST_OF_FLASH)
    if of_no_flash is None and of_flash is None:
        return None
    own, others = (
        np.zeros((2, 2)) if one is None else ratios.block**2 * _positive(one.covariance)
        for one in (of_no_flash, of_flash)
    )
    mean = _MIDDLE if of_no_flash is None else of_no_flash.mean
    return RelativeBlur(own, others, ratios.block * mean)


def blurred(photograph: Photograph, kernel: Floats32, own: bool = False) -> Image:
    """Blur a photograph (H, W, 3) by a kernel (n, n): float32 (H, W, 3).

    own: whether nobody else holds its pixels; it is then written over where it is an array.
    """
    light, out = photograph[:], None if isinstance(photograph, CodedImage) else photograph
    if out is None or not own:
        out = empty_image(*photograph.shape)
    cv2.filter2D(light, -1, kernel, dst=out, borderType=_MIRRORED)
    return out


def blur_kernel(covariance: Floats64, mean: Floats64 = _MIDDLE) -> Floats32:
    """A kernel (n, n) that sums to 1, of a covariance (2, 2) ≥ 0 over (x, y), in pixels².

    mean: (2,), in pixels from the middle; what it has of parts of pixels is shared out between two
    of them, whose variance, up to a quarter along each axis, is taken off the covariance, or adds
    to a smaller one. As many explicit steps of anisotropic diffusion (Weickert 1998) as keep the
    rest near a Gaussian: its covariance is exact also below a pixel, where a sampled Gaussian's is
    not.
    """
    whole = np.floor(mean)
    part = mean - whole
    rest = _positive(covariance - np.diag(part * (1 - part)))
    widest = _WIDEST * np.sqrt(max(np.linalg.eigvalsh(rest)[-1], 0.0))
    size = 2 * (int(np.ceil(widest + np.abs(mean).max())) + 2) + 1
    angles = 2 * np.pi * np.fft.fftfreq(size)
    x, y = angles[None], angles[:, None]
    steps = max(int(np.ceil(2 * np.trace(rest))), 1)
    (xx, xy), (_, yy) = rest / steps
    one = 1 - xx * (1 - np.cos(x)) - yy * (1 - np.cos(y)) - xy * np.sin(x) * np.sin(y)
    moved = np.exp(-1j * (whole[0] * x + whole[1] * y))
    for share, along in zip(part, (x, y), strict=True):
        moved = moved * (1 - share + share * np.exp(-1j * along))
    return np.asarray(np.fft.fftshift(np.fft.ifft2(one**steps * moved).real), np.float32)


def blurred_mask(unusable: Mask, kernel: Floats32) -> Mask:
    """Pixels (H, W) of which unusable ones make up a tenth or more after a blur."""
    spread = cv2.filter2D(unusable.astype(np.float32), -1, kernel, borderType=_MIRRORED)
    return np.asarray(unusable | (spread > _LOST))


@dataclass(frozen=True)
class _Moments:
    """Of the kernel that makes the flash photograph like the other, in blocks.

    covariance: (2, 2). mean: (2,). error: (3, 3), covariance of the entries xx, xy, yy.
    """

    covariance: Floats64
    mean: Floats64
    error: Floats64

    def doubled(self) -> _Moments:
        """The same in blocks half as large."""
        return _Moments(4 * self.covariance, 2 * self.mean, 16 * self.error)


_NOTHING = _Moments(np.zeros((2, 2)), _MIDDLE, np.zeros((3, 3)))


def _found(no_flash: Image, flash: Image, usable: Mask, halvings: int) -> _Moments | None:
    """Compare at once, or from what smaller pictures tell, in which a wide blur is less wide."""
    found = _compared(no_flash, flash, usable, _NOTHING)
    if found is None and halvings and min(usable.shape) > 1:
        small = _halved(no_flash), _halved(flash), ~any_in_blocks(~usable, 2)
        wide = _found(*small, halvings - 1)
        found = wide and _compared(no_flash, flash, usable, wide.doubled())
    return found


def _halved(light: Image) -> Image:
    """Means of 2×2 blocks."""
    rows, columns = (length // 2 for length in light.shape[:2])
    whole = light[: 2 * rows, : 2 * columns]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)


def _compared(
    no_flash: Image, flash: Image, usable: Mask, first: _Moments, fine: float = _FINE
) -> _Moments | None:
    """What _difference finds of two photographs, from first moments on, by steps no finer."""
    steps, usable, found = _steps(no_flash, fine), _open_blocks(usable), first
    for _ in range(_ROUNDS):
        kernel = blur_kernel(_positive(found.covariance), found.mean)
        change = _difference(steps, _steps(blurred(flash, kernel), fine), usable)
        if change is None:
            return None
        mean, covariance = _moments(kernel)
        found = _Moments(covariance + change.covariance, mean + change.mean, change.error)
        if not max(np.abs(found.covariance).max(), np.square(found.mean).max()) < _FARTHEST**2:
            return None
        gone = np.abs(_positive(found.covariance) - covariance).max()
        if max(gone, np.abs(change.mean).max()) < _SETTLED:
            break
    return found


def _moments(kernel: Floats32) -> tuple[Floats64, Floats64]:
    """Mean (2,) and covariance (2, 2) over (x, y) of a kernel that sums to 1."""
    steps = np.arange(len(kernel)) - len(kernel) // 2
    places = np.stack(np.broadcast_arrays(steps, steps[:, None])).reshape(2, -1)
    weights = kernel.ravel().astype(np.float64)
    mean = places @ weights
    return mean, (places * weights) @ places.T - np.outer(mean, mean)


def _open_blocks(usable: Mask) -> Mask:
    """Blocks away from unusable ones and from the border."""
    around = np.ones((_CLIPPED_REACH, _CLIPPED_REACH), np.uint8)
    eroded = cv2.erode(usable.astype(np.uint8), around)
    inside = np.zeros_like(usable)
    inside[_BORDER:-_BORDER, _BORDER:-_BORDER] = eroded[_BORDER:-_BORDER, _BORDER:-_BORDER] > 0
    return inside


def _steps(light: Image, fine: float) -> Image:
    """Steps of reflectance (h, w, 3), relative to the light around, without what is finer."""
    bright = np.quantile(light.reshape(-1, 3)[::_SPARSE], _DARK_QUANTILE, axis=0)
    around = cv2.GaussianBlur(light, (0, 0), _LOCAL) + np.float32(_DARK * bright)
    relative = cv2.GaussianBlur(light, (0, 0), fine) / around
    return np.asarray(relative - cv2.GaussianBlur(relative, (0, 0), _LOCAL), np.float32)


def _difference(steps: Image, other: Image, usable: Mask) -> _Moments | None:
    """The moments that the first photograph has beyond the other; None where too little agrees.

    Robust least squares (Holland & Welsch 1977): first − other = ½ ∇·C∇ + m·∇ of their mean.
    """
    places = np.flatnonzero(_agreeing(steps, other, usable))
    if len(places) < _FEW * usable.size:
        return None
    places = places[:: -(-len(places) // _SAMPLED)]
    slopes = _derivatives(np.float32(0.5) * (steps + other), places)
    change = (steps - other).reshape(-1, 3)[places].ravel().astype(np.float64)
    weights: Floats64 = np.ones(len(change))
    entries: Floats64 = np.zeros(slopes.shape[1])
    for _ in range(_REWEIGHTED):
        weighted = slopes * weights[:, None]
        entries = _solved(weighted.T @ slopes, weighted.T @ change)
        off = np.abs(change - slopes @ entries)
        far: Floats64 = off / (_TUKEY * _MAD * np.median(off) + 1e-12)
        weights = np.square(np.maximum(1 - far**2, 0.0))
    part = np.repeat(_parts(usable.shape).ravel()[places], 3)
    error = _jackknifed(slopes, change, weights, part)
    return _Moments(_matrix(entries), entries[3:], error[:3, :3])


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


def _derivatives(steps: Image, places: NDArray[np.intp]) -> Floats64:
    """½ ∂²/∂x², ∂²/∂x∂y, ½ ∂²/∂y², ∂/∂x and ∂/∂y of (h, w, 3) in some blocks, (3·blocks, 5)."""
    same, slope, bend = (np.array(taps) for taps in ([1.0], [-0.5, 0.0, 0.5], [0.5, -1.0, 0.5]))
    kinds = (bend, same), (slope, slope), (same, bend), (slope, same), (same, slope)
    filtered = (cv2.sepFilter2D(steps, -1, x, y).reshape(-1, 3)[places] for x, y in kinds)
    return np.stack([one.ravel() for one in filtered], axis=-1).astype(np.float64)


def _parts(shape: tuple[int, ...]) -> Floats64:
    """Which of 4 × 4 parts of the picture each block (h, w) lies in, 0…15."""
    rows, columns = (np.arange(length) * _PARTS // length for length in shape)
    return np.asarray(rows[:, None] * _PARTS + columns, np.float64)


def _jackknifed(slopes: Floats64, change: Floats64, weights: Floats64, part: Floats64) -> Floats64:
    """Covariance (5, 5) of a least squares solution, by leaving out a part at a time."""
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


def _sure(
    photograph: Image, other: Image, usable: Mask, found: _Moments | None, least: float
) -> _Moments | None:
    """What was found, where the photograph is surely less sharp than the other by it."""
    if found is None or not _surely(found, found, least):
        return None
    coarse = _compared(photograph, other, usable, found, _COARSE)
    return found if coarse is not None and _surely(found, coarse, least) else None


def _surely(found: _Moments, coarse: _Moments, least: float) -> bool:
    """Whether a blur is sure, of a variance in blocks²; coarse: the same by coarser steps."""
    variances, axes = np.linalg.eigh(found.covariance)
    variance, axis = float(variances[1]), axes[:, 1]
    by_coarse = float(axis @ coarse.covariance @ axis)
    error = _deviation(axis, found.error)
    return variance > max(least, _SURELY * error) and by_coarse < _GROWN * variance


def _deviation(axis: Floats64, error: Floats64) -> float:
    """Standard error of the variance along an axis (2,)."""
    x, y = axis
    by_entry = np.array([x * x, 2 * x * y, y * y])
    return float(np.sqrt(max(by_entry @ error @ by_entry, 0.0)))


def _widest(covariance: Floats64) -> float:
    """Standard deviation in the direction in which a covariance (2, 2) has most."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _positive(covariance: Floats64) -> Floats64:
    """The part of a symmetric matrix whose eigenvalues are positive."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.maximum(values, 0.0) @ vectors.T)


def _matrix(entries: Floats64) -> Floats64:
    """(2, 2) of xx, xy, yy."""
    return entries[[0, 1, 1, 2]].reshape(2, 2)
