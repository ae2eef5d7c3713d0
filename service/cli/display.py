"""What people see: progress while it runs, a summary when it is done."""

from __future__ import annotations

import codecs
import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Column, Table
from rich.text import Text

from pipeline.result_names import MANIFEST
from service.cli.files import shown

Report = Callable[[str, float], None]

_UNLIMITED = 1000
"""Columns of a terminal in which every table has room."""


@contextlib.contextmanager
def stage_bar(lines: bool = False) -> Iterator[Report]:
    """Show a bar per stage on stderr; gives report(stage, fraction).

    Where stderr is no terminal there is nothing, or with `lines` one line per stage.
    """
    console = Console(stderr=True, highlight=False)
    columns = (
        TextColumn("{task.description:<8}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bars: dict[str, TaskID] = {}

        def report(stage: str, fraction: float) -> None:
            if stage not in bars:
                for bar in bars.values():
                    progress.update(bar, completed=1.0)
                bars[stage] = progress.add_task(stage, total=1.0)
                if lines and not console.is_terminal:
                    console.print(f"{stage} …")
            progress.update(bars[stage], completed=fraction)

        yield report
        for bar in bars.values():
            progress.update(bar, completed=1.0)


def print_json(value: object, indent: int | None = 2) -> None:
    """Print JSON on stdout; without indent it is one line.

    Names are as they are in UTF-8, which JSON is; in other encodings they are escaped.
    """
    escaped = sys.stdout is not None and codecs.lookup(sys.stdout.encoding).name != "utf-8"
    print(json.dumps(value, indent=indent, ensure_ascii=escaped), flush=True)


def print_results(manifest: Mapping[str, Any], folder: Path, as_json: bool) -> None:
    """Print the manifest as JSON, or a short summary of it, on stdout."""
    if as_json:
        print_json(manifest)
        return
    console = Console(highlight=False)
    _print_lamps(console, manifest["lamps"])
    for file in [*manifest["files"], {"name": MANIFEST}]:
        console.print(Text(shown(folder / file["name"])), soft_wrap=True)
    for warning in manifest["warnings"]:
        console.print(Text(shown(f"Warning: {warning['message']}")), soft_wrap=True)


def _print_lamps(console: Console, lamps: list[Mapping[str, Any]]) -> None:
    """Print a table, or where its columns do not fit a list."""
    facts = ("colour", "CCT", "Duv", "family", "confidence")
    rows = [_facts(lamp) for lamp in lamps]
    whole = (
        Column(name, no_wrap=True, min_width=max(map(len, values)))
        for name, *values in list(zip(facts, *rows, strict=True))[:3]
    )
    table = Table(Column("lamp", no_wrap=True), Column("", no_wrap=True), *whole, *facts[3:])
    for lamp, row in zip(lamps, rows, strict=True):
        table.add_row(Text(lamp["name"]), chip_of(lamp), *row)
    unlimited = console.options.update(max_width=_UNLIMITED)  # measured is what is not cut
    if console.measure(table, options=unlimited).minimum <= console.width:
        console.print(table)
        return
    for lamp, row in zip(lamps, rows, strict=True):
        console.print(Text.assemble(lamp["name"], " ", chip_of(lamp)))
        for name, value in zip(facts, row, strict=True):
            console.print(Text(f"  {name} {value}"))


def _facts(lamp: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        " ".join(f"{value:.3f}" for value in lamp["rgb"]),
        temperature_of(lamp),
        duv_of(lamp),
        f"{lamp['family']} {lamp['family_confidence']:.2f}",
        f"{lamp['confidence']:.2f}",
    )


def chip_of(lamp: Mapping[str, Any]) -> Text:
    """Show a lamp's colour."""
    return Text("██", style=lamp["srgb"])


def temperature_of(light: Mapping[str, Any], without: str = "none") -> str:
    """Tell a light's correlated colour temperature; without: the word for one far from white."""
    return without if light["cct_k"] is None else f"{light['cct_k']:.0f} K"


def duv_of(light: Mapping[str, Any]) -> str:
    """Tell how far a light lies from the black body's colours."""
    return "none" if light["duv"] is None else f"{light['duv']:+.3f}"
