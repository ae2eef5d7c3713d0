"""The way of a pair: decode → align → estimate lamps → separate → encode."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.calibration.kept_calibrations import Kept, may_stand_in, setup_warnings, with_kept
from pipeline.calibration.named_calibrations import named_warnings
from pipeline.decode import decode
from pipeline.estimate import Estimate, make_estimate
from pipeline.images.frames import Frame, release_photograph
from pipeline.images.memory import release_rows, trim_memory
from pipeline.images.strips import STRIP_ROWS
from pipeline.lamps.known_lamps import check_places
from pipeline.lamps.whose_colours import camera_doubts, camera_warnings, likely_camera
from pipeline.light.model import Model, build_model
from pipeline.manifest_parts import write_manifest
from pipeline.mixes.mix import mix_basis
from pipeline.options import Options
from pipeline.pair.pair import Pair, make_pair
from pipeline.pair.pair_checks import FLASH, NO_FLASH, check_pair
from pipeline.pair.reduced import ReducedPair, reduce_pair, unusable_where
from pipeline.progress import Progress
from pipeline.result_names import MANIFEST
from pipeline.results.manifest import Written, lamp_entries, make_manifest
from pipeline.results.outputs import Outputs
from pipeline.results.pictures import overview, render
from pipeline.results.tally import Tally
from pipeline.results.wanted_outputs import (
    check_directions,
    check_outputs,
    held_outputs,
    wanted_outputs,
    white_warnings,
)
from pipeline.run_warnings import RunWarning
from pipeline.spectra.cameras import Camera, find_camera
from pipeline.spectra.lights import find_light
from pipeline.threads import ahead

_LOOKED_BACK = 64
"""Rows above a strip that work on the next one may read, and more."""


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
    manifest.json is written last. An earlier run's files there are written over or, where this run
    fails or is canceled while it writes, lost, its manifest.json with them; where it is refused
    before, they stay. strip_rows: rows worked on at a time, which changes memory and
    not the result. kept: calibrations that stand in for options left out. Raises InputError for
    what the user can mend, Canceled, OSError.
    """
    progress.report("decode", 0.0)
    if not may_stand_in(kept, "lamps", options):  # else the photographs tell whether it does
        check_directions(options)
    orientation = check_pair(no_flash, flash)
    before = decode(no_flash, options.encoding, NO_FLASH)
    del no_flash  # RAW files are large, and a caller may have kept none of them
    trim_memory()
    progress.report("decode", 0.5)
    after = decode(flash, options.encoding, FLASH, orientation)
    del flash
    asked = _asked(options, kept, before)
    options = asked.options
    camera = find_camera(options.camera, before)
    build = _models(before, options)
    model = build(camera)
    progress.report("decode", 1.0)
    pair = make_pair(before, after, options, progress)
    # the pair alone holds the photographs, of which the second may be another, laid on the first
    before, after = before.facts(), after.facts()
    progress.report("lamps", 0.0)
    reduced = reduce_pair(pair)
    if options.camera is None and before.undeclared:
        model = _likely_model(reduced, model, options, build)
    estimate = make_estimate(pair, reduced, model, before, options, asked.wanted, progress)
    if estimate.left_out is not None:
        pair = unusable_where(estimate.left_out, pair, reduced.block)
    wanted, passed_over = held_outputs(asked.wanted, before.size, len(estimate.lamps), options)
    warnings = [
        *asked.warnings,
        *pair.warnings,
        *_of_camera(asked.names_camera, before, pair, estimate, build),
        *estimate.warnings,
        *passed_over,
        *white_warnings(pair.photograph, pair.clipping, wanted),
    ]
    trim_memory()  # what the estimation took would add to what strips take
    progress.report("lamps", 1.0)

    directory.mkdir(parents=True, exist_ok=True)
    written = _write_outputs(pair, estimate, options, wanted, directory, progress, strip_rows)
    manifest = make_manifest(
        (before, after), options, pair, estimate, written, asked.calibrations, warnings
    )
    progress.report("encode", 1.0)  # before the manifest, which only a finished run has
    write_manifest(directory, manifest)
    return manifest


