"""A camera found by a chart: its file, what is said of it, and doubts of the flash."""

from __future__ import annotations

from pipeline.calibration.camera_sensitivities import estimate_camera, is_unlikely
from pipeline.calibration.chart import read_chart
from pipeline.calibration.find_marks import draw_marks, find_chart
from pipeline.calibration.flash_spectrum import FAMILY
from pipeline.calibration.found import Found, said_of_marks
from pipeline.calibration.options import CameraCalibration
from pipeline.images.frames import Frame
from pipeline.options import Sensitivities
from pipeline.pair.pair import Pair
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import find_camera, measured_cameras
from pipeline.spectra.lights import find_light, packaged_light
from pipeline.spectra.tables import write_sensitivities
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from pipeline.taken_with import TakenWith


def calibrate_camera(pair: Pair, frame: Frame, options: CameraCalibration) -> Found:
    """Find the spectral sensitivities of a camera by a chart of a pair.

    frame: the no-flash photograph, of which EXIF counts. The chart is looked for where it is not
    told, and the likeliest flash is taken where that is not. Raises OptionError for an unknown
    flash and for marks that cannot be, MarkError where there is no one chart, UnusablePairError
    where it cannot be read or explained.
    """
    given = options.flash_spectrum
    family = {name: packaged_light(name) for name in FAMILY}
    if given is None:
        flashes = family
    else:
        flashes = {given if isinstance(given, str) else "table": find_light(given)}
    known = measured_cameras()
    approximate = find_camera(None, frame)
    if approximate.source == "approximate":
        known.append(approximate)
    chart = options.chart or find_chart(pair)
    patches = read_chart(pair, chart)
    camera = estimate_camera(patches, flashes, known)
    warnings = []
    if given is None:
        message = (
            "The flash was not told and the likeliest was taken, so that the camera takes over "
            "what is wrong with it: calibrate the flash with a camera that is known, and name it "
            "with --flash-spectrum."
        )
        warnings.append(RunWarning(Code.FLASH_DOUBTFUL, message))
    elif is_unlikely(find_light(given), patches, family.values(), known):
        message = (
            "Other flashes explain the patches far better than the one that was named, whose "
            "error goes to the camera: check --flash-spectrum."
        )
        warnings.append(RunWarning(Code.FLASH_DOUBTFUL, message))
    said = {
        "nearest": camera.nearest,
        "flash": camera.flash,
        "known_cameras": len(known),
        "misfit": round(camera.misfit, 4),
        **said_of_marks(chart, None),
    }
    r, g, b = camera.sensitivities.tolist()
    nm, taken_with = WAVELENGTHS_NM.tolist(), TakenWith.of(frame)
    table = Sensitivities(wavelength_nm=nm, r=r, g=g, b=b, taken_with=taken_with)
    file = write_sensitivities(table)
    return Found(file, said, draw_marks(pair, chart, None), warnings)
