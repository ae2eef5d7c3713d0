"""Parameters that several commands have: what they are called, and what --help says of them."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

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


def with_flags(command: Callable[..., object]) -> Callable[..., object]:
    """Replace the parameter `flags` of a command by one command line option per field of its type.

    The type is a dataclass whose fields are annotated like parameters of a command.
    """
    parameters = inspect.signature(command, eval_str=True).parameters
    kind = parameters["flags"].annotation
    own = [parameter for parameter in parameters.values() if parameter.name != "flags"]
    hints = get_type_hints(kind, include_extras=True)
    added = [
        inspect.Parameter(
            field.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=field.default,
            annotation=hints[field.name],
        )
        for field in fields(kind)
    ]

    def wrapper(**arguments: Any) -> object:
        flags = kind(**{field.name: arguments.pop(field.name) for field in fields(kind)})
        return command(**arguments, flags=flags)

    wrapper.__name__ = command.__name__
    wrapper.__doc__ = command.__doc__
    keyword_only = [item.replace(kind=inspect.Parameter.KEYWORD_ONLY) for item in own]
    wrapper.__signature__ = inspect.Signature([*keyword_only, *added])  # type: ignore[attr-defined]
    return wrapper
