"""Two photographs on one scale: what the lamps gave, what the flash added, what can be used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.align import NOT_ATTEMPTED, Alignment, estimate_alignment, warp
from pipeline.errors import OptionError, PairMismatchError, UnusablePairError
from pipeline.frames import Frame, Image, Mask
from pipeline.noise import Noise, estimate_noise
from pipeline.options import Options
from pipeline.progress import Progress

_BLACK = 2e-4  # of the white level; an 8-bit sRGB code of 1 is 3e-4
_MIN_USABLE = 0.02
_FEW_USABLE = 0.5
_DARKER = 0.6  # share of lit pixels that lose light with the flash on: the frames are swapped
_MAX_PLAUSIBLE_RATIO = 1000.0
_EXPOSURES_DIFFER = 0.15  # in stops
_COPY_BLOCK = 8  # pixels averaged, against noise
_COPY_SPREAD = 0.4  # stops between the quartiles of flash part ÷ no-flash light
_COPY_COLOUR_SPREAD = 1.0  # the same over all channels: lamp and flash differ in colour
_SMALLEST = 32
_SAMPLE_STEP = 4


@dataclass(frozen=True)
class Pair:
    """A pair ready for separation, on the no-flash photograph's scale.

    no_flash, flash: float32 (H, W, 3) linear camera RGB, 1.0 = white level of the no-flash
        photograph as given. flash is the flash photograph, laid on the other and divided by
        exposure_ratio, or the flash part alone when flash_only.
    unusable: bool (H, W), saturated in either, or without counterpart.
    no_flash_noise, flash_noise: the noise of each.
    """

    no_flash: Image
    flash: Image
    unusable: Mask
    flash_only: bool
    exposure_ratio: float
    no_flash_noise: Noise
    flash_noise: Noise
    alignment: Alignment
    warnings: tuple[str, ...]


def make_pair(no_flash: Frame, flash: Frame, options: Options, progress: Progress) -> Pair:
    """Bring two frames on one scale and lay the flash frame on the other.

    Raises PairMismatchError for frames that do not belong together, UnusablePairError when there
    is no light to separate, OptionError for an exposure ratio that cannot be.
    """
    warnings: list[str] = []
    _check_belonging(no_flash, flash)
    ratio = _exposure_ratio(no_flash, flash, options, warnings)
    _check_light(no_flash, flash)
    warnings += _rendering_warnings(no_flash, flash, ratio)

    progress.report("align", 0.0)
    alignment = NOT_ATTEMPTED
    pixels, saturated = flash.pixels, flash.saturated
    if options.align:
        alignment = estimate_alignment(no_flash.pixels, pixels)
        progress.report("align", 0.6)
        if alignment.problem:
            warnings.append(alignment.problem)
        if alignment.applied:
            pixels, saturated = warp(pixels, saturated, alignment)
    pixels = pixels / np.float32(ratio)
    progress.report("align", 0.8)
    pair = Pair(
        no_flash=no_flash.pixels,
        flash=pixels,
        unusable=no_flash.saturated | saturated,
        flash_only=options.flash_only,
        exposure_ratio=ratio,
        no_flash_noise=estimate_noise(no_flash.pixels),
        flash_noise=estimate_noise(pixels),
        alignment=alignment,
        warnings=(*warnings, *_copy_warnings(no_flash.pixels, pixels, options.flash_only)),
    )
    _check_flash_adds(pair)
    progress.report("align", 1.0)
    return pair


def check_sizes(no_flash: tuple[int, int], flash: tuple[int, int]) -> None:
    """Check two (width, height): PairMismatchError if unequal, UnusablePairError if tiny."""
    if no_flash != flash:
        (w1, h1), (w2, h2) = no_flash, flash
        raise PairMismatchError(
            f"The photographs have different sizes, {w1} × {h1} without the flash and {w2} × {h2} "
            "with it: send both as the camera made them, uncropped."
        )
    if min(no_flash) < _SMALLEST:
        width, height = no_flash
        raise UnusablePairError(
            f"The photographs have only {width} × {height} pixels: send them in full size."
        )


def _check_belonging(no_flash: Frame, flash: Frame) -> None:
    check_sizes(no_flash.size, flash.size)
    if (no_flash.encoding == "srgb") != (flash.encoding == "srgb"):
        raise PairMismatchError(
            f"The photograph without the flash holds {_words(no_flash)}, the one with it "
            f"{_words(flash)}: send two files of one kind."
        )
    if no_flash.sha256 == flash.sha256 or np.array_equal(no_flash.pixels, flash.pixels):
        raise UnusablePairError(
            "The two photographs are identical: send one without the flash and one with it."
        )
    if no_flash.flash_fired and flash.flash_fired is False:
        raise UnusablePairError(
            "The flash fired in the photograph that should be without it: swap the two."
        )


def _words(frame: Frame) -> str:
    return {"raw": "sensor values", "linear": "linear values", "srgb": "sRGB values"}[
        frame.encoding
    ]


def _exposure_ratio(no_flash: Frame, flash: Frame, options: Options, warnings: list[str]) -> float:
    if options.exposure_ratio is not None:
        if not _plausible(options.exposure_ratio):
            raise OptionError(
                f"An exposure ratio of {options.exposure_ratio:.3g} cannot be: pass the flash "
                "frame's exposure divided by the other's."
            )
        return options.exposure_ratio
    before, after = no_flash.exposure.relative, flash.exposure.relative
    if before is not None and after is not None:
        ratio = after / before
        if not _plausible(ratio):
            raise OptionError(
                f"The exposures in the files differ {ratio:.3g} times: pass the right ratio with "
                "exposure_ratio."
            )
        return ratio
    if not options.flash_only:
        warnings.append(
            "The files do not say how they were exposed; equal exposures are taken for granted. "
            "Expose both alike by hand, or pass the exposure ratio if they differ."
        )
    return 1.0


def _plausible(ratio: float) -> bool:
    return 1 / _MAX_PLAUSIBLE_RATIO < ratio < _MAX_PLAUSIBLE_RATIO


def _rendering_warnings(no_flash: Frame, flash: Frame, ratio: float) -> list[str]:
    """What a camera's rendering to sRGB may have done to one photograph and not to the other."""
    if no_flash.encoding != "srgb":
        return []
    warnings = []
    if no_flash.auto_white_balance and flash.auto_white_balance:
        warnings.append(
            "The camera balanced the white of each photograph by itself, so their colours may "
            "differ by more than the flash: lock the white balance, or send RAW files."
        )
    if abs(np.log2(ratio)) > _EXPOSURES_DIFFER:
        warnings.append(
            f"The photographs were exposed differently ({ratio:.3g} times) and rendered to sRGB, "
            "so they compare only as far as the camera kept to the sRGB curve: expose both alike, "
            "or send RAW files."
        )
    return warnings


