"""The way of a pair: decode → align → estimate lamps → separate → encode."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

from pipeline.decode import check_header, decode
from pipeline.errors import UnusablePairError
from pipeline.frames import Frame
from pipeline.lamps import estimate_lamps
from pipeline.manifest import lamp_entries, make_manifest
from pipeline.model import Model, build_model
from pipeline.normals import find_facing
from pipeline.options import Options
from pipeline.outputs import wanted_outputs, write_outputs
from pipeline.pair import check_sizes, make_pair
from pipeline.photometric_stereo.responses import LampBank
from pipeline.pictures import render
from pipeline.progress import STRIP_ROWS, Progress
from pipeline.reduced import reduce_pair
from pipeline.spectra.cameras import Camera, find_camera
from pipeline.spectra.lights import find_light

_NO_FLASH, _FLASH = "photograph without the flash", "photograph with the flash"
_MANY_FILLED = 0.2
_UNSURE = 0.6
_NORMAL_LENS = 50.0 / 36.0  # of the longer side


def check_pair(no_flash: bytes, flash: bytes) -> None:
    """Refuse, from the headers alone, files that can never be separated. Raises InputError."""
    sizes = [check_header(no_flash, _NO_FLASH), check_header(flash, _FLASH)]
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
) -> dict[str, Any]:
    """Separate a pair of files and write the results; returns the manifest.

    no_flash, flash: whole files of any format that decode reads. directory: made if missing;
    manifest.json is written last. strip_rows: rows worked on at a time, which changes memory and
    not the result. Raises InputError for what the user can mend, Canceled, OSError.
    """
    progress.report("decode", 0.0)
    check_pair(no_flash, flash)
    before = decode(no_flash, options.encoding, _NO_FLASH)
    progress.report("decode", 0.5)
    after = decode(flash, options.encoding, _FLASH)
    # first what costs little and may be refused: names of cameras and lights
    camera = find_camera(options.camera, before)
    model = _model(camera, before, options)
    progress.report("decode", 1.0)
    pair = make_pair(before, after, options, progress)
    progress.report("lamps", 0.0)
    reduced = reduce_pair(pair)
    lamps = estimate_lamps(reduced, model, _number(options), options.method, options.flash_only)
    warnings = [*pair.warnings, *_model_warnings(before, camera), *lamps.warnings]
    if lamps.confidence < _UNSURE:
        warnings.append(
            f"It is not certain that the scene has {len(lamps)} lamps; if you know their number, "
            "ask for it. A stronger flash and a hard shadow of each lamp make it plainer."
        )
    facing = None
    if options.light_directions is not None:
        focal_px = _focal_px(before, options, warnings)
        bank = LampBank(camera.sensitivities, find_light(options.flash_spectrum))
        facing = find_facing(
            options.light_directions, reduced, lamps, model, bank, focal_px, options.method
        )
        warnings.extend(facing.warnings)
    progress.report("lamps", 1.0)

    wanted = wanted_outputs(options)
    pictures = render(
        pair, reduced, lamps, model, facing, options.method, wanted, progress, strip_rows
    )
    if pictures.filled > _MANY_FILLED:
        warnings.append(
            f"The flash is too weak, or a photograph is clipped, in {pictures.filled:.0%} of the "
            "picture, where the layers are filled in from their surroundings: bring the flash "
            "nearer, raise its power or lower the ISO speed, and expose shorter where it is "
            "clipped."
        )
    entries = lamp_entries(lamps, model, pictures.separated)
    directory.mkdir(parents=True, exist_ok=True)
    files = write_outputs(pictures, reduced, lamps, model, entries, wanted, directory, progress)
    manifest = make_manifest(
        (before, after),
        options,
        camera,
        pair,
        lamps,
        entries,
        facing,
        pictures.filled,
        files,
        warnings,
    )
    text = json.dumps(manifest, indent=2, ensure_ascii=False, allow_nan=False)
    progress.report("encode", 1.0)  # before the manifest, which only a finished run has
    (directory / "manifest.json").write_text(text + "\n", encoding="utf-8")
    return manifest


def _number(options: Options) -> Literal["auto", 1, 2, 3]:
    """The number of lamps, which their directions tell, too."""
    if options.lights != "auto" or options.light_directions is None:
        return options.lights
    return 3 if len(options.light_directions) == 3 else 2


def _model(camera: Camera, frame: Frame, options: Options) -> Model:
    return build_model(
        camera,
        find_light(options.flash_spectrum),
        find_light(options.neutral, "neutral light"),
        options.basis,
        None if options.response is None else find_camera(options.response, frame),
    )


def _model_warnings(frame: Frame, camera: Camera) -> list[str]:
    warnings = []
    if frame.encoding == "srgb":
        warnings.append(
            "The photographs are rendered to sRGB, which bends colours and brightness: the "
            "separation is approximate. Send RAW or linear files for exact work."
        )
    elif camera.source in ("approximate", "stand-in"):
        warnings.append(
            "The camera's spectral sensitivities are not known and were approximated: name a "
            "measured camera or send its table for exact work."
        )
    return warnings


def _focal_px(frame: Frame, options: Options, warnings: list[str]) -> float:
    given = options.focal_px or frame.focal_px
    if given:
        return given
    warnings.append(
        "The focal length is not known; that of a 50 mm lens on 35 mm film was taken. Pass the "
        "focal length in pixels for exact normals."
    )
    return _NORMAL_LENS * max(frame.size)
