"""The ratio of the exposures: what was given or written, held against the pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.errors import OptionError
from pipeline.images.frames import Frame
from pipeline.options import MOST_EXPOSURE_RATIO, PairOptions
from pipeline.pair.find_exposure_ratio import find_exposure_ratio
from pipeline.pair.ratios import Ratios, brightening, darker_share, ratio_without_flash
from pipeline.run_warnings import Code, RunWarning

_AGREES = 0.06  # natural logarithm; inter-reflected flash light alone makes 0.02
_AGREES_RENDERED = 0.35  # a camera's curves differ
_ADVICE = (
    "Pass the right exposure ratio, and if it was right, take both photographs in steady light: "
    "daylight or a lamp may have changed in between."
)
_RENDERED_ADVICE = (
    ", even if it is 1: whether the camera balanced white or mapped tones differently in the two "
    "is looked for only where it is known."
)
_MANY_DARKER = 0.15  # share of the picture that no lamp or motion makes darker


@dataclass(frozen=True)
class ExposureRatio:
    """Flash frame's exposure ÷ no-flash frame's.

    source: "option" when given, "exif", "pixels" when estimated, "assumed" when nothing is known.
    """

    value: float
    source: str


def written_ratio(no_flash: Frame, flash: Frame, options: PairOptions) -> ExposureRatio:
    """Take the ratio that was given, else the files', else 1; an absurd one raises OptionError."""
    if options.exposure_ratio is not None:
        return ExposureRatio(options.exposure_ratio, "option")
    ratio = flash.exposure.times(no_flash.exposure)
    if ratio is None:
        return ExposureRatio(1.0, "assumed")
    if not 1 / MOST_EXPOSURE_RATIO <= ratio <= MOST_EXPOSURE_RATIO:
        raise OptionError(
            f"The exposures in the files differ {ratio:.3g} times: pass the right ratio with "
            "exposure_ratio."
        )
    return ExposureRatio(ratio, "exif")


def settled_ratio(
    ratio: ExposureRatio, ratios: Ratios, rendered: bool
) -> tuple[ExposureRatio, list[RunWarning]]:
    """Hold a ratio against the pixels; returns the one to use and what to warn of.

    ratios: of the pair on the scale of that ratio. rendered: a camera made pictures of it, whose
    colours do not tell a ratio here: find_rendered_ratio was asked before. A ratio that was given,
    written or told by that is kept, one that nobody knows is estimated where that is safe.
    """
    if ratio.source == "pixels":
        return ratio, [_estimated(ratio.value)]
    by_colours = None if rendered else find_exposure_ratio(ratios)
    if by_colours is not None:
        return _held_against_colours(ratio, ratios, by_colours)
    peak = ratio_without_flash(ratios)
    if ratio.source == "assumed":
        if peak is None:
            message = (
                "The files do not say how they were exposed; equal exposures are taken for "
                f"granted{_unless_darker(ratio, ratios, rendered)}. Pass the exposure ratio"
                f"{_RENDERED_ADVICE if rendered else ' if they differ.'}"
            )
            return ratio, [RunWarning(Code.EXPOSURE_ASSUMED, message)]
        found = ExposureRatio(ratio.value * peak, "pixels")
        message = (
            "The files do not say how they were exposed; what the flash does not reach shows a "
            f"ratio of {found.value:.3g}, which was taken. Pass the exposure ratio if you know it."
        )
        return found, [RunWarning(Code.EXPOSURE_ESTIMATED, message, {"ratio": found.value})]
    if peak is not None:
        if abs(np.log(peak)) < (_AGREES_RENDERED if rendered else _AGREES):
            return ratio, []
        shown = ratio.value * peak
        message = (
            f"{_said(ratio)}, {ratio.value:.3g}, does not fit: what the flash does not reach shows "
            f"{shown:.3g}. {_ADVICE}"
        )
        figures = {"ratio": ratio.value, "ratio_shown": shown}
        return ratio, [RunWarning(Code.EXPOSURE_MISMATCH, message, figures)]
    return ratio, _doubted_if_darker(ratio, ratios, rendered)


def _held_against_colours(
    ratio: ExposureRatio, ratios: Ratios, factor: float
) -> tuple[ExposureRatio, list[RunWarning]]:
    """As settled_ratio; factor: of find_exposure_ratio."""
    if factor == 1.0:
        return ratio, _doubted_if_darker(ratio, ratios, False)
    shown = ratio.value * factor
    if ratio.source == "assumed":
        return ExposureRatio(shown, "pixels"), [_estimated(shown)]
    message = (
        f"{_said(ratio)}, {ratio.value:.3g}, does not fit: with it the flash's light has many "
        f"colours on one surface, with {shown:.3g} it has one. {_ADVICE}"
    )
    figures = {"ratio": ratio.value, "ratio_shown": shown}
    return ratio, [RunWarning(Code.EXPOSURE_MISMATCH, message, figures)]


def _estimated(ratio: float) -> RunWarning:
    message = (
        f"The files do not say how they were exposed. With a ratio of {ratio:.3g} the flash's "
        "light has one colour on one surface, with equal exposures it has not, so that ratio "
        "was taken. Pass the exposure ratio if you know it."
    )
    return RunWarning(Code.EXPOSURE_ESTIMATED, message, {"ratio": ratio})


def _doubted_if_darker(ratio: ExposureRatio, ratios: Ratios, rendered: bool) -> list[RunWarning]:
    share = darker_share(ratios, rendered)
    return [] if share < _MANY_DARKER else [darkening(ratio, ratios, share)]


def darkening(ratio: ExposureRatio, ratios: Ratios, share: float) -> RunWarning:
    """Warn of a given or written ratio that makes a share of the picture darker with the flash.

    ratios: of the pair on the scale of that ratio.
    """
    most = ratio.value / brightening(ratios)
    message = (
        f"{_said(ratio)}, {ratio.value:.3g}, makes {share:.1%} of the picture darker with the "
        f"flash than without: it can be {most:.3g} at most. {_ADVICE}"
    )
    figures = {"ratio": ratio.value, "ratio_at_most": most, "share": share}
    return RunWarning(Code.EXPOSURE_MISMATCH, message, figures)


def _said(ratio: ExposureRatio) -> str:
    return "The exposure ratio given" if ratio.source == "option" else "The files' exposure ratio"


def _unless_darker(ratio: ExposureRatio, ratios: Ratios, rendered: bool) -> str:
    share = darker_share(ratios, rendered)
    if share < _MANY_DARKER:
        return ""
    return (
        f", though {share:.0%} of the picture is then darker with the flash than without and the "
        f"ratio can be {ratio.value / brightening(ratios):.3g} at most"
    )
