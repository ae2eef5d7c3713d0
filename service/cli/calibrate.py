"""The commands of calibration. What they need is imported when they run."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from service.cli.options import (
    Flash,
    NoFlash,
    PairFlags,
    read_file,
    read_table,
    with_flags,
)

app = typer.Typer(
    help="Calibrates a flash, a camera or lamps from a pair, into a file that `separate` takes.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

_CHART_HELP = (
    "Middles of the ColorChecker's outer patches dark skin, bluish green, black and white, in "
    "this order, in pixels of NO_FLASH."
)
Output = Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="File to write.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print all that is known as JSON.")]


@app.command()
@with_flags
def flash(
    no_flash: NoFlash,
    flash: Flash,
    output: Output,
    flags: PairFlags,
    card: Annotated[
        str | None,
        typer.Option(metavar="X,Y,RADIUS", help="A circle on a grey card, in pixels of NO_FLASH."),
    ] = None,
    chart: Annotated[str | None, typer.Option(metavar="X,Y,X,Y,X,Y,X,Y", help=_CHART_HELP)] = None,
    camera: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE", help="The camera, as for separate. Default: from EXIF."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find the spectrum of the flash, for --flash-spectrum: from a ColorChecker or a grey card.

    A card tells three numbers, a ColorChecker tells more.
    """
    from pipeline.spectra.tables import parse_sensitivities

    marks = {"card": _circle(card, "card"), "chart": _corners(chart)}
    own = {"camera": read_table(camera, parse_sensitivities)}
    _calibrate("flash", no_flash, flash, output, flags, {**marks, **own}, as_json)


@app.command()
@with_flags
def camera(
    no_flash: NoFlash,
    flash: Flash,
    output: Output,
    flags: PairFlags,
    chart: Annotated[str, typer.Option(metavar="X,Y,X,Y,X,Y,X,Y", help=_CHART_HELP)],
    flash_spectrum: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE", help="The flash, as for separate. Default: the likeliest one."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find the camera's sensitivities, for --camera: from a ColorChecker.

    The photographs must be RAW or linear files.
    """
    from pipeline.spectra.tables import parse_spectrum

    own = {"chart": _corners(chart), "flash_spectrum": read_table(flash_spectrum, parse_spectrum)}
    _calibrate("camera", no_flash, flash, output, flags, own, as_json)


@app.command()
@with_flags
def lamps(
    no_flash: NoFlash,
    flash: Flash,
    output: Output,
    flags: PairFlags,
    sphere: Annotated[
        str,
        typer.Option(
            metavar="X,Y,RADIUS", help="Outline of a matt grey sphere, in pixels of NO_FLASH."
        ),
    ],
    lights: Annotated[str, typer.Option(metavar="auto|1|2|3", help="Number of lamps.")] = "auto",
    focal_px: Annotated[
        float | None,
        typer.Option(metavar="F", help="Focal length in pixels, as for separate."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find where distant lamps are, for --light-directions: from a matt grey sphere."""
    own = {
        "sphere": _circle(sphere, "sphere"),
        "lights": int(lights) if lights.isdecimal() else lights,
        "focal_px": focal_px,
    }
    _calibrate("lamps", no_flash, flash, output, flags, own, as_json)


def _calibrate(
    kind: str,
    no_flash: Path,
    flash: Path,
    output: Path,
    flags: PairFlags,
    own: Mapping[str, Any],
    as_json: bool,
) -> None:
    from pydantic import ValidationError

    from pipeline.calibration.calibrate import calibrate_files
    from pipeline.calibration.options import CALIBRATION_OPTIONS, FILES
    from pipeline.errors import InputError, OptionError
    from pipeline.progress import Progress
    from service.cli.display import stage_bar
    from service.errors import sentence_of

    try:
        options = CALIBRATION_OPTIONS.validate_python({"kind": kind, **flags.pair_values(), **own})
    except ValidationError as error:
        raise OptionError(sentence_of(error).removeprefix(f"{kind}.")) from error
    before, after = read_file(no_flash, "photograph"), read_file(flash, "photograph")
    with tempfile.TemporaryDirectory(prefix="lightlayers-") as name:
        with stage_bar() as report:
            manifest = calibrate_files(before, after, options, Path(name), Progress(report))
        content = (Path(name) / FILES[kind]).read_bytes()
    try:
        output.write_bytes(content)
    except OSError as error:
        reason = (error.strerror or "it cannot be written").lower()
        raise InputError(f"The file {output} cannot be written: {reason}.") from error
    _print_found(kind, manifest, output, as_json)


def _print_found(kind: str, manifest: Mapping[str, Any], output: Path, as_json: bool) -> None:
    if as_json:
        json.dump(manifest, sys.stdout, indent=2, ensure_ascii=False)
        print()
        return
    found = manifest["found"]
    if kind == "flash":
        kelvin = "" if found["cct_k"] is None else f", {found['cct_k']} K, Duv {found['duv']:+.3f}"
        print(f"A flash like {found['nearest']}{kelvin}.")
        count = "The card is" if found["patches"] == 1 else "The 24 patches are"
        print(f"{count} explained to {found['misfit']:.1%}, seen by {found['camera']['name']}.")
    elif kind == "camera":
        print(f"A camera like {found['nearest']}, under a flash like {found['flash']}.")
        print(f"The 24 patches are explained to {found['misfit']:.1%}.")
    else:
        for number, light in enumerate(found["lights"], 1):
            print(f"lamp{number}: {_place(light)}")
        print(
            f"The light on the sphere is explained to {found['misfit']:.1%}; the flash is ", end=""
        )
        print(f"{found['flash_aside_deg']:.1f}° beside the camera.")
    for warning in manifest["warnings"]:
        print(f"Warning: {warning['message']}")
    print(output)


def _place(light: Mapping[str, Any]) -> str:
    from math import asin, atan2, degrees

    x, y, z = light["direction"]
    side, height = degrees(atan2(x, z)), degrees(asin(y))
    rgb = " ".join(f"{value:.3f}" for value in light["rgb"])
    return (
        f"{abs(side):.1f}° {'right' if side >= 0 else 'left'}, {abs(height):.1f}° "
        f"{'up' if height >= 0 else 'down'} (± {light['deviation_deg']:.1f}°), strength "
        f"{light['strength']:.3f}, colour {rgb}"
    )


def _numbers(text: str, count: int, option: str) -> list[float]:
    from pipeline.errors import OptionError

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise OptionError(f"--{option} takes {count} numbers with commas between them.")
    return numbers


def _circle(text: str | None, option: str) -> dict[str, float] | None:
    if text is None:
        return None
    x, y, radius = _numbers(text, 3, option)
    return {"x": x, "y": y, "radius": radius}


def _corners(text: str | None) -> list[tuple[float, float]] | None:
    if text is None:
        return None
    numbers = _numbers(text, 8, "chart")
    return list(zip(numbers[::2], numbers[1::2], strict=True))
