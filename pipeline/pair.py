"""Two photographs on one scale: what the lamps gave, what the flash added, what can be used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.align import NOT_ATTEMPTED, Alignment, estimate_alignment, warp
from pipeline.errors import PairMismatchError, UnusablePairError
from pipeline.exposure import settled_ratio, written_ratio
from pipeline.flow import residual_flow, warp_along
from pipeline.frames import Frame, Image, Mask
from pipeline.motion import find_moved
from pipeline.noise import Noise, estimate_noise
from pipeline.options import Options
from pipeline.progress import Progress
from pipeline.steadiness import Ratios, bands, block_ratios, darker_share

_BLACK = 2e-4  # of the white level; an 8-bit sRGB code of 1 is 3e-4
_MIN_USABLE = 0.02
_FEW_USABLE = 0.5
_DARKER = 0.6  # share of lit pixels that lose light with the flash on: the frames are swapped
_EXPOSURES_DIFFER = 0.15  # in stops
_COPY_BLOCK = 8  # pixels averaged, against noise
_COPY_SPREAD = 0.4  # stops between the quartiles of flash part ÷ no-flash light
_COPY_COLOUR_SPREAD = 1.0  # the same over all channels: lamp and flash differ in colour
_PARALLAX_PX = 0.5
_REGISTRATION_PX = 0.35  # of alignment and interpolation, measured
_NOTABLE_MOTION = 0.002
_NOTABLE_DIMMING = 0.03
_SMALLEST = 32
_SAMPLE_STEP = 4


@dataclass(frozen=True)
class Pair:
    """A pair ready for separation, on the no-flash photograph's scale.

    no_flash, flash: float32 (H, W, 3) linear camera RGB, 1.0 = white level of the no-flash
        photograph as given. flash is the flash photograph, laid on the other and divided by
        exposure_ratio, or the flash part alone when flash_only.
    unusable: bool (H, W), saturated in either, without counterpart, or showing something that
        moved.
    exposure_source: where exposure_ratio comes from, see ExposureRatio.
    rendered: whether a camera's rendering to sRGB has bent the values.
    no_flash_noise, flash_noise: the noise of each.
    registration: standard deviation in pixels of what the flash photograph lies beside the other; 0
        where it was taken as it is.
    parallax: share of the picture that lies elsewhere than the homography says, 0…1.
    moved: share of the picture in which something moved, 0…1.
    """

    no_flash: Image
    flash: Image
    unusable: Mask
    flash_only: bool
    exposure_ratio: float
    exposure_source: str
    rendered: bool
    no_flash_noise: Noise
    flash_noise: Noise
    alignment: Alignment
    registration: float
    parallax: float
    moved: float
    warnings: tuple[str, ...]


def make_pair(no_flash: Frame, flash: Frame, options: Options, progress: Progress) -> Pair:
    """Bring two frames on one scale and lay the flash frame on the other.

    Raises PairMismatchError for frames that do not belong together, UnusablePairError when there
    is no light to separate, OptionError for an exposure ratio that cannot be.
    """
    _check_belonging(no_flash, flash)
    rendered = no_flash.encoding == "srgb"
    ratio = written_ratio(no_flash, flash, options)
    _check_light(no_flash, flash)
    warnings = _rendering_warnings(no_flash, flash, ratio.value) if rendered else []

    progress.report("align", 0.0)
    alignment = NOT_ATTEMPTED
    pixels, saturated, parallax = flash.pixels, flash.saturated, 0.0
    if options.align:
        alignment = estimate_alignment(no_flash.pixels, pixels)
        progress.report("align", 0.4)
        if alignment.problem:
            warnings.append(alignment.problem)
        else:
            pixels, saturated, parallax = _laid_on(no_flash.pixels, flash, alignment)
    progress.report("align", 0.6)
    pixels = pixels / np.float32(ratio.value)
    noises = estimate_noise(no_flash.pixels), estimate_noise(pixels)
    unusable = no_flash.saturated | saturated
    moved = 0.0
    if not options.flash_only:
        progress.report("align", 0.7)
        ratios = block_ratios(no_flash.pixels, pixels, unusable, noises)
        settled, doubts = settled_ratio(ratio, ratios, rendered)
        warnings += doubts
        if settled.value != ratio.value:
            pixels = pixels * np.float32(ratio.value / settled.value)
            noises = noises[0], estimate_noise(pixels)
        ratio = settled
        _check_flash_adds(no_flash.pixels, pixels, unusable, noises)
        progress.report("align", 0.8)
        if alignment.problem is None:
            there = find_moved(no_flash.pixels, pixels, unusable, noises, rendered)
            moved = float(there.mean())
            unusable = unusable | there
        steady = block_ratios(no_flash.pixels, pixels, unusable, noises)
        warnings += _unsteady_warnings(steady, moved, rendered, bool(doubts))
    progress.report("align", 0.9)
    pair = Pair(
        no_flash=no_flash.pixels,
        flash=pixels,
        unusable=unusable,
        flash_only=options.flash_only,
        exposure_ratio=ratio.value,
        exposure_source=ratio.source,
        rendered=rendered,
        no_flash_noise=noises[0],
        flash_noise=noises[1],
        alignment=alignment,
        registration=_REGISTRATION_PX * float(alignment.applied or parallax > 0),
        parallax=parallax,
        moved=moved,
        warnings=(*warnings, *_copy_warnings(no_flash.pixels, pixels, options.flash_only)),
    )
    progress.report("align", 1.0)
    return pair


def _laid_on(no_flash: Image, flash: Frame, alignment: Alignment) -> tuple[Image, Mask, float]:
    """Flash frame and its mask on the no-flash frame's pixels, and the share that has parallax."""
    pixels, saturated = flash.pixels, flash.saturated
    if alignment.applied:
        pixels, saturated = warp(pixels, saturated, alignment)
    flow = residual_flow(no_flash, pixels)
    if flow is None:
        return pixels, saturated, 0.0
    pixels, saturated = warp_along(flash.pixels, flash.saturated, alignment, flow)
    return pixels, saturated, float(np.mean(np.abs(flow).max(axis=2) > _PARALLAX_PX))


