"""Two photographs on one scale: what the lamps gave, what the flash added, what can be used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.align import NOT_ATTEMPTED, Alignment, estimate_alignment, warp
from pipeline.area_means import area_means
from pipeline.coded import CodedImage
from pipeline.exposure import ExposureRatio, darkening, settled_ratio, written_ratio
from pipeline.flat_noise import estimate_noise
from pipeline.flow import residual_flow, warp_along
from pipeline.frames import Frame, Image, Mask, Photograph
from pipeline.memory import empty_image, releasable
from pipeline.motion import find_moved
from pipeline.noise import Noise
from pipeline.options import PairOptions
from pipeline.pair_checks import check_belonging, check_colours, check_flash_adds, check_light
from pipeline.progress import Progress
from pipeline.remarks import Code, Remark
from pipeline.steadiness import Ratios, bands, block_ratios, brightening, darker_share

_EXPOSURES_DIFFER = 0.15  # in stops
_COPY_BLOCK = 8  # pixels averaged, against noise
_COPY_SPREAD = 0.4  # stops between the quartiles of flash part ÷ no-flash light
_COPY_COLOUR_SPREAD = 1.0  # the same over all channels: lamp and flash differ in colour
_PARALLAX_PX = 0.5
_REGISTRATION_PX = 0.35  # of alignment and interpolation, measured
_NOTABLE_MOTION = 0.002
_STILL = 0.25  # of what seems to have moved may be left in a brighter photograph
_NOTABLE_DIMMING, _NOTABLE_DARKENING = 0.01, 0.002


@dataclass(frozen=True)
class Pair:
    """A pair ready for separation, on the no-flash photograph's scale.

    no_flash, flash: (H, W, 3) linear camera RGB, 1.0 = white level of the no-flash
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
    clipped: share of the picture that is clipped in one of the photographs, 0…1.
    white: the value at which a highlight is clipped: 1, or infinite for float files that go on.
    """

    no_flash: Photograph
    flash: Photograph
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
    clipped: float
    white: float
    warnings: tuple[Remark, ...]

    def flash_part(self) -> Image:
        """Light of the flash alone, (H, W, 3); noise makes some of it negative."""
        return self.flash[:] if self.flash_only else self.flash[:] - self.no_flash[:]


def make_pair(no_flash: Frame, flash: Frame, options: PairOptions, progress: Progress) -> Pair:
    """Bring two frames on one scale and lay the flash frame on the other.

    Raises PairMismatchError for frames that do not belong together, UnusablePairError when there
    is no light to separate, OptionError for an exposure ratio that cannot be.
    """
    check_belonging(no_flash, flash, options.flash_only)
    rendered = no_flash.encoding == "srgb"
    ratio = written_ratio(no_flash, flash, options)
    check_light(no_flash, flash)
    check_colours(no_flash, flash)
    warnings = _rendering_warnings(no_flash, flash, ratio.value) if rendered else []
    white = np.inf if _goes_on(no_flash) or _goes_on(flash) else 1.0

    progress.report("align", 0.0)
    alignment = NOT_ATTEMPTED
    pixels, saturated, parallax = flash.pixels, flash.saturated, 0.0
    if options.align:
        alignment = estimate_alignment(no_flash.pixels, pixels)
        progress.report("align", 0.4)
        if alignment.problem:
            warnings.append(Remark(Code.NOT_ALIGNED, alignment.problem))
        else:
            pixels, saturated, parallax = _laid_on(no_flash.pixels, flash, alignment)
    progress.report("align", 0.6)
    if ratio.value != 1.0:
        pixels = _divided(pixels, ratio.value, pixels is not flash.pixels)
    noises = (
        _noise(no_flash.pixels, pixels, no_flash),
        _noise(pixels, no_flash.pixels, flash, ratio.value),
    )
    unusable = no_flash.saturated | saturated
    moved = darkened = 0.0
    if not options.flash_only:
        progress.report("align", 0.7)
        ratios = block_ratios(no_flash.pixels, pixels, unusable, noises)
        settled, doubts = settled_ratio(ratio, ratios, rendered)
        warnings += doubts
        if settled.value != ratio.value:
            pixels = _divided(pixels, settled.value / ratio.value, pixels is not flash.pixels)
            noises = noises[0], noises[1].divided(settled.value / ratio.value)
            ratios = block_ratios(no_flash.pixels, pixels, unusable, noises)
        ratio = settled
        check_flash_adds(no_flash.pixels, pixels, unusable, noises, options.exposure_ratio)
        progress.report("align", 0.8)
        if alignment.problem is None:
            photographs = no_flash.pixels, pixels
            there, darkened = _moved_or_darkened(
                photographs, unusable, noises, rendered, brightening(ratios)
            )
            moved = float(there.mean())
            unusable = unusable | there
            ratios = ratios.without(there)
        if not doubts:
            darkened = max(darkened, darker_share(ratios, rendered))
            warnings += _darkening_warnings(ratio, ratios, darkened)
        warnings += _unsteady_warnings(ratios, moved)
    progress.report("align", 0.9)
    pair = Pair(
        no_flash=no_flash.pixels,
        flash=pixels,
        unusable=releasable(unusable),
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
        clipped=float(np.mean(no_flash.saturated | flash.saturated)),
        white=white,
        warnings=(*warnings, *_copy_warnings(no_flash.pixels, pixels, options.flash_only)),
    )
    progress.report("align", 1.0)
    return pair


def _goes_on(frame: Frame) -> bool:
    """Whether values above 1 say that nothing was cut off there, as floats of linear light may."""
    if frame.encoding != "linear" or isinstance(frame.pixels, CodedImage):
        return False
    return float(frame.pixels.max()) > 1 and not frame.saturated.any()


def _divided(pixels: Photograph, by: float, own: bool) -> Photograph:
    """Divide all values; those of pixels that nobody else holds in their own memory."""
    if isinstance(pixels, CodedImage):
        return pixels.divided(by)
    return np.divide(pixels, np.float32(by), out=pixels if own else empty_image(*pixels.shape))


def _noise(pixels: Photograph, other: Photograph, frame: Frame, ratio: float = 1.0) -> Noise:
    """The noise of a frame's pixels, laid elsewhere and divided by a ratio as they may be.

    other: the other photograph of the pair.
    """
    noise = estimate_noise(pixels, other)
    return noise if frame.compression is None else noise.plus(frame.compression.divided(ratio))


def _laid_on(
    no_flash: Photograph, flash: Frame, alignment: Alignment
) -> tuple[Photograph, Mask, float]:
    """Flash frame and its mask on the no-flash frame's pixels, and the share that has parallax."""
    pixels, saturated = flash.pixels, flash.saturated
    if alignment.applied:
        pixels, saturated = warp(pixels, saturated, alignment)
    flow = residual_flow(no_flash, pixels)
    if flow is None:
        return pixels, saturated, 0.0
    del pixels, saturated  # not one more photograph in memory
    pixels, saturated = warp_along(flash.pixels, flash.saturated, alignment, flow)
    return pixels, saturated, float(np.mean(np.abs(flow).max(axis=2) > _PARALLAX_PX))


