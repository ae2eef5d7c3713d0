"""The way of a calibration: decode → align → read the marks → estimate → save."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from pipeline.calibration.calibrate_camera import calibrate_camera
from pipeline.calibration.calibrate_flash import calibrate_flash
from pipeline.calibration.calibrate_lamps import calibrate_lamps
from pipeline.calibration.find_marks import MARKS
from pipeline.calibration.named_calibrations import named_warnings
from pipeline.calibration.options import (
    FILES,
    CameraCalibration,
    FlashCalibration,
    LampsCalibration,
)
from pipeline.decode import decode
from pipeline.errors import OptionError
from pipeline.images.frames import Frame
from pipeline.manifest_parts import input_entry, versions, write_manifest
from pipeline.pair.pair import make_pair
from pipeline.pair.pair_checks import FLASH, NO_FLASH, check_pair
from pipeline.progress import Progress
from pipeline.result_names import MANIFEST
from pipeline.taken_with import TakenWith


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
        found = calibrate_flash(pair, before, options)
    elif isinstance(options, CameraCalibration):
        found = calibrate_camera(pair, before, options)
    else:
        found = calibrate_lamps(pair, before, options)
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
