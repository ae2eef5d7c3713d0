"""Files that people name, read and shown, what is said of them, and where to write one."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Table = TypeVar("Table")

_CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")


def shown(text: object) -> str:
    """Give a name, or a sentence with names, on one line: controls act on a terminal, so escaped.

    What is no UTF-8 stays as it is.
    """
    return _CONTROLS.sub(lambda found: found[0].encode("unicode_escape").decode(), str(text))


def say(sentence: str) -> None:
    """Tell the person at the terminal."""
    print(shown(sentence), file=sys.stderr, flush=True)


def read_file(path: Path, what: str) -> bytes:
    """Read a file that the user named. Raises pipeline.errors.InputError."""
    from pipeline.errors import InputError, reason_of

    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"The {what} {path} cannot be read: {reason_of(error)}.") from error


def written_path(text: str) -> Path:
    """Read where something is to be written, before any work is done for it.

    Raises pipeline.errors.OptionError.
    """
    from pipeline.errors import OptionError

    if not text:
        raise OptionError("--output is empty: name where to write to; . is the current folder.")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise OptionError(
            f"--output {text!a} is not UTF-8, which OpenEXR needs: give another name."
        ) from error
    return Path(text)


def read_table(value: str | None, parse: Callable[[bytes], Table]) -> Table | str | None:
    """Read a table when a file was named, else the name.

    Raises pipeline.errors.InputError with the file's name: a command may be given several.
    """
    from pipeline.errors import OptionError

    if value is None:
        return None
    path = Path(value)
    with contextlib.suppress(OSError):  # whose reason is told where it is read
        if path.suffix.lower() not in (".csv", ".json") and not path.is_file():
            return value
    data = read_file(path, "file")
    try:
        return parse(data)
    except OptionError as error:
        raise OptionError(f"The file {path} cannot be used. {error}") from error