def _moved_or_darkened(
    photographs: tuple[Photograph, Photograph],
    unusable: Mask,
    noises: tuple[Noise, Noise],
    rendered: bool,
    brighter: float,
) -> tuple[Mask, float]:
    """What moved, and the share of the picture that seemed to, but is only darker with the flash.

    brighter: times which the flash photograph must be taken for nothing to be darker.
    """
    there = find_moved(*photographs, unusable, noises, rendered)
    share = float(there.mean())
    if share <= _NOTABLE_MOTION:
        return there, 0.0
    # what has moved has edges that no brightness explains
    still = find_moved(*photographs, unusable, noises, rendered, brighter)
    return (still, share) if still.mean() < _STILL * share else (there, 0.0)


def _darkening_warnings(ratio: ExposureRatio, ratios: Ratios, share: float) -> list[Remark]:
    """Why a share of the picture is darker with the flash than without, though nothing moved."""
    if ratio.source == "option":  # people err more often than cameras
        return [darkening(ratio, ratios, share)] if share > _NOTABLE_DARKENING else []
    if share <= _NOTABLE_DIMMING:
        return []
    message = (
        f"In {share:.1%} of the picture a lamp or daylight was weaker in the flash photograph "
        "than in the other: wait for steady light, and under lamps on the mains expose for a "
        "multiple of 1/100 s (1/120 s where the mains has 60 Hz)."
    )
    return [Remark(Code.LIGHT_CHANGED, message, {"share": share})]


