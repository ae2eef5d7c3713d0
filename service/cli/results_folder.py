"""Folders of results that are never seen half written."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path

from pipeline.errors import InputError, reason_of
from pipeline.output_names import OUTPUT_NAMES
from pipeline.result_names import MANIFEST
from service.cli.partial import partial_folder

REPORT = "report.html"
"""What `report` writes beside the results, unless told otherwise."""

_NUMBER = re.compile(r"(?<=lamp)[1-9](?=\.)")
"""Of a lamp, in place of the s that the name of the output has."""


@contextlib.contextmanager
def new_results(target: Path) -> Iterator[Path]:
    """Make a folder whose files move to `target` once the block ends without an error.

    With a manifest, which moves last, they replace an earlier run's outputs and report; anything
    else in `target` is left alone, but what killed runs have left half written. Raises InputError
    where `target` cannot be written, and where a file that is no result of an earlier run would be
    lost.
    """
    made: list[Path] = []
    try:
        made = [folder for folder in (target, *target.parents) if not folder.exists()]
        target.mkdir(parents=True, exist_ok=True)
        with partial_folder(target) as folder:
            yield folder
            with _alone(target):
                _move(folder, target)
    except BaseException as error:
        for each in made:
            with contextlib.suppress(OSError):  # it holds something, or was not made
                each.rmdir()
        if isinstance(error, OSError):
            raise InputError(
                f"The folder {target} cannot be written: {reason_of(error)}."
            ) from error
        raise


@contextlib.contextmanager
def _alone(target: Path) -> Iterator[None]:
    """Hold a folder, so that files of two runs that end at once do not mix."""
    descriptor = os.open(target, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _move(folder: Path, target: Path) -> None:
    files = sorted(folder.iterdir(), key=lambda path: (path.name == MANIFEST, path.name))
    earlier = _earlier_files(target) if (folder / MANIFEST).exists() else []
    _check_lost(target, {path.name for path in files} - set(earlier))
    for old in earlier:
        (target / old).unlink(missing_ok=True)
    for path in files:
        path.replace(target / path.name)


def _check_lost(target: Path, new: set[str]) -> None:
    """Refuse to move files of these names over others. Raises InputError."""
    lost = sorted(name for name in new if (target / name).exists())
    if lost:
        raise InputError(
            f"The file {target / lost[0]} would be lost, which is no result of an earlier run: "
            "give another folder, or move it first."
        )


def _earlier_files(target: Path) -> list[str]:
    """Names of the files of an earlier run: the outputs of its manifest, and its report."""
    try:
        manifest = json.loads((target / MANIFEST).read_bytes())
        listed = [str(file["name"]) for file in manifest["files"]]
        ours = "lightlayers" in manifest["versions"]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    if not ours:
        return []
    names = [MANIFEST, *(name for name in listed if _NUMBER.sub("s", name) in OUTPUT_NAMES)]
    return [*names, REPORT] if _is_report(target / REPORT) else names


def _is_report(path: Path) -> bool:
    if not path.is_file():
        return False
    from service.cli.report import is_report  # only here: it takes time to import

    return is_report(path)
