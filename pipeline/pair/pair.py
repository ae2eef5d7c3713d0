"""Two photographs on one scale: what the lamps gave, what the flash added, what can be used."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.images.coded_image import CodedImage
from pipeline.images.frames import Frame, Image, Mask, Photograph
from pipeline.images.memory import empty_image, releasable
from pipeline.images.noise import Noise
from pipeline.options import PairOptions
from pipeline.pair.align import NOT_ATTEMPTED, Alignment, estimate_alignment, warp
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.estimate_noise import estimate_noises
from pipeline.pair.exposure import ExposureRatio, settled_ratio, written_ratio
from pipeline.pair.find_banding import find_banding
from pipeline.pair.find_encoding import looks_encoded
from pipeline.pair.find_vignetting import find_vignetting
from pipeline.pair.flow import residual_flow, warp_along
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.motion import find_moved
from pipeline.pair.pair_checks import check_belonging, check_colours, check_flash_adds, check_light
from pipeline.pair.pair_warnings import (
    NOTABLE_MOTION,
    alignment_warnings,
    baseline_warnings,
    blur_warnings,
    copy_warnings,
    darkening_warnings,
    encoding_warnings,
    flicker_warnings,
    moved_warnings,
    orientation_warnings,
    rendering_warnings,
    rows_are_columns,
    vignetting_warnings,
)
from pipeline.pair.ratios import block_ratios, brightening, darker_share
from pipeline.pair.relative_blur import blurred, blurred_mask, find_relative_blur
from pipeline.pair.rendering import Rendering, find_rendering
from pipeline.pair.tone_curve import ToneCurve
from pipeline.progress import Progress
from pipeline.run_warnings import RunWarning

_PARALLAX_PX = 0.5  # beside where the homography lays a pixel; less is the flow's error
_REGISTRATION_PX = 0.35  # of alignment and interpolation, measured
_STILL = 0.25  # of what seems to have moved may be left in a brighter photograph


@dataclass(frozen=True)
class Pair:
    """A pair ready for separation, on the no-flash photograph's scale.

    no_flash, flash: (H, W, 3) linear camera RGB, 1.0 = white level of the no-flash
        photograph as given. flash is the flash photograph, laid on the other and divided by
        exposure_ratio, or the flash part alone when flash_only. One that was sharper is blurred as
        much as the other.
    photograph: (H, W, 3), the no-flash photograph as it is, which layers add up to; no_flash
        itself but where that was blurred.
    unusable: bool (H, W), saturated or transparent in either, without counterpart, or showing
        something that moved.
    exposure_source: where exposure_ratio comes from, see ExposureRatio.
    rendered: whether a camera's rendering to sRGB has bent the values.
    tone_curve: the contrast that it put on top of sRGB's curve, which has been taken off both
        photographs; None where none was found.
    local_tone_mapping: what it made of the flash photograph locally and not of the other, which has
        been taken off that; None where nothing was found.
    balance_change: by how much it balanced the white of the flash photograph otherwise, which has
        been taken off that; None where nothing was found.
    no_flash_noise, flash_noise: the noise of each.
    registration_px: standard deviation of what the flash photograph lies beside the other; 0 where
        it was taken as it is.
    parallax: share of the picture that lies elsewhere than the homography says, 0…1.
    moved: share of the picture in which something moved, 0…1.
    clipped: share of the picture that is clipped in one of the photographs, 0…1.
    clipping: the value at which the no-flash photograph, and so the sum of the layers, is clipped:
        1, or infinite for float files that go on.
    """

    no_flash: Photograph
    flash: Photograph
    photograph: Photograph
    unusable: Mask
    flash_only: bool
    exposure_ratio: float
    exposure_source: str
    rendered: bool
    tone_curve: ToneCurve | None
    local_tone_mapping: LocalToneMapping | None
    balance_change: BalanceChange | None
    no_flash_noise: Noise
    flash_noise: Noise
    alignment: Alignment
    registration_px: float
    parallax: float
    moved: float
    clipped: float
    clipping: float
    warnings: tuple[RunWarning, ...]

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
    written = written_ratio(no_flash, flash, options)
    check_light(no_flash, flash)
    check_colours(no_flash, flash)
    clipping = _clipping(no_flash, flash, options.flash_only)
    progress.report("align", 0.0)
    laid = _Laid(flash.pixels, flash.unusable, NOT_ATTEMPTED, 0.0)
    if options.align:
        laid = _laid_on(no_flash.pixels, flash, progress)
    progress.report("align", 0.6)
    rendering = Rendering()
    if rendered and not options.flash_only:
        unusable = no_flash.unusable | laid.unusable
        rendering = find_rendering(no_flash, flash, laid.pixels, unusable, written)
        no_flash = rendering.off_no_flash(no_flash)
        flash, pixels = rendering.off_flash(flash, laid.pixels)
        laid = replace(laid, pixels=pixels)
    progress.report("align", 0.65)
    known = rendering.ratio or written
    held = _held_against(no_flash, flash, laid, known, options, progress)
    progress.report("align", 0.9)
    pair = Pair(
        no_flash=held.no_flash,
        flash=held.flash,
        photograph=no_flash.pixels,
        unusable=releasable(held.unusable),
        flash_only=options.flash_only,
        exposure_ratio=held.ratio.value,
        exposure_source=held.ratio.source,
        rendered=rendered,
        tone_curve=rendering.tone,
        local_tone_mapping=rendering.mapping,
        balance_change=rendering.balance,
        no_flash_noise=held.noises[0],
        flash_noise=held.noises[1],
        alignment=laid.alignment,
        registration_px=_REGISTRATION_PX * float(laid.alignment.applied or laid.parallax > 0),
        parallax=laid.parallax,
        moved=held.moved,
        clipped=float(np.mean(no_flash.saturated | flash.saturated)),
        clipping=clipping,
        warnings=(
            *orientation_warnings(no_flash, flash),
            *baseline_warnings(no_flash, flash, written),
            *(rendering_warnings(no_flash, flash, known.value, rendering) if rendered else ()),
            *alignment_warnings(laid.alignment),
            *held.warnings,
            *copy_warnings(no_flash.pixels, held.flash, options.flash_only),
        ),
    )
    progress.report("align", 1.0)
    return pair


@dataclass(frozen=True)
class _Laid:
    """The flash frame's pixels and mask on the no-flash frame's, and the share with parallax."""

    pixels: Photograph
    unusable: Mask
    alignment: Alignment
    parallax: float


def _laid_on(no_flash: Photograph, flash: Frame, progress: Progress) -> _Laid:
    """Lay the flash frame on the other, or leave it where no alignment is found."""
    alignment = estimate_alignment(no_flash, flash.pixels)
    progress.report("align", 0.4)
    pixels, unusable = flash.pixels, flash.unusable
    if alignment.problem:
        return _Laid(pixels, unusable, alignment, 0.0)
    if alignment.applied:
        pixels, unusable = warp(pixels, unusable, alignment)
    flow = residual_flow(no_flash, pixels)
    if flow is None:
        return _Laid(pixels, unusable, alignment, 0.0)
    del pixels, unusable  # not one more photograph in memory
    pixels, unusable = warp_along(flash.pixels, flash.unusable, alignment, flow)
    parallax = float(np.mean(np.abs(flow).max(axis=2) > _PARALLAX_PX))
    return _Laid(pixels, unusable, alignment, parallax)


@dataclass(frozen=True)
class _Held:
    """What comes of holding the flash photograph, laid on the other, against it.

    flash: on the other's scale. The rest as in Pair.
    """

    no_flash: Photograph
    flash: Photograph
    noises: tuple[Noise, Noise]
    ratio: ExposureRatio
    unusable: Mask
    moved: float = 0.0
    warnings: tuple[RunWarning, ...] = ()


def _held_against(
    no_flash: Frame,
    flash: Frame,
    laid: _Laid,
    ratio: ExposureRatio,
    options: PairOptions,
    progress: Progress,
) -> _Held:
    """Bring the flash photograph on the other's scale, and find what does not lie still.

    ratio: what was given or written. Raises UnusablePairError and OptionError as make_pair.
    """
    before, after, rendered = no_flash.pixels, laid.pixels, no_flash.encoding == "srgb"
    if ratio.value != 1.0:
        after = _divided(after, ratio.value, after is not flash.pixels)
    unusable = no_flash.unusable | laid.unusable
    noises = _noises(before, after, unusable, no_flash, flash, ratio.value)
    if options.flash_only:
        return _Held(before, after, noises, ratio, unusable)
    progress.report("align", 0.7)
    ratios = block_ratios(before, after, unusable, noises)
    blur = find_relative_blur(ratios, unusable)
    if blur is not None and blur.no_flash.any():
        kernel = blur.for_flash
        after = blurred(after, kernel, own=after is not flash.pixels)
        unusable = unusable | blurred_mask(laid.unusable, kernel)
        noises = noises[0], noises[1].blurred(float(np.square(kernel).sum()))
    if blur is not None and blur.flash.any():
        kernel = blur.for_no_flash
        before = blurred(before, kernel)
        unusable = unusable | blurred_mask(no_flash.unusable, kernel)
        noises = noises[0].blurred(float(np.square(kernel).sum())), noises[1]
    if blur is not None:
        ratios = block_ratios(before, after, unusable, noises)
    by_columns = rows_are_columns(unusable.shape, no_flash.orientation)
    encoded = no_flash.undeclared and looks_encoded(ratios, ratio.value)
    banding = None if rendered or encoded else find_banding(ratios, by_columns)
    if banding is not None:
        after = banding.off(before, after)
        ratios = block_ratios(before, after, unusable, noises)
    look = not (rendered or encoded) and banding is None  # less than one band looks alike
    vignetting = find_vignetting(ratios) if look else None
    if vignetting is not None:
        after = vignetting.off(after)
        ratios = block_ratios(before, after, unusable, noises)
    settled, doubts = ratio, encoding_warnings()
    if not encoded:  # such values tell no ratio
        settled, doubts = settled_ratio(ratio, ratios, rendered)
    if settled.value != ratio.value:
        after = _divided(after, settled.value / ratio.value, after is not flash.pixels)
        noises = noises[0], noises[1].divided(settled.value / ratio.value)
        ratios = block_ratios(before, after, unusable, noises)
    check_flash_adds(before, after, unusable, noises, options.exposure_ratio)
    progress.report("align", 0.8)
    moved = darkened = 0.0
    if laid.alignment.problem is None:
        there, darkened = _moved_or_darkened(
            (before, after), unusable, noises, rendered, brightening(ratios)
        )
        moved = float(there.mean())
        unusable = unusable | there
        ratios = ratios.without(there)
    warnings = [*doubts, *(blur_warnings(blur) if blur is not None else ())]
    if not doubts:
        darkened = max(darkened, darker_share(ratios, rendered))
        warnings += darkening_warnings(settled, ratios, darkened)
    warnings += moved_warnings(moved)
    warnings += flicker_warnings(ratios, banding, by_columns)
    warnings += vignetting_warnings(vignetting)
    return _Held(before, after, noises, settled, unusable, moved, tuple(warnings))


def _clipping(no_flash: Frame, flash: Frame, flash_only: bool) -> float:
    """The value at which the no-flash photograph is clipped, infinite where it is not.

    Of one that stays below 1 the flash photograph tells, which is written as it was; a flash part
    alone, whatever its units are, does not.
    """
    if no_flash.encoding != "linear" or no_flash.saturated.any():
        return 1.0
    return np.inf if _goes_on(no_flash) or (not flash_only and _goes_on(flash)) else 1.0


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


def _noises(
    before: Photograph,
    after: Photograph,
    unusable: Mask,
    no_flash: Frame,
    flash: Frame,
    ratio: float,
) -> tuple[Noise, Noise]:
    """The noise of both frames' pixels, the flash frame's laid elsewhere and divided by a ratio."""
    compressed = no_flash.compression is not None or flash.compression is not None
    first, second = estimate_noises(before, after, unusable, compressed)
    if no_flash.compression is not None:
        first = first.plus(no_flash.compression)
    if flash.compression is not None:
        second = second.plus(flash.compression.divided(ratio))
    return first, second


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
    if share <= NOTABLE_MOTION:
        return there, 0.0
    # what has moved has edges that no brightness explains
    still = find_moved(*photographs, unusable, noises, rendered, brighter)
    return (still, share) if still.mean() < _STILL * share else (there, 0.0)
