"""A flash found by a chart or card: its file, what is said of it, and doubts."""

from __future__ import annotations

import numpy as np

from pipeline.calibration.chart import read_card, read_chart
from pipeline.calibration.find_marks import draw_marks, find_chart
from pipeline.calibration.flash_doubts import flash_doubts
from pipeline.calibration.flash_spectrum import estimate_flash
from pipeline.calibration.found import Found, said_of_marks
from pipeline.calibration.options import FlashCalibration
from pipeline.calibration.patches import Patches
from pipeline.colour.temperature import cct_duv
from pipeline.errors import UnusablePairError
from pipeline.images.frames import Frame
from pipeline.lamps.whose_colours import names_no_camera, no_sensors_values
from pipeline.options import Spectrum
from pipeline.pair.pair import Pair
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera, find_camera
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.tables import write_spectrum
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from pipeline.taken_with import TakenWith

_GREY_CARD = 0.18  # reflectance
_TAKEN_FOR_SRGB = (
    "The files do not tell whose colours they hold, and were taken for linear sRGB: name their "
    "camera with --camera."
)


def calibrate_flash(pair: Pair, frame: Frame, options: FlashCalibration) -> Found:
    """Find the spectrum of the flash by a chart or card of a pair.

    frame: the no-flash photograph, of which EXIF counts. A chart is looked for where neither it nor
    a card is told. Raises OptionError for an unknown camera and for marks that cannot be, MarkError
    where there is no one chart, UnusablePairError where it cannot be read or explained.
    """
    camera = find_camera(options.camera, frame)
    warnings = _camera_warnings(frame, camera, options.camera is not None)
    chart, card = options.chart, options.card
    if chart is None and card is None:
        chart = find_chart(pair)
    if chart is not None:
        patches = read_chart(pair, chart)
    else:
        assert card is not None
        patches = read_card(pair, card)
    try:
        flash = estimate_flash(patches, camera.sensitivities)
    except UnusablePairError as error:
        if options.camera is not None or not names_no_camera(camera, frame):
            raise
        raise UnusablePairError(f"{error} {_TAKEN_FOR_SRGB}") from error
    warnings += flash_doubts(flash, patches, camera, frame)
    white = cct_duv(cie_1931() @ flash.spectrum)
    table = Spectrum(
        wavelength_nm=WAVELENGTHS_NM.tolist(),
        power=flash.spectrum.tolist(),
        taken_with=TakenWith.of(frame),
    )
    said = {
        "camera": {"name": camera.name, "source": camera.source},
        "nearest": flash.nearest,
        "cct_k": None if white is None else round(white[0]),
        "duv": None if white is None else round(white[1], 4),
        "patches": len(patches.flash),
        "misfit": round(flash.misfit, 4),
        "strength": _strength(patches),
        **said_of_marks(chart, card),
    }
    return Found(write_spectrum(table), said, draw_marks(pair, chart, card), warnings)


def _camera_warnings(frame: Frame, camera: Camera, named: bool) -> list[RunWarning]:
    """Warn of a camera that is a guess or does not fit, whose error goes to the flash's spectrum.

    named: whether the user named it.
    """
    if frame.in_colour_space:
        return [no_sensors_values(frame, named, "the spectrum of the flash")]
    if not camera.approximate:
        if named or not frame.undeclared:
            return []
        message = (
            f"The files name the {camera.name}, and do not say whether they hold what its sensor "
            "gives, as was assumed, or what a converter made of that: the spectrum of the flash "
            "may be wrong. Send RAW files, or name the camera with --camera if they do."
        )
        return [RunWarning(Code.CAMERA_APPROXIMATE, message)]
    message = (
        "The camera's spectral sensitivities are not known and were approximated, and so is the "
        "spectrum of the flash"
    )
    if names_no_camera(camera, frame):
        message += f". {_TAKEN_FOR_SRGB}"
    else:
        message += ": name a measured camera or send its table for exact work."
    return [RunWarning(Code.CAMERA_APPROXIMATE, message)]


def _strength(patches: Patches) -> float:
    """Green light of the flash on a white card at the target, 1 the white level."""
    green = cie_1931()[1]
    reflectance = patches.reflectances @ green / green.sum()
    share = reflectance if len(patches.flash) > 1 else np.array([_GREY_CARD])
    bright = int(np.argmax(patches.flash[:, 1]))
    return round(float(patches.flash[bright, 1] / share[min(bright, len(share) - 1)]), 4)
