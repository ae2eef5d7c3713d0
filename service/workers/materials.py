"""What an attempt lays before the process of its task: photographs, layers, calibrations."""

from __future__ import annotations

import contextlib
from functools import partial
from pathlib import Path

from pipeline.calibration.options import FILES
from pipeline.result_names import LAYERS, MANIFEST
from service.errors import LayersGoneError
from service.frames import FRAMES
from service.object_keys import results_key
from service.rows import jobs, kept
from service.workers import kept_file
from service.workers.means import Means


def fetch_pair(means: Means, directory: Path) -> None:
    """Fetch the photographs of a job, which has them. Raises FileNotFoundError."""
    assert means.job.inputs is not None
    for frame in FRAMES:
        key = means.job.inputs[frame]["key"]
        means.patiently(partial(means.storage.get_file, key, directory / frame))


def fetch_layers(means: Means, directory: Path) -> None:
    """Fetch the layers that a mix is of, and their manifest. Raises LayersGoneError."""
    with means.engine.connect() as connection:
        source = jobs.find(connection, means.job.options["of"])
    try:
        if source is None:
            raise FileNotFoundError
        for name in (LAYERS, MANIFEST):
            key = results_key(source.id, source.attempt, name)
            means.patiently(partial(means.storage.get_file, key, directory / name))
    except FileNotFoundError as error:
        raise LayersGoneError(
            "The job whose layers were to be mixed has been deleted; separate the pair anew."
        ) from error


def bring_kept(means: Means, directory: Path) -> None:
    """Bring the calibrations that are kept for the set-up of a separation."""
    with means.engine.connect() as connection:
        rows = kept.for_separation(connection, means.job)
    found = []
    for row in rows:
        key = results_key(row.id, row.attempt, FILES[row.options["kind"]])
        with contextlib.suppress(FileNotFoundError):  # deleted at this moment
            found.append(kept.made_of(row, means.patiently(partial(means.storage.get, key))))
    means.patiently(partial(kept_file.write, directory, found))
