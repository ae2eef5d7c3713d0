"""The commands of calibration. What they need is imported when they run."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.files import read_file, read_table, shown
from service.cli.numbers import circle, lamps_asked_for, read_numbers
from service.cli.options import MaybeFlash, PairFlags
from service.cli.parameters import AsJson, output, with_flags

if TYPE_CHECKING:
    from pipeline.taken_with import Kind

_SETTLE_SECONDS = 1.0  # that a flash told by a command or URL takes to obey

app = typer.Typer(
    help="Calibrate a flash, a camera or lamps, from a pair.",
    rich_markup_mode=None,
)

_CHART_HELP = (
    "Middles of the ColorChecker's outer patches dark skin, bluish green, black and white, in "
    "this order, in pixels of NO_FLASH. Default: it is looked for."
)
Output = Annotated[Path | None, output("FILE", "File to write.")]


@dataclass(frozen=True)
class CalibrationFlags(PairFlags):
    """Where a pair to calibrate by comes from, what it is kept for, and how it is read."""

    no_flash: Annotated[
        Path | None, typer.Argument(metavar="NO_FLASH", help="Photograph without the flash.")
    ] = None
    flash: MaybeFlash = None
    setup: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Keep it for this set-up: `separate --setup NAME` on photographs of this camera "
            "uses it, and `default` is used where no set-up is named.",
        ),
    ] = None
    camera_address: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Have this camera take the pair, like sim://studio?scene=chart, or for lamps "
            "scene=sphere.",
        ),
    ] = None
    flash_switch: Annotated[
        str,
        typer.Option("--flash", metavar="SWITCH", help="What switches its flash, as for capture."),
    ] = "property"
    as_json: AsJson = False

    def photographs(self) -> tuple[bytes, bytes]:
        """Read the files or take the pair. Raises OptionError, InputError, drivers.DriverError."""
        from pipeline.errors import OptionError

        if self.camera_address is None:
            if self.no_flash is None or self.flash is None:
                raise OptionError(
                    "Name two photographs, NO_FLASH and FLASH, or a camera with --camera-address."
                )
            return read_file(self.no_flash, "photograph"), read_file(self.flash, "photograph")
        if self.no_flash is not None:
            raise OptionError("Name photographs or a camera, not both.")
        import drivers
        from service.cli.flash import flash_switch

        switch = flash_switch(self.flash_switch, _SETTLE_SECONDS)
        with drivers.open_camera(self.camera_address) as camera:
            pair = drivers.capture_pair(camera, flash=switch)
        return pair.no_flash.best, pair.flash.best


@app.command()
@with_flags
def flash(
    flags: CalibrationFlags,
    output: Output = None,
    card: Annotated[
        str | None,
        typer.Option(metavar="X,Y,RADIUS", help="A circle on a grey card, in pixels of NO_FLASH."),
    ] = None,
    chart: Annotated[str | None, typer.Option(metavar="X,Y,X,Y,X,Y,X,Y", help=_CHART_HELP)] = None,
    camera: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE", help="The camera, as for separate. Default: from EXIF."),
    ] = None,
) -> None:
    """Find the spectrum of the flash, for --flash-spectrum: from a ColorChecker or a grey card.

    A card tells three numbers, a ColorChecker tells more.
    """
    from pipeline.spectra.tables import parse_sensitivities

    marks = {"card": _circle(card, "card"), "chart": _corners(chart)}
    own = {"camera": read_table(camera, parse_sensitivities)}
    _calibrate("flash", flags, output, {**marks, **own})


@app.command()
@with_flags
def camera(
    flags: CalibrationFlags,
    output: Output = None,
    chart: Annotated[str | None, typer.Option(metavar="X,Y,X,Y,X,Y,X,Y", help=_CHART_HELP)] = None,
    flash_spectrum: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE", help="The flash, as for separate. Default: the likeliest one."
        ),
    ] = None,
) -> None:
    """Find the camera's sensitivities, for --camera: from a ColorChecker.

    The photographs must be RAW or linear files.
    """
    from pipeline.spectra.tables import parse_spectrum

    told = read_table(flash_spectrum, parse_spectrum)
    own = {"chart": _corners(chart), "flash_spectrum": told}
    _calibrate("camera", flags, output, own)


@app.command()
@with_flags
def lamps(
    flags: CalibrationFlags,
    output: Output = None,
    sphere: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,RADIUS",
            help="Outline of the sphere, in pixels of NO_FLASH. Default: it is looked for.",
        ),
    ] = None,
    mirror: Annotated[
        bool, typer.Option("--mirror", help="The sphere is a mirror, not matt grey.")
    ] = False,
    lights: Annotated[str, typer.Option(metavar="auto|1|2|3", help="Number of lamps.")] = "auto",
    focal_px: Annotated[
        float | None,
        typer.Option(metavar="F", help="Focal length in pixels, as for separate."),
    ] = None,
) -> None:
    """Find where distant lamps are, for --light-directions: from a matt grey or mirror sphere."""
    own = {
        "sphere": _circle(sphere, "sphere"),
        "mirror": mirror,
        "lights": lamps_asked_for(lights),
        "focal_px": focal_px,
    }
    _calibrate("lamps", flags, output, own)


def _calibrate(
    kind: Kind, flags: CalibrationFlags, output: Path | None, own: Mapping[str, Any]
) -> None:
    from pydantic import ValidationError

    from pipeline.calibration.calibrate import calibrate_files
    from pipeline.calibration.find_marks import MARKS
    from pipeline.calibration.options import CALIBRATION_OPTIONS, FILES
    from pipeline.errors import OptionError
    from pipeline.progress import Progress
    from service.cli import calibration_file
    from service.cli.display import print_json, stage_bar
    from service.cli.keeping import keep
    from service.sentences import sentence_of

    try:
        values = {"kind": kind, "setup": flags.setup, **flags.pair_values(), **own}
        options = CALIBRATION_OPTIONS.validate_python(values)
    except ValidationError as error:
        raise OptionError(sentence_of(error).removeprefix(f"{kind}.")) from error
    if output is None and options.setup is None:
        raise OptionError("Name a file with --output, or keep it for a set-up with --setup.")
    if output is not None:
        if output.suffix.lower() != ".json":  # perhaps a photograph
            raise OptionError(
                f"A calibration cannot be written as {output}: its name has to end in .json."
            )
        calibration_file.check_target(kind, output)
    before, after = flags.photographs()
    with tempfile.TemporaryDirectory(prefix="lightlayers-") as name:
        with stage_bar() as report:
            manifest = calibrate_files(before, after, options, Path(name), Progress(report))
        content, marks = ((Path(name) / file).read_bytes() for file in (FILES[kind], MARKS))
    if output is not None:
        calibration_file.write(output, content, marks)
    if options.setup is not None:
        path = keep(kind, options.setup, manifest, content, marks)
        output = output or path
    assert output is not None  # one of the two, as was looked at above
    if flags.as_json:
        print_json(manifest)
    else:
        _print_found(kind, manifest, output)


def _print_found(kind: str, manifest: Mapping[str, Any], output: Path) -> None:
    from service.cli.display import duv_of, temperature_of

    found = manifest["found"]
    if kind == "flash":
        white = "" if found["cct_k"] is None else f", {temperature_of(found)}, Duv {duv_of(found)}"
        print(f"A flash like {found['nearest']}{white}.")
        count = "The card is" if found["patches"] == 1 else "The 24 patches are"
        print(f"{count} explained to {found['misfit']:.1%}, seen by {_seer(found['camera'])}.")
    elif kind == "camera":
        print(f"A camera like {found['nearest']}, under {_flash(found['flash'])}.")
        print(f"The 24 patches are explained to {found['misfit']:.1%}.")
    else:
        for number, light in enumerate(found["lights"], 1):
            print(f"lamp{number}: {_place(light)}")
        if "misfit" in found:
            print(f"The light on the sphere is explained to {found['misfit']:.1%}.")
        if "flash_aside_deg" in found:
            print(f"The flash is {found['flash_aside_deg']:.1f}° beside the camera.")
    for warning in manifest["warnings"]:
        print(shown(f"Warning: {warning['message']}"))
    print(shown(output))


def _seer(camera: Mapping[str, str]) -> str:
    return "the camera of --camera" if camera["source"] == "file" else camera["name"]


def _flash(name: str) -> str:
    return "the flash of --flash-spectrum" if name == "table" else f"a flash like {name}"


def _place(light: Mapping[str, Any]) -> str:
    from math import asin, atan2, degrees

    x, y, z = light["direction"]
    side, height = degrees(atan2(x, z)), degrees(asin(y))
    place = (
        f"{abs(side):.1f}° {'right' if side >= 0 else 'left'}, {abs(height):.1f}° "
        f"{'up' if height >= 0 else 'down'} (± {light['deviation_deg']:.1f}°)"
    )
    if "rgb" not in light:
        return place
    rgb = " ".join(f"{value:.3f}" for value in light["rgb"])
    strength = f", strength {light['strength']:.3f}" if "strength" in light else ""
    return f"{place}{strength}, colour {rgb}"


def _numbers(text: str, count: int, option: str) -> list[float]:
    from pipeline.errors import OptionError

    numbers = read_numbers(text)
    if numbers is None or len(numbers) != count:
        raise OptionError(f"--{option} takes {count} numbers with commas between them.")
    return numbers


def _circle(text: str | None, option: str) -> dict[str, float] | None:
    if text is None:
        return None
    return circle(_numbers(text, 3, option))


def _corners(text: str | None) -> list[tuple[float, float]] | None:
    if text is None:
        return None
    numbers = _numbers(text, 8, "chart")
    return list(zip(numbers[::2], numbers[1::2], strict=True))
