"""From a folder of results to a picture of their layers as they are mixed."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import Imath
import numpy as np
import OpenEXR

from pipeline.arrays import Floats32
from pipeline.colour.spaces import XYZ_TO_REC2020, XYZ_TO_SRGB
from pipeline.decode.quiet import muted
from pipeline.encode.exr import ExrFile, name_of
from pipeline.encode.files import describe
from pipeline.encode.jpeg import JpegFile
from pipeline.encode.tiff import TiffFile
from pipeline.encode.writer import Writer
from pipeline.errors import InputError, reason_of
from pipeline.images.data_window import size_of_window
from pipeline.images.frames import Image, by_planes
from pipeline.images.strips import STRIP_ROWS
from pipeline.manifest_parts import versions, write_manifest
from pipeline.mixes.mix import mix_matrices, mixed, to_be_mixed
from pipeline.mixes.mix_options import Mix, MixRequest, read_basis
from pipeline.progress import Progress
from pipeline.result_names import LAYERS, MANIFEST, layer_channels

ENCODINGS = {
    "jpeg": ("jpg", "8-bit sRGB curve", "sRGB"),
    "tiff": ("tif", "16-bit linear", "Rec. 2020"),
    "exr": ("exr", "16-bit float", "linear sRGB, 1.0 = white of the screen"),
}
"""Of every format the end of the name, encoding and colour space."""

_FLOAT = Imath.PixelType(Imath.PixelType.FLOAT)
_REC2020 = XYZ_TO_REC2020 @ np.linalg.inv(XYZ_TO_SRGB)


def mix_files(folder: Path, mix: Mix, target: Path, progress: Progress) -> None:
    """Mix the layers of a folder of results into one picture of full size.

    folder: with layers.exr and manifest.json. target: a file whose name ends in jpg, jpeg, tif,
    tiff or exr, none of the results. Raises InputError for what the user can mend, before a target
    that is there is written over but where layers.exr breaks off; Canceled, OSError. A file that is
    not whole is not left behind, nor is what it was written over: name one beside it to keep that.
    """
    _write_mix(folder, mix, target, progress)


def _write_mix(
    folder: Path, mix: Mix, target: Path, progress: Progress, replaced: Path | None = None
) -> None:
    """Do what mix_files does; replaced: the manifest of a mix before, which is lost with it."""
    manifest = read_manifest(folder)
    basis = read_basis(manifest)
    matrices = mix_matrices(basis, mix)
    format_of(target)
    for lost in (target, replaced):
        if lost is not None:
            check_target(folder, manifest, lost)
    with closing(_open(folder, len(matrices))) as source:
        size = _size(source)
        _check_layers(manifest, size)
        file = _target(target, size)
        if replaced is not None:
            replaced.unlink(missing_ok=True)
        try:
            for rows in progress.strips("mix", size[1], STRIP_ROWS, 0.0, 0.9):
                layers = to_be_mixed(_layers(source, len(matrices), rows), basis)
                file.write(_as_rows(file, mixed(layers, matrices)))
            file.close()
        except BaseException:
            target.unlink(missing_ok=True)
            raise
    progress.report("mix", 1.0)


def mix_results(folder: Path, wanted: MixRequest, results: Path, progress: Progress) -> None:
    """Mix the layers of a folder of results into another one: mix.jpg, .tif or .exr, and manifest.

    results: made if missing; that of a mix before is written over. Its manifest goes before its
    picture does, and stays where the mix is refused. Raises what mix_files raises.
    """
    ending, encoding, colour_space = ENCODINGS[wanted.format]
    results.mkdir(parents=True, exist_ok=True)
    target = results / f"mix.{ending}"
    _write_mix(folder, wanted, target, progress, replaced=results / MANIFEST)
    manifest = {
        "mix": wanted.model_dump(mode="json"),
        "files": [describe(target, encoding, colour_space)],
        "warnings": [],
        "versions": versions(),
    }
    write_manifest(results, manifest)


def format_of(target: Path) -> str:
    """Tell the format, a key of ENCODINGS, by the end of a name. Raises InputError."""
    names = {"jpg": "jpeg", "jpeg": "jpeg", "tif": "tiff", "tiff": "tiff", "exr": "exr"}
    found = names.get(target.suffix.lower().lstrip("."))
    if found is None:
        raise InputError(
            f"A mix cannot be written as {target}: its name has to end in .jpg, .tif or .exr."
        )
    return found


def check_target(folder: Path, manifest: dict[str, Any], target: Path) -> None:
    """Refuse to write over the layers, over their manifest, or over what that names.

    Raises InputError.
    """
    named = {folder.resolve() / str(entry["name"]) for entry in _files(manifest) or []}
    if target.resolve() in named | {(folder / name).resolve() for name in (LAYERS, MANIFEST)}:
        raise InputError(f"The result {target} would be lost: give the mix another place.")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read the manifest of a folder of results. Raises InputError."""
    try:
        found = json.loads((folder / MANIFEST).read_bytes())
    except (OSError, ValueError) as error:
        raise InputError(
            f"{folder} is no folder of results: there is no {MANIFEST} that can be read."
        ) from error
    return found if isinstance(found, dict) else {}


