"""The way of a calibration: decode → align → read the marks → estimate → save."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.calibration.camera import estimate_camera, is_unlikely
from pipeline.calibration.chart import read_card, read_chart
from pipeline.calibration.find_marks import MARKS, draw_marks, find_chart, find_sphere
from pipeline.calibration.flash import FAMILY, estimate_flash
from pipeline.calibration.flash_doubts import flash_doubts
from pipeline.calibration.lamps import LampsEstimate, matt_lamps
from pipeline.calibration.mirror import mirror_lamps
from pipeline.calibration.named import named_warnings
from pipeline.calibration.options import (
    FILES,
    CameraCalibration,
    Corners,
    FlashCalibration,
    LampsCalibration,
)
from pipeline.calibration.patches import Patches
from pipeline.colour.temperature import cct_duv
from pipeline.decode import decode
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.frames import Frame
from pipeline.lamps.whose_colours import names_no_camera, no_sensors_values, undeclared
from pipeline.manifest_parts import input_entry, versions, write_manifest
from pipeline.options import Circle, DirectedLight, Sensitivities, Spectrum
from pipeline.pair.pair import Pair, make_pair
from pipeline.pair.pair_checks import FLASH, NO_FLASH, check_pair
from pipeline.photometric_stereo.directions import unit_directions
from pipeline.photometric_stereo.focal import focal_length_px
from pipeline.photometric_stereo.responses import floored
from pipeline.progress import Progress
from pipeline.result_names import MANIFEST
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera, find_camera, measured_cameras
from pipeline.spectra.grid import WAVELENGTHS_NM
from pipeline.spectra.lights import find_light, packaged_light
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.tables import write_sensitivities, write_spectrum
from pipeline.taken_with import TakenWith

_FAR_ASIDE_DEG = 5.0  # of the flash beside the lens, seen from the sphere
_GREY_CARD = 0.18  # reflectance


@dataclass(frozen=True)
class _Found:
    """file: what the option of a separation reads. said: what people want to know of it.

    marks: a picture of where it was read. warnings: what to trust less.
    """

    file: bytes
    said: dict[str, Any]
    marks: bytes
    warnings: list[RunWarning]


def calibrate_files(
    no_flash: bytes,
    flash: bytes,
    options: FlashCalibration | CameraCalibration | LampsCalibration,
    directory: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Calibrate from a pair of files; writes what it found, MARKS and manifest.json.

    What it found is the file of FILES; the manifest is returned. Marks that the options leave out
    are looked for.

    no_flash, flash: whole files of any format that decode reads. directory: made if missing; an
    earlier run's files there are written over, its manifest before them, and stay where this run
    is refused. Raises InputError for what the user can mend, Canceled, OSError.
    """
    progress.report("decode", 0.0)
    orientation = check_pair(no_flash, flash)
    before = decode(no_flash, options.encoding, NO_FLASH)
    progress.report("decode", 0.5)
    after = decode(flash, options.encoding, FLASH, orientation)
    progress.report("decode", 1.0)
    if options.setup is not None:
        _check_camera_told(before)
    if isinstance(options, CameraCalibration):
        _check_sensor(before)
    unfit = named_warnings(options, before)
    pair = make_pair(before, after, options, progress)
    progress.report("calibrate", 0.0)
    if isinstance(options, FlashCalibration):
        found = _flash(pair, before, options)
    elif isinstance(options, CameraCalibration):
        found = _camera(pair, before, options)
    else:
        found = _lamps(pair, before, options)
    progress.report("calibrate", 1.0)
    directory.mkdir(parents=True, exist_ok=True)
    name = FILES[options.kind]
    contents = {name: found.file, MARKS: found.marks}
    (directory / MANIFEST).unlink(missing_ok=True)  # an earlier run's, whose files are lost now
    for file, content in contents.items():
        (directory / file).write_bytes(content)
    manifest = {
        "inputs": {"no_flash": input_entry(before), "flash": input_entry(after)},
        "options": options.model_dump(mode="json"),
        "found": found.said,
        "taken_with": TakenWith.of(before).model_dump(),
        "files": [
            {"name": file, "sha256": hashlib.sha256(content).hexdigest()}
            for file, content in contents.items()
        ],
        "warnings": [warning.entry() for warning in (*pair.warnings, *unfit, *found.warnings)],
        "versions": versions(),
    }
    write_manifest(directory, manifest)
    return manifest


def _check_camera_told(frame: Frame) -> None:
    """Refuse to keep what no separation could be known to fit. Raises OptionError."""
    if not frame.model:
        raise OptionError(
            "The photographs do not say of which camera they are, so that nothing can be kept for "
            "it: leave the set-up out, and name what is found in later separations."
        )


def _check_sensor(frame: Frame) -> None:
    """Refuse files that do not hold what a sensor saw. Raises OptionError."""
    if frame.encoding == "srgb":
        raise OptionError(
            "The photographs are rendered to sRGB, which hides what the sensor saw: calibrate a "
            "camera with RAW or linear files."
        )
    if frame.profiled:
        raise OptionError(
            "The photographs hold the colours that their profile says, not what the sensor saw: "
            "calibrate a camera with RAW files, or set the encoding to linear if the profile is "
            "wrong."
        )


def _flash(pair: Pair, frame: Frame, options: FlashCalibration) -> _Found:
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
    flash = estimate_flash(patches, camera.sensitivities)
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
        **_marks(chart, card),
    }
    return _Found(write_spectrum(table), said, draw_marks(pair, chart, card), warnings)