def _unsteady_warnings(
    ratios: Ratios, moved: float, rendered: bool, ratio_in_doubt: bool
) -> list[str]:
    """What moved or changed between the photographs, and how to shoot without it."""
    warnings = []
    if moved > _NOTABLE_MOTION:
        warnings.append(
            f"Something moved between the photographs in {moved:.1%} of the picture; the layers "
            "are filled in there from their surroundings. Keep people and things still, and take "
            "the two photographs in quick succession."
        )
    darker = darker_share(ratios, rendered)
    if darker > _NOTABLE_DIMMING and not ratio_in_doubt:
        warnings.append(
            f"In {darker:.1%} of the picture a lamp or daylight was weaker in the flash photograph "
            "than in the other: wait for steady light, and under lamps on the mains expose for a "
            "multiple of 1/100 s (1/120 s where the mains has 60 Hz)."
        )
    height = bands(ratios)
    if height is not None:
        warnings.append(
            f"Bands of {height:.1%} of the light run across the picture: a lamp flickers with the "
            "mains. Expose for a multiple of 1/100 s (1/120 s where the mains has 60 Hz), or use "
            "the mechanical shutter."
        )
    return warnings


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


def _rendering_warnings(no_flash: Frame, flash: Frame, ratio: float) -> list[str]:
    """What a camera's rendering to sRGB may have done to one photograph and not to the other."""
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


def _check_flash_adds(
    no_flash: Image, flash: Image, unusable: Mask, noises: tuple[Noise, Noise]
) -> None:
    """Refuse pairs whose flash part is missing or negative; what is left to use is told later."""
    before, after = _sampled(no_flash), _sampled(flash)
    part = after.sum(axis=2) - before.sum(axis=2)
    noise = np.sqrt(noises[0].variance(before).sum(axis=2) + noises[1].variance(after).sum(axis=2))
    open_ = ~unusable[::_SAMPLE_STEP, ::_SAMPLE_STEP]
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
