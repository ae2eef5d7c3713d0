"""Runs the product as a photographer does, from files to files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from tests.evaluation.shots import Shot
from tests.layers import Planes, planes_of


def run_product(shot: Shot, output: str, **options: Any) -> tuple[dict[str, Any], Planes]:
    """Manifest, and the channels (H, W) by name of one EXR file.

    output: its name. options: for Options, beside what the photographer says of the shot. Raises
    InputError as the product does.
    """
    chosen = Options(**shot.options, lights=shot.lights, outputs=[output], **options)
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder)
        manifest = separate_files(*shot.files, chosen, directory, Progress())
        return manifest, planes_of((directory / output).read_bytes())
