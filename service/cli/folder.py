"""Folders of results that are never seen half written."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pipeline.errors import InputError

_LAST = "manifest.json"


@contextlib.contextmanager
def new_results(target: Path) -> Iterator[Path]:
    """Make a folder whose files move to `target` once the block ends without an error.

    What an earlier manifest in `target` lists is replaced, anything else there is left alone; the
    manifest moves last. Raises InputError where `target` cannot be written.
    """
    is_new = not target.exists()
    try:
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target, prefix=".partial-") as name:
            folder = Path(name)
            yield folder
            files = sorted(folder.iterdir(), key=lambda path: (path.name == _LAST, path.name))
            for old in _earlier_files(target):
                (target / old).unlink(missing_ok=True)
            for path in files:
                path.replace(target / path.name)
    except BaseException as error:
        if is_new:
            with contextlib.suppress(OSError):
                target.rmdir()
        if isinstance(error, OSError):
            reason = (error.strerror or "it cannot be written").lower()
            raise InputError(f"The folder {target} cannot be written: {reason}.") from error
        raise


def _earlier_files(target: Path) -> list[str]:
    """Names of the files of an earlier run, from its manifest."""
    try:
        listed = [file["name"] for file in json.loads((target / _LAST).read_bytes())["files"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [_LAST, *(name for name in listed if Path(name).name == name)]
