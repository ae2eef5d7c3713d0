"""The options of a separation as flags, shared by the commands that take a pair."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.files import read_file, read_table
from service.cli.numbers import circle, lamps_asked_for, read_numbers

if TYPE_CHECKING:
    from pipeline.options import Options

NoFlash = Annotated[Path, typer.Argument(metavar="NO_FLASH", help="Photograph without the flash.")]
NoFlashOrFolder = Annotated[
    Path,
    typer.Argument(
        metavar="NO_FLASH|FOLDER",
        help="Photograph without the flash; or, alone, a folder with pairs.",
    ),
]
MaybeFlash = Annotated[
    Path | None, typer.Argument(metavar="FLASH", help="Photograph with the flash.")
]
Flash = Annotated[Path, typer.Argument(metavar="FLASH", help="Photograph with the flash.")]


@dataclass(frozen=True)
class PairFlags:
    """How the photographs are read and laid together; see pipeline.options.PairOptions."""

    encoding: Annotated[
        str,
        typer.Option(
            metavar="auto|linear|srgb",
            help="How the pixel values are encoded; auto: RAW, DNG, 16-bit and float files linear, "
            "8-bit ones sRGB, files with an ICC profile, PNG with a cICP, sRGB, gAMA or cHRM "
            "chunk, and EXR with chromaticities as that says.",
        ),
    ] = "auto"
    flash_only: Annotated[
        bool, typer.Option("--flash-only", help="FLASH already is the flash part alone.")
    ] = False
    exposure_ratio: Annotated[
        float | None,
        typer.Option(
            metavar="R",
            help="Flash frame's exposure ÷ no-flash frame's. Default: from EXIF, else as the "
            "pair shows it, else 1.",
        ),
    ] = None
    no_align: Annotated[
        bool, typer.Option("--no-align", help="Do not warp the flash frame onto the other.")
    ] = False

    def pair_values(self) -> dict[str, Any]:
        """Values of PairOptions by name, without those that were not typed."""
        values = {
            "encoding": self.encoding,
            "flash_only": self.flash_only,
            "exposure_ratio": self.exposure_ratio,
            "align": False if self.no_align else None,
        }
        return self.typed(values)

    def typed(self, values: dict[str, Any]) -> dict[str, Any]:
        """Leave out what is None, or what the flag of its name is when it is not typed."""
        return {
            name: value
            for name, value in values.items()
            if value not in (None, getattr(type(self), name, None))
        }


@dataclass(frozen=True)
class Flags(PairFlags):
    """What was typed; see pipeline.options.Options for what it means."""

    setup: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|none",
            help="Set-up whose kept calibrations stand in for --camera, --flash-spectrum and "
            "--light-directions. Default: the one named default, if there is one.",
        ),
    ] = None
    lights: Annotated[str, typer.Option(metavar="auto|1|2|3", help="Number of lamps.")] = "auto"
    method: Annotated[
        str,
        typer.Option(metavar="best|paper", help="Our best, or the algorithms as published."),
    ] = "best"
    quality: Annotated[
        str,
        typer.Option(
            metavar="best|balanced|fast",
            help="How widely the method best averages noise; see docs/performance.md.",
        ),
    ] = "best"
    basis: Annotated[
        str, typer.Option(metavar="wpca|pca|joint", help="How the bases are learnt.")
    ] = "wpca"
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="The camera; FILE: CSV wavelength_nm,R,G,B or AMPAS JSON. Default: from EXIF.",
        ),
    ] = None
    flash_spectrum: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="The flash; FILE: CSV wavelength_nm,power. Default: xenon.",
        ),
    ] = None
    neutral: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="The light that white-balanced pictures are shown under; FILE: CSV "
            "wavelength_nm,power. Default: D65.",
        ),
    ] = None
    light_directions: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json",
            help="Directions of two or three lamps, for normals; see docs/separating.md.",
        ),
    ] = None
    pin_lamp: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,RADIUS|NAME|FILE",
            help="A lamp that is there: by an area that it lights alone, in pixels of NO_FLASH, or "
            "by its spectrum. Once for every such lamp.",
        ),
    ] = None
    forbid_lamp: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,RADIUS|NAME|FILE",
            help="A light that is none of the other lamps, given like --pin-lamp.",
        ),
    ] = None
    response: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="A camera through which to show the picture anew; FILE as for --camera.",
        ),
    ] = None
    focal_px: Annotated[
        float | None,
        typer.Option(
            metavar="F",
            help="Focal length in pixels. Default: from EXIF, else as of 50 mm on 36 × 24 mm.",
        ),
    ] = None
    normals: Annotated[
        str,
        typer.Option(
            metavar="gl|dx",
            help="Where y of written normals points: up, as OpenGL has it, or down, as DirectX.",
        ),
    ] = "gl"
    outputs: Annotated[
        str,
        typer.Option(
            metavar="default|all|NAME,NAME…",
            help="Files to write; docs/results.md describes them. lamps.tif and lamps.jpg name "
            "those of all lamps.",
        ),
    ] = "default"

    def options(self) -> Options:
        """Read the files that were named and make the options; what was not typed is unset.

        Raises pipeline.errors.OptionError.
        """
        from pipeline.options import Options
        from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
        from service.sentences import in_words

        values = {
            "setup": self.setup,
            "lights": lamps_asked_for(self.lights),
            "method": self.method,
            "quality": self.quality,
            "basis": self.basis,
            "camera": read_table(self.camera, parse_sensitivities),
            "flash_spectrum": read_table(self.flash_spectrum, parse_spectrum),
            **self.pair_values(),
            "neutral": read_table(self.neutral, parse_spectrum),
            "light_directions": _directions(self.light_directions),
            "pinned_lamps": _lamps(self.pin_lamp),
            "forbidden_lamps": _lamps(self.forbid_lamp),
            "response": read_table(self.response, parse_sensitivities),
            "focal_px": self.focal_px,
            "normals": self.normals,
            "outputs": self.outputs
            if self.outputs in ("default", "all")
            else [name.strip() for name in self.outputs.split(",")],
        }
        with in_words():
            return Options.model_validate(self.typed(values))


def _lamps(typed: list[str] | None) -> list[Any] | None:
    """Read lamps that are areas, names or files; None for none."""
    from pipeline.spectra.tables import parse_spectrum

    return [_area(text) or read_table(text, parse_spectrum) for text in typed or ()] or None


def _area(text: str) -> dict[str, float] | None:
    """Read X,Y,RADIUS; None for what is no list of numbers."""
    from pipeline.errors import OptionError

    numbers = read_numbers(text)
    if numbers is None:
        return None
    if len(numbers) != 3:
        raise OptionError(f"The area {text[:80]} is not three numbers X,Y,RADIUS in pixels.")
    return circle(numbers)


def _directions(path: Path | None) -> list[Any] | None:
    from pipeline.errors import OptionError

    if path is None:
        return None
    try:
        found = json.loads(read_file(path, "light directions file"))
        lights = found["lights"]
    except (ValueError, KeyError, TypeError) as error:
        raise OptionError(
            f'The light directions file {path} is not JSON of the form {{"lights": '
            '[{"direction": [x, y, z]}, …]}.'
        ) from error
    if not isinstance(lights, list):
        raise OptionError(f'"lights" in the light directions file {path} must be a list.')
    return lights