def _camera_warnings(frame: Frame, camera: Camera, named: bool) -> list[RunWarning]:
    """Warn of a camera that is a guess or does not fit, whose error goes to the flash's spectrum.

    named: whether the user named it.
    """
    if frame.in_colour_space:
        return [no_sensors_values(frame, named, "the spectrum of the flash")]
    if not camera.approximate:
        if named or not undeclared(frame):
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
        message += (
            ": the files do not tell whose colours they hold, and were taken for linear sRGB. Name "
            "their camera with --camera."
        )
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


def _marks(chart: Corners | None, circle: Circle | None) -> dict[str, Any]:
    if chart is not None:
        return {"chart": [[round(x, 2), round(y, 2)] for x, y in chart]}
    assert circle is not None
    return {"card": {name: round(v, 2) for name, v in circle.model_dump().items()}}


def _camera(pair: Pair, frame: Frame, options: CameraCalibration) -> _Found:
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
        **_marks(chart, None),
    }
    r, g, b = camera.sensitivities.tolist()
    nm, taken_with = WAVELENGTHS_NM.tolist(), TakenWith.of(frame)
    table = Sensitivities(wavelength_nm=nm, r=r, g=g, b=b, taken_with=taken_with)
    file = write_sensitivities(table)
    return _Found(file, said, draw_marks(pair, chart, None), warnings)


def _lamps(pair: Pair, frame: Frame, options: LampsCalibration) -> _Found:
    focal_px, warnings = focal_length_px(frame, options.focal_px)
    sphere = options.sphere or find_sphere(pair, options.mirror, focal_px)
    estimate = mirror_lamps if options.mirror else matt_lamps
    lamps = estimate(pair, sphere, options.lights, focal_px)
    lights = _lights(lamps)
    _check_directions(lights)
    said: dict[str, Any] = {
        "lights": [
            {**light, "deviation_deg": round(float(deviation), 3)}
            for light, deviation in zip(lights, lamps.deviations_deg, strict=True)
        ],
        "sphere": {k: round(v, 2) for k, v in lamps.circle.model_dump().items()},
    }
    if lamps.flash_aside_deg is not None:
        said["flash_aside_deg"] = round(lamps.flash_aside_deg, 2)
    if lamps.misfit is not None:
        said["misfit"] = round(lamps.misfit, 4)
    # each says it, so that lamps of several files may be put together
    saved = [{**light, "taken_with": TakenWith.of(frame).model_dump()} for light in lights]
    file = (json.dumps({"lights": saved}, indent=1) + "\n").encode()
    warnings += _lamp_warnings(lamps, options.setup)
    return _Found(file, said, draw_marks(pair, None, lamps.circle), warnings)


def _lights(lamps: LampsEstimate) -> list[dict[str, Any]]:
    """Entries of DirectedLight; strengths and colours only where the sphere shows them."""
    lights: list[dict[str, Any]] = [
        {"direction": [round(float(c), 5) for c in direction]} for direction in lamps.directions
    ]
    if np.isnan(lamps.colours).any():
        return lights
    # a strength is of green, which normals take as no less of a lamp that has none
    colours = floored(lamps.colours)
    strongest = float(colours[:, 1].max())
    for light, colour in zip(lights, colours, strict=True):
        if len(lights) > 1:  # one alone is not as strong as one of another file
            light["strength"] = float(f"{colour[1] / strongest:.5g}")
        light["rgb"] = [round(float(c), 5) for c in colour / colour.max()]
    return lights


def _lamp_warnings(lamps: LampsEstimate, setup: str | None) -> list[RunWarning]:
    """What keeps lamps found on a sphere from good normals. setup: for which they are kept."""
    warnings = []
    aside_deg = lamps.flash_aside_deg
    if aside_deg is not None and aside_deg > _FAR_ASIDE_DEG:
        message = (
            f"The flash shines from {aside_deg:.0f}° beside the camera, where normals "
            "are exact only with a flash at the camera: move it nearer to the lens, or step back."
        )
        figures = {"angle_deg": aside_deg}
        warnings.append(RunWarning(Code.FLASH_ASIDE, message, figures))
    if lamps.one_more:
        message = (
            "One lamp more would explain far more of the light on the sphere, without which the "
            "others' directions may be wrong by many degrees: check the number of lamps that was "
            "told, and keep other light off the sphere."
        )
        warnings.append(RunWarning(Code.UNEXPLAINED, message, {"misfit": lamps.misfit or 0.0}))
    if len(lamps.directions) == 1 and setup is not None:
        message = (
            "One lamp alone fixes no normals, so that what is kept for the set-up "
            f"{setup!r} will be left out: calibrate with all lamps, or put those of "
            "several calibrations together into one file of --light-directions."
        )
        warnings.append(RunWarning(Code.KEPT_UNUSABLE, message))
    if np.isnan(lamps.colours).any():
        message = (
            "A highlight of a lamp is clipped, so that only the lamps' directions are known: "
            "expose shorter for their strengths and colours, and for dimmer lamps beside them."
        )
        warnings.append(RunWarning(Code.HIGHLIGHT_CLIPPED, message))
    return warnings


def _check_directions(lights: list[dict[str, Any]]) -> None:
    """Refuse lamps that no separation could use; of one lamp alone others may come from elsewhere.

    Raises UnusablePairError.
    """
    if len(lights) < 2:
        return
    try:
        unit_directions([DirectedLight.model_validate(light) for light in lights])
    except OptionError as error:
        raise UnusablePairError(
            f"The {len(lights)} lamps found on the sphere are nearly alike, lie nearly in one "
            "plane, or all behind the sphere, which fixes no normals: place them more widely "
            "around the camera."
        ) from error
