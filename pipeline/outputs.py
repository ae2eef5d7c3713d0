"""From pictures to files, and what the manifest says of each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.spaces import XYZ_TO_REC2020, XYZ_TO_SRGB
from pipeline.encode.exr import write_exr
from pipeline.encode.files import describe
from pipeline.encode.jpeg import write_jpeg
from pipeline.encode.png import write_normals_png, write_png8
from pipeline.encode.tiff import write_gray_tiff, write_tiff
from pipeline.frames import Image, Matrix
from pipeline.gamma_diagram import draw_gamma_diagram
from pipeline.lamps import Lamps
from pipeline.model import Model
from pipeline.options import OUTPUT_NAMES, Options
from pipeline.order import quantile
from pipeline.pictures import Pictures
from pipeline.progress import Progress
from pipeline.reduced import ReducedPair
from pipeline.residual_map import draw_residual_map, relative_residual

_ONLY_ON_REQUEST = frozenset(
    {"white_balanced_1.tif", "white_balanced_2.tif", "white_balanced.exr", "response.exr"}
)
_CAMERA_RGB = "linear camera RGB, 1.0 = white level of the no-flash photograph"
_SHOWN_GAIN = (0.25, 8.0)
_SHOWN_WHITE = 0.995  # quantile of a picture's brightest channel that becomes white
_SAMPLE_STEP = 4

Job = tuple[str, str, str, Callable[[Path], None]]
"""Name of a file, its encoding, its colour space, and what writes it."""


def wanted_outputs(options: Options) -> frozenset[str]:
    """Names out of OUTPUT_NAMES that the options ask for."""
    if options.outputs == "all":
        return frozenset(OUTPUT_NAMES)
    if options.outputs == "default":
        return frozenset(OUTPUT_NAMES) - _ONLY_ON_REQUEST
    return frozenset(options.outputs)


def write_outputs(
    pictures: Pictures,
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    entries: list[dict[str, Any]],
    wanted: frozenset[str],
    directory: Path,
    progress: Progress,
) -> list[dict[str, Any]]:
    """Write the wanted files; returns their entries for the manifest.

    reduced: what the lamps were estimated from, for gamma.png and residual.png. entries: of the
    lamps, for the labels of gamma.png. Raises Canceled between files, OSError.
    """
    jobs = [
        *_layer_jobs(pictures, model, wanted),
        *_balanced_jobs(pictures, model, wanted),
        *_response_jobs(pictures, model, wanted),
        *_normal_jobs(pictures.normals, wanted),
        *_surface_jobs(pictures, model, wanted),
        *_confidence_jobs(pictures, wanted),
    ]
    if "gamma.png" in wanted:
        diagram = draw_gamma_diagram(reduced, lamps, model, [_label(one) for one in entries])
        jobs.append(("gamma.png", "8-bit", "sRGB", lambda path: write_png8(path, diagram)))
    if "residual.png" in wanted:
        residual = draw_residual_map(relative_residual(reduced, lamps))
        jobs.append(("residual.png", "8-bit", "sRGB", lambda path: write_png8(path, residual)))
    files = []
    for index, (name, encoding, colour_space, write) in enumerate(jobs):
        progress.report("encode", index / len(jobs))
        write(directory / name)
        files.append(describe(directory / name, encoding, colour_space))
    return files


def _layer_jobs(pictures: Pictures, model: Model, wanted: frozenset[str]) -> list[Job]:
    jobs: list[Job] = []
    names = [f"lamp{index + 1}" for index in range(len(pictures.layers))]
    if "layers.exr" in wanted:
        jobs.append(
            (
                "layers.exr",
                "32-bit float",
                _CAMERA_RGB,
                lambda path: write_exr(path, _with_sum(pictures.layers)),
            )
        )
    to_rec2020 = _fitting(XYZ_TO_REC2020 @ model.camera_to_xyz)
    to_srgb = _shown(pictures.photograph, XYZ_TO_SRGB @ model.camera_to_xyz)
    for name, layer in zip(names, pictures.layers, strict=True):
        if "lamps.tif" in wanted:
            jobs.append((f"{name}.tif", "16-bit linear", "Rec. 2020", _tiff(layer, to_rec2020)))
        if "lamps.jpg" in wanted:
            jobs.append((f"{name}.jpg", "8-bit sRGB curve", "sRGB", _jpeg(layer, to_srgb)))
    return jobs


def _balanced_jobs(pictures: Pictures, model: Model, wanted: frozenset[str]) -> list[Job]:
    jobs: list[Job] = []
    neutral = XYZ_TO_SRGB @ model.neutral_to_xyz
    both = (pictures.white_balanced_1, pictures.white_balanced_2)
    for name, picture in zip(("white_balanced_1.jpg", "white_balanced_2.jpg"), both, strict=True):
        if name in wanted and picture is not None:
            write = _jpeg(picture, _shown(picture, neutral))
            jobs.append((name, "8-bit sRGB curve", "sRGB", write))
    to_rec2020 = _fitting(XYZ_TO_REC2020 @ model.neutral_to_xyz)
    for name, picture in zip(("white_balanced_1.tif", "white_balanced_2.tif"), both, strict=True):
        if name in wanted and picture is not None:
            jobs.append((name, "16-bit linear", "Rec. 2020", _tiff(picture, to_rec2020)))
    if "white_balanced.exr" in wanted and both[0] is not None and both[1] is not None:
        balanced = {"RGB": both[0], "any": both[1]}
        jobs.append(
            (
                "white_balanced.exr",
                "32-bit float",
                f"{_CAMERA_RGB}, as under the neutral light",
                lambda path: write_exr(path, balanced),
            )
        )
    return jobs


def _response_jobs(pictures: Pictures, model: Model, wanted: frozenset[str]) -> list[Job]:
    """Through the other camera, the layers on the scale of the photograph."""
    photograph, changes = pictures.response, pictures.camera_changes
    if model.response is None or photograph is None or changes is None:
        return []
    to_srgb = _shown(photograph, XYZ_TO_SRGB @ model.response.camera_to_xyz)
    shown = [("response.jpg", photograph, to_srgb)] if "response.jpg" in wanted else []
    if "response_lamps.jpg" in wanted:
        shown += [
            (f"response_lamp{index + 1}.jpg", layer, to_srgb @ change)
            for index, (layer, change) in enumerate(zip(pictures.layers, changes, strict=True))
        ]
    jobs: list[Job] = [
        (name, "8-bit sRGB curve", "sRGB", _jpeg(picture, matrix))
        for name, picture, matrix in shown
    ]
    if "response.exr" in wanted:
        jobs.append(
            (
                "response.exr",
                "32-bit float",
                "linear RGB of the other camera, exposed to the same green of D65",
                lambda path: write_exr(path, _with_sum(_seen(pictures.layers, changes))),
            )
        )
    return jobs


def _seen(layers: NDArray[np.float32], changes: NDArray[np.float64]) -> NDArray[np.float32]:
    """Layers through the other camera (N, H, W, 3)."""
    seen = np.empty_like(layers)
    for layer, change, out in zip(layers, changes, seen, strict=True):
        np.matmul(layer, change.T.astype(np.float32), out=out)
    return seen


def _with_sum(layers: NDArray[np.float32]) -> dict[str, Image]:
    """Layers and their sum by the names of their channels; made when written, as it is large."""
    named = {f"lamp{index + 1}": layer for index, layer in enumerate(layers)}
    return named | {"RGB": layers.sum(axis=0)}


def _normal_jobs(field: Image | None, wanted: frozenset[str]) -> list[Job]:
    if field is None:
        return []
    convention = "unit normals, x right, y up, z to the viewer (OpenGL)"
    jobs: list[Job] = []
    if "normals.png" in wanted:
        encoding = "16-bit, (n + 1)/2 · 65535, 0 = unknown"
        jobs.append(
            ("normals.png", encoding, convention, lambda path: write_normals_png(path, field))
        )
    if "normals.exr" in wanted:
        jobs.append(
            (
                "normals.exr",
                "32-bit float, NaN = unknown",
                convention,
                lambda path: write_exr(path, {"RGB": field}),
            )
        )
    return jobs


def _surface_jobs(pictures: Pictures, model: Model, wanted: frozenset[str]) -> list[Job]:
    depth, mesh, texture = pictures.depth, pictures.mesh, pictures.white_balanced_1
    jobs: list[Job] = []
    if depth is not None and "depth.exr" in wanted:
        encoding = "32-bit float, along the camera's axis, 1 in the median, NaN = unknown"
        jobs.append(("depth.exr", encoding, "none", lambda path: write_exr(path, {"Z": depth})))
    if mesh is not None and texture is not None and "surface.glb" in wanted:
        encoding = (
            "glTF 2.0 binary, camera in the origin, x right, y up, z to the viewer, depth 1 in the "
            "median"
        )
        matrix = _shown(texture, XYZ_TO_SRGB @ model.neutral_to_xyz)
        # imported only here: it takes longer than the rest of the writing
        from pipeline.encode.glb import write_glb

        jobs.append(
            ("surface.glb", encoding, "sRGB", lambda path: write_glb(path, mesh, texture, matrix))
        )
    return jobs


def _confidence_jobs(pictures: Pictures, wanted: frozenset[str]) -> list[Job]:
    planes = {
        "confidence.tif": (
            pictures.confidence,
            "65535 = separated, 0 = filled in from the surroundings",
        ),
        "normals_confidence.tif": (
            pictures.normals_confidence,
            "65535 = the normal can be trusted, 0 = it cannot, or there is none",
        ),
    }
    return [
        (name, f"16-bit linear, {means}", "none", _gray_tiff(plane))
        for name, (plane, means) in planes.items()
        if name in wanted and plane is not None
    ]


def _gray_tiff(plane: NDArray[np.float32]) -> Callable[[Path], None]:
    return lambda path: write_gray_tiff(path, plane)


def _tiff(picture: Image, matrix: Matrix) -> Callable[[Path], None]:
    return lambda path: write_tiff(path, picture, matrix)


def _jpeg(picture: Image, matrix: Matrix) -> Callable[[Path], None]:
    return lambda path: write_jpeg(path, picture, matrix)


def _fitting(to_rec2020: Matrix) -> Matrix:
    """Make what the sensor's white becomes fit: else the brightest warm light is cut off."""
    return np.asarray(to_rec2020 / max(1.0, float((to_rec2020 @ np.ones(3)).max())))


def _shown(picture: Image, matrix: Matrix) -> Matrix:
    """Scale the matrix so that the picture's bright parts are shown as white."""
    sample = picture[::_SAMPLE_STEP, ::_SAMPLE_STEP] @ matrix.T.astype(np.float32)
    white = quantile(sample.max(axis=2), _SHOWN_WHITE)
    return matrix * float(np.clip(1.0 / max(white, 1e-6), *_SHOWN_GAIN))


def _label(entry: dict[str, Any]) -> str:
    kelvin = "" if entry["cct_k"] is None else f", {entry['cct_k']} K"
    return f"{entry['name']}, {entry['family']} {entry['family_confidence']:.0%}{kelvin}"
