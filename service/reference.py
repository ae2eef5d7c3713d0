"""The pages of docs/reference, written from the code: python -m service.reference FOLDER."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

import service.cli
from pipeline.options import Options
from service.cli.commands import app
from service.openapi import document
from service.problems import INTERNAL, INVALID, KINDS
from service.settings import Settings

_WIDTH = 80  # what terminals of help pages are at most


def pages() -> dict[str, str]:
    """Give every page by its file name."""
    return {
        "commands.md": _commands(),
        "options.md": _options(),
        "settings.md": _settings(),
        "http.md": _http(),
    }


def _commands() -> str:
    what, _, codes = (service.cli.__doc__ or "").strip().partition("\n\n")
    text = ["# Commands\n", f"{what}\n\n{codes}\n"]
    for words in _walk(app, []):
        text.append(f"## {' '.join(['lightlayers', *words])}\n\n```\n{_help(words)}\n```\n")
    return "\n".join(text)


def _walk(group: typer.Typer, words: list[str]) -> Iterable[list[str]]:
    yield words
    for command in group.registered_commands:
        assert command.callback is not None
        yield [*words, command.name or command.callback.__name__.replace("_", "-")]
    for below in group.registered_groups:
        assert below.typer_instance is not None
        yield from _walk(below.typer_instance, [*words, str(below.name)])


def _help(words: list[str]) -> str:
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        app([*words, "--help"], prog_name="lightlayers", standalone_mode=False)
    return "\n".join(line.rstrip() for line in text.getvalue().strip().splitlines())


def _options() -> str:
    return (
        "# Options of a separation\n\nThe part `options` of a request, as JSON; the command line "
        "has them as flags.\n\n" + _fields(Options, "")
    )


def _settings() -> str:
    return (
        "# Settings\n\nRead from the environment; every process of one service needs the same "
        "ones, but for the ports of processes that share a host.\n\n"
        + _fields(Settings, "LIGHTLAYERS_")
    )


def _fields(model: type[BaseModel], prefix: str) -> str:
    rows = []
    for name, field in model.model_fields.items():
        if field.default_factory is not None:
            default = "below `LIGHTLAYERS_DATA_DIR`" if prefix else "none"
        elif field.default is PydanticUndefined:
            default = "must be given"
        else:
            default = _shown(field.default, prefix)
        shown = f"{prefix}{name.upper()}" if prefix else name
        rows.append([f"`{shown}`", default, field.description or ""])
    return _table(["name", "default", "what"], rows)


def _shown(default: Any, prefix: str) -> str:
    """A default as a request or, with a prefix, the environment has it."""
    if default in (None, (), ""):
        return "none"
    return f"`{default if prefix else json.dumps(default)}`"


def _http() -> str:
    whole = json.loads(document())
    rows = []
    for path, methods in whole["paths"].items():
        for method, operation in methods.items():
            statuses = ", ".join(sorted(operation["responses"]))
            said = operation.get("description") or operation.get("summary", "")
            rows.append([f"`{method.upper()} {path}`", said.partition("\n")[0], statuses])
    kinds = {kind.name: kind for kind in (*KINDS.values(), INVALID, INTERNAL)}
    problems = [
        [f"`{kind.name}`", str(kind.status), kind.title, "yes" if kind.retryable else "no"]
        for kind in sorted(kinds.values(), key=lambda kind: (kind.status, kind.name))
    ]
    return (
        "# HTTP\n\n`openapi.json` has every schema; a running service shows it at `/docs`.\n\n"
        + _table(["route", "what", "answers"], rows)
        + "\n## Problems\n\nErrors are `application/problem+json` (RFC 9457). `type` is "
        "`urn:lightlayers:problem:` and a name of this table, or `http-` and the status where no "
        "route takes the request, and stays the same from version to version; `detail` is a "
        "sentence for people.\n\n"
        + _table(["name", "status", "what", "may succeed later"], problems)
    )


def _table(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    lines += [f"| {' | '.join(cell.replace('|', '&#124;') for cell in row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the pages into the folder that is named."""
    os.environ["COLUMNS"] = str(_WIDTH)  # whatever the terminal
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