def _unsteady_warnings(ratios: Ratios, moved: float) -> list[Remark]:
    """What moved or flickered between the photographs, and how to shoot without it."""
    warnings = []
    if moved > _NOTABLE_MOTION:
        message = (
            f"Something moved between the photographs in {moved:.1%} of the picture; the layers "
            "are filled in there from their surroundings. Keep people and things still, and take "
            "the two photographs in quick succession."
        )
        warnings.append(Remark(Code.MOVED, message, {"share": moved}))
    height = bands(ratios)
    if height is not None:
        message = (
            f"Bands of {height:.1%} of the light run across the picture: a lamp flickers with the "
            "mains. Expose for a multiple of 1/100 s (1/120 s where the mains has 60 Hz), or use "
            "the mechanical shutter."
        )
        warnings.append(Remark(Code.FLICKER, message, {"height": height}))
    return warnings


def _rendering_warnings(no_flash: Frame, flash: Frame, ratio: float) -> list[Remark]:
    """What a camera's rendering to sRGB may have done to one photograph and not to the other."""
    warnings = []
    if no_flash.auto_white_balance and flash.auto_white_balance:
        message = (
            "The camera balanced the white of each photograph by itself, so their colours may "
            "differ by more than the flash: lock the white balance, or send RAW files."
        )
        warnings.append(Remark(Code.AUTO_WHITE_BALANCE, message))
    if abs(np.log2(ratio)) > _EXPOSURES_DIFFER:
        message = (
            f"The photographs were exposed differently ({ratio:.3g} times) and rendered to sRGB, "
            "so they compare only as far as the camera kept to the sRGB curve: expose both alike, "
            "or send RAW files."
        )
        warnings.append(Remark(Code.RENDERED_EXPOSURES_DIFFER, message, {"ratio": ratio}))
    return warnings


def _copy_warnings(no_flash: Photograph, flash: Photograph, flash_only: bool) -> list[Remark]:
    """Notice a flash part that is the no-flash photograph over again."""
    height, width = no_flash.shape[:2]
    size = (max(width // _COPY_BLOCK, 1), max(height // _COPY_BLOCK, 1))
    before, after = (area_means(image, size) for image in (no_flash, flash))
    part = after if flash_only else after - before
    lit = (before > 0).all(axis=2) & (part > 0).all(axis=2)
    if not lit.any():
        return []
    before, part = before[lit], part[lit]
    if _spread(part.sum(axis=1) / before.sum(axis=1)) > _COPY_SPREAD:
        return []
    if _spread(part / before) > _COPY_COLOUR_SPREAD:  # a lamp that shines like the flash
        return []
    message = (
        "What the flash added looks like the photograph without it in most of the picture: the "
        "flash may not reach that far, or the exposure ratio is wrong. Bring the flash nearer or "
        "raise its power, or pass the right exposure ratio."
    )
    return [Remark(Code.FLASH_LIKE_LAMPS, message)]


def _spread(ratio: NDArray[Any]) -> float:
    """Stops between the quartiles."""
    low, high = np.quantile(np.log2(ratio), [0.25, 0.75])
    return float(high - low)