def _check_light(no_flash: Frame, flash: Frame) -> None:
    for frame, name in ((no_flash, "without the flash"), (flash, "with the flash")):
        if np.quantile(frame.pixels[::_SAMPLE_STEP, ::_SAMPLE_STEP].max(axis=2), 0.99) < _BLACK:
            raise UnusablePairError(
                f"The photograph {name} is black: expose it longer or raise the ISO speed."
            )


def _copy_warnings(no_flash: Image, flash: Image, flash_only: bool) -> list[str]:
    """Notice a flash part that is the no-flash photograph over again."""
    height, width = no_flash.shape[:2]
    size = (max(width // _COPY_BLOCK, 1), max(height // _COPY_BLOCK, 1))
    before, after = (
        cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (no_flash, flash)
    )
    part = after if flash_only else after - before
    lit = (before > 0).all(axis=2) & (part > 0).all(axis=2)
    if not lit.any():
        return []
    before, part = before[lit], part[lit]
    if _spread(part.sum(axis=1) / before.sum(axis=1)) > _COPY_SPREAD:
        return []
    if _spread(part / before) > _COPY_COLOUR_SPREAD:  # a lamp that shines like the flash
        return []
    return [
        "What the flash added looks like the photograph without it in most of the picture: the "
        "flash may not reach that far, or the exposure ratio is wrong. Bring the flash nearer or "
        "raise its power, or pass the right exposure ratio."
    ]


def _spread(ratio: NDArray[Any]) -> float:
    """Stops between the quartiles."""
    low, high = np.quantile(np.log2(ratio), [0.25, 0.75])
    return float(high - low)


def _check_flash_adds(pair: Pair) -> None:
    """Refuse pairs whose flash part is missing or negative; what is left to use is told later."""
    if pair.flash_only:
        return
    part = _sampled(pair.flash).sum(axis=2) - _sampled(pair.no_flash).sum(axis=2)
    noise = np.sqrt(
        pair.no_flash_noise.variance(_sampled(pair.no_flash)).sum(axis=2)
        + pair.flash_noise.variance(_sampled(pair.flash)).sum(axis=2)
    )
    open_ = ~pair.unusable[::_SAMPLE_STEP, ::_SAMPLE_STEP]
    if not open_.any():
        raise UnusablePairError(
            "Every pixel is clipped in one of the photographs: expose both shorter."
        )
    if np.mean(part[open_] < -2 * noise[open_]) > _DARKER:
        raise UnusablePairError(
            "The photograph with the flash is darker than the one without it: swap the two, or "
            "pass the exposure ratio if the camera did not write it."
        )
    if np.mean(part[open_] > 3 * noise[open_]) < _MIN_USABLE:
        raise UnusablePairError(
            "The flash adds too little light to measure: bring it nearer, raise its power, or "
            "shorten both exposures."
        )


def _sampled(image: Image) -> Image:
    return image[::_SAMPLE_STEP, ::_SAMPLE_STEP]
