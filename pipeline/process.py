"""The way of a pair: decode → align → estimate lamps → separate → encode."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.belonging import check_sizes
from pipeline.calibration.kept import Kept, setup_warnings, with_kept
from pipeline.decode import check_header, decode
from pipeline.doubts import doubts
from pipeline.errors import UnusablePairError
from pipeline.focal import focal_length_px
from pipeline.frames import Frame, release_photograph
from pipeline.known_lamps import find_known
from pipeline.lamps import estimate_lamps
from pipeline.likely_camera import camera_doubts, likely_camera
from pipeline.manifest import lamp_entries, make_manifest
from pipeline.memory import release_rows, trim_memory
from pipeline.mix import mix_basis
from pipeline.model import Model, build_model
from pipeline.normals import find_facing
from pipeline.options import FACING_OUTPUTS, Options
from pipeline.outputs import Outputs, check_outputs, wanted_outputs
from pipeline.pair import make_pair
from pipeline.pictures import overview, render
from pipeline.progress import STRIP_ROWS, Progress
from pipeline.reduced import reduce_pair
from pipeline.remarks import Code, Remark
from pipeline.response import camera_changes
from pipeline.spectra.cameras import Camera, find_camera, srgb_stand_in
from pipeline.spectra.lights import find_light
from pipeline.tally import Tally

NO_FLASH, FLASH = "photograph without the flash", "photograph with the flash"
"""What messages call the two files."""

_NOT_ITS_VALUES = (
    " The camera named describes the values of its sensor, which these are not: leave it out."
)
_LOOKED_BACK = 64
"""Rows above a strip that work on the next one may read, and more."""


def check_pair(no_flash: bytes, flash: bytes) -> None:
    """Refuse, from the headers alone, files that can never be separated. Raises InputError."""
    sizes = [check_header(no_flash, NO_FLASH), check_header(flash, FLASH)]
    check_sizes(*sizes)
    if no_flash == flash:
        raise UnusablePairError(
            "The two photographs are identical: send one without the flash and one with it."
        )


def separate_files(
    no_flash: bytes,
    flash: bytes,
    options: Options,
    directory: Path,
    progress: Progress,
    strip_rows: int = STRIP_ROWS,
    kept: Sequence[Kept] = (),
) -> dict[str, Any]:
    """Separate a pair of files and write the results; returns the manifest.

    no_flash, flash: whole files of any format that decode reads. directory: made if missing;
    manifest.json is written last. strip_rows: rows worked on at a time, which changes memory and
    not the result. kept: calibrations that stand in for options left out. Raises InputError for
    what the user can mend, Canceled, OSError.
    """
    progress.report("decode", 0.0)
    check_pair(no_flash, flash)
    before = decode(no_flash, options.encoding, NO_FLASH)
    del no_flash  # RAW files are large, and a caller may have kept none of them
    trim_memory()
    progress.report("decode", 0.5)
    after = decode(flash, options.encoding, FLASH)
    del flash
    # first what costs little and may be refused: outputs, names of cameras and lights
    named = options.camera is not None  # calibrated ones were checked by their targets
    warnings = setup_warnings(options, kept, before)
    options, used, left_out = with_kept(options, kept, before)
    warnings += left_out
    wanted = wanted_outputs(options)
    check_outputs(wanted, before.size)
    camera = find_camera(options.camera, before)
    model = _model(camera, before, options)
    progress.report("decode", 1.0)
    pair = make_pair(before, after, options, progress)
    # the pair alone holds the photographs, of which the second may be another, laid on the first
    before, after = before.facts(), after.facts()
    progress.report("lamps", 0.0)
    reduced = reduce_pair(pair)
    if before.encoding == "linear" and not before.profiled and options.camera is None:
        camera = likely_camera(
            reduced,
            find_light(options.flash_spectrum),
            options.number_of_lamps,
            options.flash_only,
            None if camera is srgb_stand_in() else camera,
            partial(_model, frame=before, options=options),
        )
        model = _model(camera, before, options)
    known = find_known(options, before.size, reduced, camera, model)
    lamps = estimate_lamps(
        reduced, model, options.number_of_lamps, options.method, options.flash_only, known
    )
    warnings += [*pair.warnings, *_model_warnings(before, camera, named)]
    if named:
        build = partial(_model, frame=before, options=options)
        warnings += camera_doubts(reduced, len(lamps), options.flash_only, camera, before, build)
    warnings += doubts(pair, reduced, lamps, options.method)
    facing = None
    if options.light_directions is not None and wanted & FACING_OUTPUTS:
        focal_px = focal_length_px(before, options.focal_px, warnings)
        facing = find_facing(
            options.light_directions,
            reduced,
            lamps,
            model,
            find_light(options.flash_spectrum),
            focal_px,
            options.method,
            progress,
        )
        warnings.extend(facing.warnings)
    trim_memory()  # what the estimation took would add to what strips take
    progress.report("lamps", 1.0)

    changes = None
    if model.response is not None:
        changes = camera_changes(lamps, model, model.response, options.method)
    small = overview(pair, reduced, lamps, model, changes, options.method, wanted)
    basis = mix_basis(pair.no_flash, lamps, model)
    tally = Tally(len(lamps), *pair.unusable.shape)
    directory.mkdir(parents=True, exist_ok=True)
    with Outputs(
        pair.no_flash, small, lamps, model, facing, changes, wanted, directory, options.normals
    ) as outputs:
        for pictures in render(
            pair, reduced, lamps, model, facing, changes, options, wanted, progress, strip_rows
        ):
            tally.add(pictures.rows, pictures.layers, pictures.confidence)
            outputs.add(pictures)
            done = pictures.rows.start - _LOOKED_BACK
            release_rows(pair.unusable, done)
            for photograph in (pair.no_flash, pair.flash):
                release_photograph(photograph, done)
        entries = lamp_entries(lamps, model, tally.separated)
        files = outputs.finish(reduced, entries, progress)
    manifest = make_manifest(
        (before, after),
        options,
        camera,
        pair,
        lamps,
        entries,
        facing,
        tally.filled,
        files,
        basis,
        used,
        warnings,
    )
    text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
    progress.report("encode", 1.0)  # before the manifest, which only a finished run has
    (directory / "manifest.json").write_text(text + "\n", encoding="utf-8")
    return manifest


def _model(camera: Camera, frame: Frame, options: Options) -> Model:
    return build_model(
        camera,
        find_light(options.flash_spectrum),
        find_light(options.neutral, "neutral light"),
        options.basis,
        None if options.response is None else find_camera(options.response, frame),
    )


def _model_warnings(frame: Frame, camera: Camera, named: bool) -> list[Remark]:
    """Warn of a camera that is a guess, and of one that was named for what no sensor gives."""
    if frame.encoding == "srgb":
        message = (
            "The photographs are rendered to sRGB, which bends colours and brightness: the "
            "separation is approximate. Send RAW or linear files for exact work."
        )
        return [Remark(Code.RENDERED_SRGB, message + (_NOT_ITS_VALUES if named else ""))]
    if frame.profiled:
        message = (
            "The photographs hold linear values in the colours that their profile says, not those "
            "of a sensor: the camera's spectral sensitivities were approximated. Send RAW files "
            "for exact work."
        )
        return [Remark(Code.CAMERA_APPROXIMATE, message + (_NOT_ITS_VALUES if named else ""))]
    if not camera.approximate:
        return []
    taken = f"{camera.name} explains the pair best and was taken"
    by_exif = find_camera(None, frame)
    if frame.encoding == "linear" and not by_exif.approximate:
        message = (
            f"The photographs do not hold what the sensor of the {by_exif.name} gives, which they "
            f"name: {taken}. Send RAW files for exact work, or name the camera if they do."
        )
        return [Remark(Code.CAMERA_APPROXIMATE, message)]
    message = (
        "The camera's spectral sensitivities are not known and were approximated: name a "
        "measured camera or send its table for exact work."
    )
    if frame.encoding == "linear":
        message += f" The files do not say whose colours they hold: {taken}."
    return [Remark(Code.CAMERA_APPROXIMATE, message)]
