"""What the commands that have a camera take pairs share: flags, names and pace."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.cli.files import read_file, say
from service.cli.parameters import a_number

if TYPE_CHECKING:
    import drivers

RECIPE = "_recipe.json"
"""How the names of recipes end."""


@dataclass(frozen=True)
class Shooting:
    """How pairs are taken: what switches the flash, and what is set for both photographs."""

    flash: drivers.Flash
    settings: dict[drivers.SettingName, drivers.SettingValue]

    def take(self, camera: drivers.Camera) -> drivers.CapturedPair:
        """Take a pair. Raises what drivers.capture_pair raises."""
        import drivers

        return drivers.capture_pair(camera, flash=self.flash, settings=self.settings)


@dataclass(frozen=True)
class ShootingFlags:
    """What was typed of how pairs are to be taken."""

    flash: Annotated[
        str,
        typer.Option(
            metavar="SWITCH",
            help='What switches the flash: "property", the camera itself; "operator", somebody who '
            "is asked here; or a command or URL in which {state} becomes on or off.",
        ),
    ] = "property"
    settle: Annotated[
        float,
        typer.Option(
            min=0, max=3600, callback=a_number, help="Seconds that a flash so told takes to obey."
        ),
    ] = 1.0
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="A setting of the camera for both photographs: iso=200, f_number=8, "
            "shutter_s=1/60, white_balance=daylight. Once for each; above those of the recipe.",
        ),
    ] = None
    recipe: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="Take it with the settings of an earlier pair."),
    ] = None

    def shooting(self, tell: Callable[[str], None] = say) -> Shooting:
        """Read it, and the recipe. tell: says what the operator of a flash is to do.

        Raises pipeline.errors.InputError, OptionError.
        """
        from service.cli.flash import flash_switch

        settings = wanted_settings(self.settings, self.recipe)
        return Shooting(flash_switch(self.flash, self.settle, tell), settings)


def wanted_settings(
    typed: Sequence[str] | None, recipe: Path | None
) -> dict[drivers.SettingName, drivers.SettingValue]:
    """Read --recipe and --set. Raises InputError, OptionError."""
    import drivers
    from pipeline.errors import OptionError

    settings = {} if recipe is None else _read_recipe(recipe)
    for text in typed or ():
        name, separator, value = text.partition("=")
        if not separator or name not in list(drivers.SettingName):
            known = ", ".join(each for each in drivers.SettingName if each != "flash")
            raise OptionError(f"--set {text}: write NAME=VALUE, where NAME is one of {known}.")
        settings[drivers.SettingName(name)] = _value(value.strip())
    try:
        drivers.check_settings(settings)
    except drivers.SettingError as error:
        raise OptionError(str(error)) from error
    return settings


def _value(text: str) -> drivers.SettingValue:
    """Read a number, as 200, 5.6 or 1/60, or else a word."""
    try:
        number = float(Fraction(text)) if "/" in text else float(text)
    except (ValueError, ZeroDivisionError, OverflowError):
        return text
    if not math.isfinite(number):
        return text
    return int(number) if number.is_integer() else number


def _read_recipe(path: Path) -> dict[drivers.SettingName, drivers.SettingValue]:
    from pydantic import ValidationError

    from pipeline.errors import InputError
    from service.sending.recipe import Recipe

    try:
        return dict(Recipe.model_validate_json(read_file(path, "recipe")).settings)
    except ValidationError as error:
        raise InputError(
            f"{path} is no recipe: give one that `lightlayers capture` wrote beside a pair."
        ) from error


def new_shot() -> str:
    """Name a pair by the time, to the millisecond, in UTC; names sort in order of time."""
    now = datetime.now(UTC)
    return f"{now:%Y%m%dT%H%M%S}-{now.microsecond // 1000:03}Z"


def ending(kind: str) -> str:
    """How files of a kind end: jpg, or the kind of RAW file."""
    return "jpg" if kind == "jpeg" else kind


def paced(count: int | None, interval_s: float) -> Iterator[int]:
    """Give 1, 2 … count, or no end, so many seconds apart from the beginning of each."""
    begun, number = time.monotonic(), 0
    while count is None or number < count:
        due = begun + number * interval_s
        now = time.monotonic()
        if now > due:  # what was missed is not made up for
            begun += now - due
        time.sleep(max(0.0, due - now))
        number += 1
        yield number
