"""What people are told of a pair: how it was exposed, what changed between its photographs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.decode.samples import turns_sides
from pipeline.images.area_means import area_means
from pipeline.images.frames import Frame, Photograph
from pipeline.pair.align import Alignment
from pipeline.pair.banding import Banding
from pipeline.pair.exposure import ExposureRatio, darkening
from pipeline.pair.flicker import bands
from pipeline.pair.pair_checks import FLASH, NO_FLASH, is_grey
from pipeline.pair.ratios import Ratios
from pipeline.pair.relative_blur import RelativeBlur
from pipeline.pair.rendering import Rendering
from pipeline.pair.vignetting import Vignetting
from pipeline.run_warnings import Code, RunWarning

NOTABLE_MOTION = 0.002
"""Share of the picture; less is not told of."""

_EXPOSURES_DIFFER = 0.15  # in stops
_COPY_BLOCK = 8  # pixels averaged, against noise
_COPY_SPREAD = 0.4  # stops between the quartiles of flash part ÷ no-flash light
_COPY_COLOUR_SPREAD = 0.25  # the same of channels against all three: a copy has the lamps' colour
_NOTABLE_DIMMING, _NOTABLE_DARKENING = 0.01, 0.002  # shares of the picture that are told of


def orientation_warnings(no_flash: Frame, flash: Frame) -> list[RunWarning]:
    """Tell of a flash photograph that was not turned as its file says, but as the other."""
    if flash.orientation == flash.written_orientation:
        return []
    message = (
        f"By its EXIF the photograph without the flash is to be turned another way (orientation "
        f"{no_flash.orientation}) than the one with it (orientation {flash.written_orientation}). "
        "Cameras that look down or lie flat write that without having been moved, so that both "
        "were turned as the one without the flash: if the camera was turned between them, take "
        "the pair again."
    )
    figures = {"no_flash": no_flash.orientation, "flash": flash.written_orientation}
    return [RunWarning(Code.ORIENTATIONS_DIFFER, message, figures)]


def baseline_warnings(no_flash: Frame, flash: Frame, ratio: ExposureRatio) -> list[RunWarning]:
    """Tell of two DNGs that may hold their light on two scales, unless a ratio was given."""
    apart = no_flash.baseline_ev - flash.baseline_ev
    if ratio.source == "option" or abs(apart) <= _EXPOSURES_DIFFER:
        return []
    other = float(ratio.value * 2**apart)
    message = (
        f"By their BaselineExposure the two DNGs are shown differently bright by {abs(apart):.2g} "
        "stops, so that whoever wrote them may have scaled one. A ratio of the exposures of "
        f"{ratio.value:.3g} was taken: if layers look wrong, pass {other:.3g}."
    )
    figures = {"ratio": ratio.value, "ratio_by_baseline": other}
    return [RunWarning(Code.EXPOSURE_MISMATCH, message, figures)]


def encoding_warnings() -> list[RunWarning]:
    """Tell of values that were read as linear and follow a curve."""
    message = (
        "The photographs were read as linear values, but look encoded for a screen, as by the "
        "curve of sRGB: through it the flash's light has one colour on one surface, as they are "
        "it has not. Their layers would be wrong. Pass the encoding srgb, or send linear values "
        "or RAW files."
    )
    return [RunWarning(Code.ENCODING_DOUBTFUL, message)]


def rendering_warnings(
    no_flash: Frame, flash: Frame, ratio: float, rendering: Rendering
) -> list[RunWarning]:
    """What a camera's rendering to sRGB may have done to one photograph and not to the other.

    rendering: that was found and taken off.
    """
    warnings = []
    mapping, balance = rendering.mapping, rendering.balance
    grey = [is_grey(no_flash), is_grey(flash)]
    if any(grey) and not all(grey):
        message = (
            f"The {NO_FLASH if grey[0] else FLASH} is grey, the other one coloured: if its colours "
            "were taken out, no layer is right. Send both as the camera made them in colour."
        )
        warnings.append(RunWarning(Code.ONE_GREY, message))
    if mapping is not None:
        factors = mapping.entry()
        message = (
            "The camera brightened shadows and darkened highlights of the two photographs "
            "differently (local tone mapping, as phones and HDR do it). The pair shows it, and "
            f"parts of the flash photograph were multiplied by {factors['least']:.2f} to "
            f"{factors['most']:.2f} for it, as far as a pair tells: switch HDR and the like off, "
            "or send RAW files."
        )
        warnings.append(RunWarning(Code.LOCAL_TONE_MAPPING, message, factors))
    if balance is not None:
        message = (
            "The camera balanced the white of the flash photograph otherwise than that of the "
            f"other: red times {balance.red:.2f}, blue times {balance.blue:.2f}. The pair shows "
            "it, and it was taken off as far as a pair tells: lock the white balance, or send RAW "
            "files."
        )
        warnings.append(RunWarning(Code.AUTO_WHITE_BALANCE, message, balance.entry()))
    elif no_flash.auto_white_balance or flash.auto_white_balance:
        both = no_flash.auto_white_balance and flash.auto_white_balance
        message = (
            f"The camera balanced the white of {'each' if both else 'one'} photograph by itself, "
            "so their colours may differ by more than the flash: lock the white balance, or send "
            "RAW files."
        )
        warnings.append(RunWarning(Code.AUTO_WHITE_BALANCE, message))
    if abs(np.log2(ratio)) > _EXPOSURES_DIFFER:
        message = (
            f"The photographs were exposed differently ({ratio:.3g} times) and rendered to sRGB, "
            "so they compare only as far as the camera kept to the sRGB curve: expose both alike, "
            "or send RAW files."
        )
        warnings.append(RunWarning(Code.RENDERED_EXPOSURES_DIFFER, message, {"ratio": ratio}))
    return warnings


def alignment_warnings(alignment: Alignment) -> list[RunWarning]:
    """Why the flash photograph could not be laid on the other."""
    return [RunWarning(Code.NOT_ALIGNED, alignment.problem)] if alignment.problem else []


def blur_warnings(blur: RelativeBlur) -> list[RunWarning]:
    """Which photograph is less sharp than the other, and what came of it."""
    warnings = []
    if blur.no_flash.any():
        message = (
            f"The {NO_FLASH} is less sharp than the other, by a blur of {blur.no_flash_px:.2g} "
            "pixels (standard deviation): it was shaken or focused elsewhere. The flash "
            "photograph was blurred as much, and layers have no finer detail. Use a tripod or a "
            "shorter exposure, and lock the focus."
        )
        warnings.append(RunWarning(Code.BLURRED, message, {"no_flash_px": blur.no_flash_px}))
    if blur.flash.any():
        message = (
            f"The {FLASH} is less sharp than the other, by a blur of {blur.flash_px:.2g} pixels "
            "(standard deviation): it was shaken or focused elsewhere. Lamps are told by the other "
            "blurred as much, and layers share out fine detail alike. Lock the focus, and take the "
            "pair again."
        )
        warnings.append(RunWarning(Code.BLURRED, message, {"flash_px": blur.flash_px}))
    return warnings


def darkening_warnings(ratio: ExposureRatio, ratios: Ratios, share: float) -> list[RunWarning]:
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
    return [RunWarning(Code.LIGHT_CHANGED, message, {"share": share})]


def moved_warnings(moved: float) -> list[RunWarning]:
    """What moved between the photographs. moved: share of the picture, 0…1."""
    if moved <= NOTABLE_MOTION:
        return []
    message = (
        f"Something moved between the photographs in {moved:.1%} of the picture; the layers "
        "are a guess there, and where shadows fell elsewhere as well. Lamps are told by the rest, "
        "as far as that was noticed. Keep people and things still, and take the two photographs "
        "in quick succession."
    )
    return [RunWarning(Code.MOVED, message, {"share": moved})]


def rows_are_columns(shape: tuple[int, ...], orientation: int) -> bool:
    """Whether rows of the sensor are columns of a picture of shape (rows, columns).

    orientation: EXIF's, 1–8, by which the sensor's picture was turned.
    """
    # sensors lie; who turned the pixels themselves left no orientation
    return turns_sides(orientation) or shape[0] > shape[1]


def flicker_warnings(ratios: Ratios, banding: Banding | None, by_columns: bool) -> list[RunWarning]:
    """Tell of lamps that flickered, and how to shoot without it.

    ratios: of the photographs as they are separated. banding: that was taken off. by_columns:
    whether the sensor's rows are the picture's columns.
    """
    height = bands(ratios.transposed() if by_columns else ratios) if banding is None else None
    if banding is not None:
        height = banding.height
    if height is None:
        return []
    off = "The pair shows it, and it was taken off as far as a pair tells: expose"
    message = (
        f"Bands of {height:.1%} of the light run across the picture: a lamp flickers with the "
        f"mains. {'Expose' if banding is None else off} for a multiple of 1/100 s (1/120 s where "
        "the mains has 60 Hz), or use the mechanical shutter."
    )
    return [RunWarning(Code.FLICKER, message, {"height": height})]


def vignetting_warnings(vignetting: Vignetting | None) -> list[RunWarning]:
    """Tell of corners that were darker in one photograph, and what came of it."""
    if vignetting is None:
        return []
    corners = vignetting.corners
    darker, other = (FLASH, NO_FLASH) if corners < 0 else (NO_FLASH, FLASH)
    share = -corners if corners < 0 else corners / (1 + corners)
    message = (
        f"The corners of the {darker} are {share:.0%} darker than those of the {other}, by "
        "another aperture or a lens correction of one of them. The pair shows it, and it was taken "
        "off the flash photograph as far as a pair tells: use one aperture, and the same lens "
        "correction for both or none."
    )
    return [RunWarning(Code.VIGNETTING, message, {"corners": corners})]


def copy_warnings(no_flash: Photograph, flash: Photograph, flash_only: bool) -> list[RunWarning]:
    """Notice a flash part that is the no-flash photograph over again."""
    height, width = no_flash.shape[:2]
    size = (max(width // _COPY_BLOCK, 1), max(height // _COPY_BLOCK, 1))
    before, after = (area_means(image, size) for image in (no_flash, flash))
    part = after if flash_only else after - before
    lit = (before > 0).all(axis=2) & (part > 0).all(axis=2)
    if not lit.any():
        return []
    before, part = before[lit], part[lit]
    ratio = part.sum(axis=1) / before.sum(axis=1)
    if _spread(ratio) > _COPY_SPREAD:
        return []
    if _spread(part / before / ratio[:, None]) > _COPY_COLOUR_SPREAD:  # lamps as even as the flash
        return []
    message = (
        "What the flash added looks like the photograph without it in most of the picture: the "
        "flash may not reach that far, or the exposure ratio is wrong. Bring the flash nearer or "
        "raise its power, or pass the right exposure ratio."
    )
    return [RunWarning(Code.FLASH_LIKE_LAMPS, message)]


def _spread(ratio: NDArray[Any]) -> float:
    """Stops between the quartiles."""
    low, high = np.quantile(np.log2(ratio), [0.25, 0.75])
    return float(high - low)
