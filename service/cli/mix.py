"""lightlayers mix: the layers of a folder of results, mixed into one picture."""

from __future__ import annotations

import codecs
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.files import read_file, shown
from service.cli.parameters import output
from service.cli.partial import partial_folder

if TYPE_CHECKING:
    from pipeline.mixes.mix_options import Mix

_NUMBERS = {"ev": "ev", "temperature": "temperature_k", "tint": "tint"}
_SETTINGS = "off, neutral, ev=STOPS, temperature=KELVIN, tint=STEPS, rgb=#rrggbb"


def mix(
    results: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of results, with layers.exr.")
    ],
    output: Annotated[Path, output("FILE", "Picture: .jpg, .tif or .exr.")],
    preset: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Settings as the page saves them.")
    ] = None,
    lamp: Annotated[
        list[str] | None,
        typer.Option(
            metavar="N:SETTING,…",
            help=f"Settings of lamp N, above those of the preset: {_SETTINGS}; a tint needs a "
            "temperature beside it. Once for each lamp.",
        ),
    ] = None,
) -> None:
    """Mix the lamps of a result, each as bright as you like.

    They may have any colour, too, and a lamp that is not named stays as it is. With no settings at
    all the picture is the photograph without the flash, or nearly, where it was separated with
    --method paper.
    """
    from pipeline.errors import InputError, reason_of
    from pipeline.mixes.mix_files import check_target, format_of, mix_files, read_manifest
    from pipeline.mixes.mix_options import read_basis
    from pipeline.progress import Progress
    from service.cli.display import stage_bar

    format_of(output)
    manifest = read_manifest(results)
    check_target(results, manifest, output)
    try:
        beside = read_manifest(output.parent)
    except InputError:
        pass  # there are no other results, which begin as a mix does
    else:
        check_target(output.parent, beside, output)
    count = len(read_basis(manifest).lamps)
    settings = _settings(preset, lamp or [], count)
    try:
        with partial_folder(output.parent) as folder:
            partial = folder / output.name
            with stage_bar() as report:
                mix_files(results, settings, partial, Progress(report))
            if output.exists() and _head(output) != _head(partial):  # perhaps a photograph
                raise InputError(
                    f"The picture {output} would be lost, which is no mix of these layers: give "
                    "another name, or remove it first."
                )
            partial.replace(output)
    except OSError as error:
        raise InputError(f"The picture {output} cannot be written: {reason_of(error)}.") from error
    print(shown(output))


def _head(picture: Path) -> bytes:
    """Read the start of a picture: the same in all mixes of one size and format.

    That of a photograph, or of another program's picture, differs.
    """
    with picture.open("rb") as file:
        return file.read(256)


def _settings(preset: Path | None, typed: list[str], count: int) -> Mix:
    from pydantic import ValidationError

    from pipeline.errors import OptionError
    from pipeline.mixes.mix_options import Mix
    from service.sentences import sentence_of

    values: Any = {"lamps": [{} for _ in range(count)]}
    try:
        if preset is not None:
            values = _read_preset(preset)
        for text in typed:
            lamp, settings = _lamp(text, len(values["lamps"]))
            values["lamps"][lamp] |= settings
        return Mix.model_validate(values)
    except ValidationError as error:
        raise OptionError(sentence_of(error)) from error


def _read_preset(path: Path) -> Any:
    from pydantic import ValidationError

    from pipeline.errors import OptionError
    from pipeline.mixes.mix_options import Mix
    from service.sentences import sentence_of

    try:
        text = read_file(path, "preset").removeprefix(codecs.BOM_UTF8)  # as editors may add it
        return Mix.model_validate_json(text).model_dump()
    except ValidationError as error:
        raise OptionError(f"{path} is no preset of the page: {sentence_of(error)}") from error


def _lamp(text: str, count: int) -> tuple[int, dict[str, Any]]:
    """Read N:SETTING,…: the lamp, from 0, and its settings by name."""
    from pipeline.errors import OptionError

    number, colon, rest = text.partition(":")
    if not colon or number not in map(str, range(1, count + 1)):
        raise OptionError(
            f"--lamp {text[:80]}: begin with the number of a lamp, 1 to {count}, and a colon."
        )
    settings: dict[str, Any] = {}
    for part in rest.split(","):
        name, _, value = part.strip().partition("=")
        if (name, value) in (("off", ""), ("on", "")):
            settings["on"] = name == "on"
        elif (name, value) == ("neutral", ""):
            settings["neutral"] = True
        elif name in _NUMBERS and value:
            settings[_NUMBERS[name]] = value
        elif name == "rgb":
            settings["rgb"] = _linear(value)
        else:
            raise OptionError(f"--lamp {text[:80]}: {part[:40]!r} is none of {_SETTINGS}.")
    return int(number) - 1, settings


def _linear(text: str) -> list[float]:
    """Linear red, green and blue of #rrggbb, the largest 1: a gel takes light away."""
    import numpy as np

    from pipeline.colour.curves import srgb_to_linear
    from pipeline.errors import OptionError

    digits = text.removeprefix("#")
    if len(digits) != 6 or not set(digits.lower()) <= set("0123456789abcdef"):
        raise OptionError(f"{text[:40]!r} is no colour of the form #rrggbb.")
    linear = srgb_to_linear(np.frombuffer(bytes.fromhex(digits), np.uint8) / 255)
    return [float(value) for value in linear / max(float(linear.max()), 1e-9)]
