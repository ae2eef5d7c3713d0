"""The commands of keys. What they need is imported when they run."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.parameters import AllAsJson

if TYPE_CHECKING:
    import sqlalchemy as sa

    from service.rows.keys import Key, Scope

app = typer.Typer(
    help="Make, list and revoke the keys that requests bear.",
    rich_markup_mode=None,
)

_NAME_LETTERS = 100
_MOST_JOBS, _MOST_BYTES = 2**31 - 1, 2**63 - 1  # that the database can hold
_DAY_SECONDS = 86400


@app.command()
def create(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Who or what gets the key.")],
    scopes: Annotated[
        str,
        typer.Option(
            help="What it is good for, with commas: submit (jobs), read (states and results), "
            "capture (cameras), admin (all of it, with the jobs of every key)."
        ),
    ] = "submit,read",
    waiting_jobs: Annotated[
        int | None, typer.Option(min=1, max=_MOST_JOBS, help="Jobs that may wait at a time.")
    ] = None,
    jobs_per_day: Annotated[
        int | None, typer.Option(min=1, max=_MOST_JOBS, help="Jobs that it may make a day, UTC.")
    ] = None,
    stored_bytes: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=_MOST_BYTES,
            help="Bytes of its jobs' photographs and results, and of its uploads.",
        ),
    ] = None,
    days: Annotated[float | None, typer.Option(help="Expires after so many days.")] = None,
) -> None:
    """Make a key and print it, this once: no command shows it again."""
    from service.rows import keys

    if not (name.isprintable() and name.strip() and len(name) <= _NAME_LETTERS):
        raise _bad(f"NAME: write 1 to {_NAME_LETTERS} characters that can be printed")
    if days is not None and not 0 < days < 36500:
        raise _bad("--days: write a number between 0 and 36500")
    wanted = _scopes(scopes)
    quotas = keys.Quotas(waiting_jobs, jobs_per_day, stored_bytes)
    lifetime = None if days is None else days * _DAY_SECONDS
    with _database() as connection:
        text = keys.create(connection, name, wanted, quotas, lifetime)
    print(text)
    print(
        f"This is the key {keys.id_of(text)}. Keep it now, it is not shown again: apps send it as "
        "`Authorization: Bearer …`, and `lightlayers submit` takes it from LIGHTLAYERS_KEY.",
        file=sys.stderr,
    )


@app.command("list")
def list_keys(
    as_json: AllAsJson = False,
) -> None:
    """List the keys that were made: id, name, scopes, quotas, and when they were used last."""
    from service.cli.display import print_json
    from service.rows import keys

    with _database() as connection:
        found = keys.list_keys(connection)
    if as_json:
        print_json([_describe(key) for key in found])
        return
    _print_table(found)


@app.command()
def revoke(
    key_id: Annotated[
        str, typer.Argument(metavar="ID", help="The letters between ll_ and the next _.")
    ],
) -> None:
    """Let a key be used no more, at once and for ever; its jobs stay."""
    from service.rows import keys

    with _database() as connection:
        found = keys.revoke(connection, key_id)
    if not found:
        raise _bad("There is no key of this ID; `lightlayers keys list` shows them")
    print(f"The key {key_id} is revoked.")


def key_of_requests(file: Path | None) -> str | None:
    """Find the key to send: of a file, or of LIGHTLAYERS_KEY; None without either.

    On no command line, since every user of the machine can read those. Raises OptionError.
    """
    from service.cli.files import read_file
    from service.rows import keys

    if file is not None:
        text = read_file(file, "key").decode("utf-8", "replace").strip()
    else:
        text = os.environ.get("LIGHTLAYERS_KEY", "").strip()
        if not text:
            return None
    if not keys.is_key(text):
        place = f"The file {file}" if file else "LIGHTLAYERS_KEY"
        raise _bad(f"{place} holds no key of a service: those begin with ll_, and none is cut off")
    return text


def _bad(sentence: str) -> Exception:
    from pipeline.errors import OptionError

    return OptionError(f"{sentence}.")


def _scopes(text: str) -> set[Scope]:
    from service.rows.keys import Scope

    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in list(Scope):
            raise _bad(f"--scopes: there is no {name!r}; there are {', '.join(Scope)}")
    return set(map(Scope, names))


@contextlib.contextmanager
def _database() -> Iterator[sa.Connection]:
    from service import logs
    from service.opening import open_database
    from service.settings import Settings

    logs.configure()
    engine = open_database(Settings())
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()


def _describe(key: Key) -> dict[str, object]:
    return {
        "id": key.id,
        "name": key.name,
        "scopes": sorted(key.scopes),
        "waiting_jobs": key.quotas.waiting_jobs,
        "jobs_per_day": key.quotas.jobs_per_day,
        "stored_bytes": key.quotas.stored_bytes,
        "created": _time(key.created),
        "expires": _time(key.expires),
        "revoked": _time(key.revoked),
        "used": _time(key.used),
    }


def _time(seconds: float | None) -> str | None:
    if seconds is None:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="minutes")


def _print_table(found: list[Key]) -> None:
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

    table = Table(
        Column("id", no_wrap=True), "name", "scopes", "quotas", Column("used", no_wrap=True), "ends"
    )
    for key in found:
        told = _describe(key)
        quotas = [
            f"{name.replace('_', ' ')} {told[name]:,}"
            for name in ("waiting_jobs", "jobs_per_day", "stored_bytes")
            if told[name]
        ]
        revoked, expires = _date(key.revoked), _date(key.expires)
        cells = (
            key.id,
            key.name,
            ", ".join(sorted(key.scopes)),
            ", ".join(quotas) or "none",
            _date(key.used) or "never",
            f"revoked {revoked}" if revoked else expires or "never",
        )
        table.add_row(*map(Text, cells))
    Console(highlight=False).print(table)


def _date(seconds: float | None) -> str | None:
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC).date().isoformat()
