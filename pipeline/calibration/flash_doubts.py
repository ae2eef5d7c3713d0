"""What makes a flash doubtful that a calibration found, told from how it explains the patches."""

from __future__ import annotations

import numpy as np

from pipeline.calibration.flash_spectrum import FlashEstimate, log_evidence
from pipeline.calibration.patches import Patches
from pipeline.images.frames import Frame
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera, find_camera

# docs/decisions/0007-calibration.md
_CARD_MISFIT = 0.02  # white flashes and those behind weak gels stay below
_CHART_MISFIT = 0.055  # charts of other pigments, seen by the right camera, stay below
_FAR_LIKELIER = 12.0  # log evidence


def flash_doubts(
    flash: FlashEstimate, patches: Patches, camera: Camera, frame: Frame
) -> list[RunWarning]:
    """Warn of a flash that does not explain a card or chart, or would with the files' own camera.

    camera: that the patches were read with. frame: a photograph of the pair.
    """
    if len(patches.flash) == 1:
        return _of_card(flash) if flash.misfit > _CARD_MISFIT else []
    own = find_camera(None, frame)
    if own.source == "measured" and _far_likelier(own, camera, patches):
        message = (
            f"The {own.name}, which the files name, explains the chart far better than the camera "
            "that was named, whose error goes to the flash and to all colours: leave --camera out, "
            "or check it."
        )
        return [RunWarning(Code.CAMERA_DOUBTFUL, message)]
    if camera.approximate or frame.in_colour_space:  # which is told, and explains no chart well
        return []
    return _of_chart(flash) if flash.misfit > np.hypot(_CHART_MISFIT, patches.noise) else []


def _far_likelier(own: Camera, named: Camera, patches: Patches) -> bool:
    own_likely, named_likely = (log_evidence(patches, one.sensitivities) for one in (own, named))
    return own_likely - named_likely > _FAR_LIKELIER


def _of_card(flash: FlashEstimate) -> list[RunWarning]:
    message = (
        f"No flash that is known has the light of the card, which stays off by "
        f"{flash.misfit:.1%}, and with it all colours: check that the mark is on a grey card, "
        "and the camera. A flash behind a strong gel is told better by a ColorChecker."
    )
    return [RunWarning(Code.FLASH_DOUBTFUL, message, {"misfit": flash.misfit})]


def _of_chart(flash: FlashEstimate) -> list[RunWarning]:
    message = (
        f"The flash explains the patches to {flash.misfit:.1%} only, which is more than charts of "
        "other makes leave, and may be wrong, and with it all colours: check the camera and the "
        "marks, keep gloss and shadows off the chart, and make the flash the brighter light."
    )
    return [RunWarning(Code.FLASH_DOUBTFUL, message, {"misfit": flash.misfit})]
