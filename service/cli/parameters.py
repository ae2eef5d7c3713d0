"""Parameters that several commands have: what they are called, and what --help says of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.files import written_path


def a_number(seconds: float | None) -> float | None:
    """Refuse nan, which no bound of an option does. Raises typer.BadParameter."""
    if seconds is not None and math.isnan(seconds):
        raise typer.BadParameter("nan is no number of seconds.")
    return seconds


def output(metavar: str, text: str) -> Any:
    """Make the option of where to write to; what it raises is that of written_path."""
    return typer.Option("-o", "--output", metavar=metavar, parser=written_path, help=text)


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
AllAsJson = Annotated[bool, typer.Option("--json", help="Print all of it as JSON.")]
KeyFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="File with the key. Default: LIGHTLAYERS_KEY, or none."),
]
FlashSwitch = Annotated[
    str,
    typer.Option(
        metavar="SWITCH",
        help='What switches the flash: "property", the camera itself; "operator", somebody who '
        "is asked here; or a command or URL in which {state} becomes on or off.",
    ),
]
Settle = Annotated[
    float,
    typer.Option(
        min=0, max=3600, callback=a_number, help="Seconds that a flash so told takes to obey."
    ),
]
SetValues = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="A setting of the camera for both photographs: iso=200, f_number=8, shutter_s=1/60, "
        "white_balance=daylight. Once for each; above those of the recipe.",
    ),
]
RecipeFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE.json", help="Take it with the settings of an earlier pair."),
]