@dataclass(frozen=True)
class _Asked:
    """What a run is to do.

    options: with kept calibrations in place of those left out. names_camera: whether the user named
    one; calibrated ones were checked by their targets. wanted: names of outputs
    (pipeline.output_names). calibrations: those that stand in, for the manifest. warnings: of what
    was kept or named.
    """

    options: Options
    names_camera: bool
    wanted: frozenset[str]
    calibrations: list[dict[str, str]]
    warnings: list[RunWarning]


def _asked(options: Options, kept: Sequence[Kept], frame: Frame) -> _Asked:
    """Find what a run is to do, and refuse what costs little to check: outputs, directions, areas.

    frame: the no-flash photograph, of which size and EXIF count. Raises InputError.
    """
    of_setup, of_named = setup_warnings(options, kept, frame), named_warnings(options, frame)
    names_camera = options.camera is not None
    options, used, left_out = with_kept(options, kept, frame)
    wanted = wanted_outputs(options)
    check_outputs(wanted, frame.size, options)
    check_directions(options, [*of_setup, *left_out])
    check_places(options, frame.size)
    return _Asked(options, names_camera, wanted, used, [*of_setup, *of_named, *left_out])


def _models(frame: Frame, options: Options) -> Callable[[Camera], Model]:
    """How a camera becomes a model; what the options name is looked up once."""
    flash = find_light(options.flash_spectrum)
    neutral = find_light(options.neutral, "neutral light")
    response = None if options.response is None else find_camera(options.response, frame)
    return lambda camera: build_model(camera, flash, neutral, options.basis, response)


def _likely_model(
    reduced: ReducedPair, model: Model, options: Options, build: Callable[[Camera], Model]
) -> Model:
    """Model of the camera that explains undeclared files best; model: of the one by their EXIF."""
    sensor = None if model.camera.in_srgb else model.camera
    camera = likely_camera(reduced, model.flash, options.number_of_lamps, sensor, build)
    return build(camera)


def _of_camera(
    named: bool, frame: Frame, pair: Pair, estimate: Estimate, build: Callable[[Camera], Model]
) -> list[RunWarning]:
    """Warn of a camera that is a guess or does not fit; named: whether the user named it."""
    camera, lamps = estimate.model.camera, len(estimate.lamps)
    warnings = camera_warnings(frame, camera, named, pair.tone_curve is not None)
    if named:
        warnings += camera_doubts(estimate.reduced, lamps, camera, frame, build)
    return warnings


def _write_outputs(
    pair: Pair,
    estimate: Estimate,
    options: Options,
    wanted: frozenset[str],
    directory: Path,
    progress: Progress,
    strip_rows: int,
) -> Written:
    """Separate strip by strip, giving back what memory of the pair that takes."""
    basis = mix_basis(pair.photograph, pair.clipping, estimate.lamps, estimate.model)
    small = overview(pair, estimate, options.method, wanted)
    tally = Tally(len(estimate.lamps), *pair.unusable.shape)
    (directory / MANIFEST).unlink(missing_ok=True)  # an earlier run's, whose files are lost now
    photograph, way = pair.photograph, options.normals
    with Outputs(photograph, pair.clipping, small, estimate, wanted, directory, way) as outputs:
        for pictures in ahead(render(pair, estimate, options, wanted, progress, strip_rows)):
            tally.add(pictures.rows, pictures.layers, pictures.confidence)
            outputs.add(pictures)
            done = pictures.rows.start - _LOOKED_BACK
            release_rows(pair.unusable, done)
            for one in (photograph, pair.no_flash, pair.flash):
                release_photograph(one, done)
        entries = lamp_entries(estimate.lamps, estimate.model, tally.separated)
        files = outputs.finish(entries, progress)
    return Written(entries, tally.filled, files, basis)