def _files(manifest: dict[str, Any]) -> list[dict[str, Any]] | None:
    """What a manifest says of its files; None where it does not."""
    found = manifest.get("files")
    if not isinstance(found, list):
        return None
    return [entry for entry in found if isinstance(entry, dict) and "name" in entry]


def _check_layers(manifest: dict[str, Any], size: tuple[int, int]) -> None:
    """Refuse layers of another run, which may have stayed in the folder. size: (width, height)."""
    files = _files(manifest)
    if files is None:
        return
    said = [(one.get("width"), one.get("height")) for one in files if one["name"] == LAYERS]
    if size not in said:
        raise InputError(
            f"The {LAYERS} is not that of the {MANIFEST} beside it, which another run wrote: "
            "separate the pair anew with that output."
        )


def _open(folder: Path, lamps: int) -> Any:
    path = folder / LAYERS
    if not path.is_file():
        raise InputError(
            f"There is no {LAYERS} among the results: separate the pair with that output."
        )
    name = name_of(path)
    try:
        path.open("rb").close()  # OpenEXR does not say why it cannot be
    except OSError as error:
        raise InputError(f"{LAYERS} cannot be read: {reason_of(error)}.") from error
    try:
        with muted():
            source = OpenEXR.InputFile(name)
    except Exception as error:  # OpenEXR raises what it likes
        raise InputError(f"{LAYERS} cannot be read: it is damaged, or no EXR.") from error
    if not set(layer_channels(lamps)) <= source.header()["channels"].keys():
        source.close()
        raise InputError(f"{LAYERS} lacks a layer that the manifest names: they do not belong.")
    return source


def _size(source: Any) -> tuple[int, int]:
    window = source.header()["dataWindow"]
    return size_of_window((window.min.x, window.min.y), (window.max.x, window.max.y))


def _layers(source: Any, lamps: int, rows: slice) -> Floats32:
    try:
        with muted():
            planes = source.channels(layer_channels(lamps), _FLOAT, rows.start, rows.stop - 1)
    except Exception as error:
        raise InputError(f"{LAYERS} cannot be read to its end: it is damaged.") from error
    height = rows.stop - rows.start
    layers = by_planes(lamps, height, len(planes[0]) // (4 * height), 3)
    for index, plane in enumerate(planes):
        lamp, channel = divmod(index, 3)
        layers[lamp, ..., channel] = np.frombuffer(plane, np.float32).reshape(height, -1)
    return layers


def _target(target: Path, size: tuple[int, int]) -> Writer:
    kind = format_of(target)
    if kind == "jpeg":
        return JpegFile(target, size)
    return TiffFile(target, size, _REC2020) if kind == "tiff" else ExrFile(target, size, half=True)


def _as_rows(file: Writer, rows: Image) -> Any:
    return {"RGB": rows} if isinstance(file, ExrFile) else rows
