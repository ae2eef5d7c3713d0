"""Runs the product as a photographer does, from files to files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from pipeline.decode.quiet import muted
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from tests.evaluation.shots import Shot

Planes = dict[str, NDArray[np.float32]]


def run_product(shot: Shot, output: str, **options: Any) -> tuple[dict[str, Any], Planes]:
    """Manifest, and the channels (H, W) by name of one EXR file.

    output: its name. options: for Options, beside what the photographer says of the shot. Raises
    InputError as the product does.
    """
    chosen = Options(**shot.options, lights=shot.lights, outputs=[output], **options)
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        manifest = separate_files(*shot.files, chosen, directory, Progress())
        return manifest, planes_of(directory / output)


def planes_of(path: Path) -> Planes:
    """Channels (H, W) of an EXR file by name."""
    with muted():
        file = OpenEXR.File(str(path), separate_channels=True)
        return {name: channel.pixels for name, channel in file.channels().items()}


def picture(planes: Planes, prefix: str) -> NDArray[np.float32]:
    """(H, W, 3) of the channels prefix + R, G, B."""
    return np.stack([planes[f"{prefix}{name}"] for name in "RGB"], axis=-1)
