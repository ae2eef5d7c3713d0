"""Calibrations that are kept for a camera and a set-up, as defaults of later separations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from pipeline.errors import OptionError, own_words
from pipeline.images.frames import Frame
from pipeline.options import NO_SETUP, DirectedLight, Options, Sensitivities, Spectrum
from pipeline.photometric_stereo.directions import unit_directions
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.tables import parse_sensitivities, parse_spectrum
from pipeline.taken_with import Kind, TakenWith

_OPTION_OF: dict[Kind, str] = {
    "camera": "camera",
    "flash": "flash_spectrum",
    "lamps": "light_directions",
}
"""The option that a calibration of each kind stands in for."""

DEFAULT_SETUP = "default"
"""The set-up of separations that name none."""

_LEFT_OUT: dict[Kind, tuple[str, str]] = {
    "camera": ("camera", "was"),
    "flash": ("flash", "was"),
    "lamps": ("lamps", "were"),
}
_LEAST_LAMPS = 2
_LAMPS_OF_PAPER = 3  # its normals need three directions


class Kept(BaseModel):
    """A calibration that was kept. name: of its job or file. made: when, ISO 8601.

    content: its file, as the option of a separation reads it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Kind
    setup: str
    name: str
    made: str
    taken_with: TakenWith
    content: str

    def value(self) -> Sensitivities | Spectrum | list[DirectedLight]:
        """What stands in for the option. Raises OptionError, which names what is damaged."""
        data = self.content.encode()
        try:
            if self.kind == "camera":
                return parse_sensitivities(data)
            if self.kind == "flash":
                return parse_spectrum(data)
            return _LampsFile.model_validate_json(data).lights
        except OptionError as error:
            raise OptionError(_refused(repr(self.name), self.setup, f". {error}")) from error
        except ValidationError as error:
            reason = _reason(error)
            raise OptionError(_refused(repr(self.name), self.setup, f": {reason}.")) from error


class _LampsFile(BaseModel):
    """The file of lamps' directions."""

    lights: list[DirectedLight]


def _refused(names: str, setup: str, why: str) -> str:
    return (
        f"What is kept as {names} for the set-up {setup!r} cannot be used{why} Calibrate anew, or "
        f"separate with the set-up {NO_SETUP}."
    )


def _reason(error: ValidationError) -> str:
    return own_words(error.errors()[0]["msg"])


def with_kept(
    options: Options, kept: Sequence[Kept], frame: Frame
) -> tuple[Options, list[dict[str, str]], list[RunWarning]]:
    """Fill in what options leave out by the newest fitting calibration of each kind.

    Gives the options, for the manifest what was used, and warnings. Lamps are left out where there
    is one alone, another number is asked for, more are pinned, or the method paper needs three,
    with a warning where the set-up was named; and with a warning where they fix no normals. Raises
    OptionError for a kept calibration that cannot be read.
    """
    values: dict[str, Any] = {}
    used, warnings, unfit = [], [], []
    here = TakenWith.of(frame)
    for one in sorted(kept, key=lambda one: one.made, reverse=True):
        option = _OPTION_OF[one.kind]
        if option in values or not may_stand_in([one], one.kind, options):
            continue
        if not one.taken_with.fits(here, one.kind):
            continue
        value = one.value()
        if isinstance(value, list):
            why = _unfit(len(value), options)
            if why is not None:
                unfit.append(_left_out(one, why))
                continue
            if not _fix_normals(value):
                warnings.append(_unusable(one))
                continue
        values[option] = value
        used.append({"kind": one.kind, "setup": one.setup, "name": one.name, "made": one.made})
    if _OPTION_OF["lamps"] not in values and _is_named(options.setup):
        warnings += unfit[:1]  # of the newest
    if not values:
        return options, [], warnings
    asked = {name: getattr(options, name) for name in options.model_fields_set}
    try:
        return Options.model_validate({**asked, **values}), used, warnings
    except ValidationError as error:
        names = " and ".join(repr(entry["name"]) for entry in used)
        raise OptionError(_refused(names, options.setup, f": {_reason(error)}.")) from error


def may_stand_in(kept: Sequence[Kept], kind: Kind, options: Options) -> bool:
    """Whether some calibration of a kind stands in for its option if the photographs fit it."""
    if _is_given(options, _OPTION_OF[kind]) or options.setup == NO_SETUP:
        return False
    return any((one.kind, one.setup) == (kind, options.setup) for one in kept)


def _is_given(options: Options, option: str) -> bool:
    """Whether an option was given, so that nothing kept stands in for it."""
    return option in options.model_fields_set and getattr(options, option) is not None


def _is_named(setup: str) -> bool:
    """Whether it was asked for, so that what is kept for it is expected to be used."""
    return setup not in (DEFAULT_SETUP, NO_SETUP)


def _unfit(count: int, options: Options) -> str | None:
    """Why so many kept lamps do not go with what is asked for, and what to do; None if they do."""
    if count < _LEAST_LAMPS:
        return (
            "normals need two lamps at least, and one is kept: calibrate with all lamps, or put "
            "those of several calibrations together into one file of --light-directions."
        )
    if options.method == "paper" and count != _LAMPS_OF_PAPER:
        return (
            f"the method paper needs three lamps, and {count} are kept: ask for the method best, "
            "or calibrate three lamps."
        )
    wanted = options.lights if options.lights != "auto" else count
    if wanted != count or len(options.pinned_lamps) > count:
        wanted = max(wanted, len(options.pinned_lamps))
        return (
            f"{count} lamps are kept, and {wanted} asked for or pinned: ask for as many as are "
            "kept, or calibrate anew."
        )
    return None


def _fix_normals(lights: list[DirectedLight]) -> bool:
    """Whether kept lamps lie so that normals follow."""
    try:
        unit_directions(lights)
    except OptionError:
        return False
    return True


def _unusable(kept: Kept) -> RunWarning:
    message = (
        f"The lamps kept as {kept.name!r} for the set-up {kept.setup!r} are nearly alike, lie "
        "nearly in one plane, or all behind the surface, which fixes no normals, so that they were "
        f"left out: calibrate them anew, or separate with --setup {NO_SETUP}."
    )
    return RunWarning(Code.KEPT_UNUSABLE, message)


def _left_out(kept: Kept, why: str) -> RunWarning:
    message = (
        f"The lamps kept as {kept.name!r} for the set-up {kept.setup!r} were left out, since {why}"
    )
    return RunWarning(Code.KEPT_UNUSABLE, message)


def _does_not_fit(kept: Kept, here: TakenWith) -> RunWarning:
    what, verb = _LEFT_OUT[kept.kind]
    message = (
        f"The {what} kept as {kept.name!r} for the set-up {kept.setup!r} {verb} left out, since "
        f"found with {kept.taken_with.obstacle(here, kept.kind)}: send photographs like those of "
        "the calibration, or calibrate with such as these."
    )
    return RunWarning(Code.KEPT_UNUSABLE, message)


def setup_warnings(options: Options, kept: Sequence[Kept], frame: Frame) -> list[RunWarning]:
    """Warn of a set-up that is named, and of what is kept for it and does not fit the frame.

    Of each kind the newest is told of that is of the frame's camera, where none fits and no option
    stands in for it.
    """
    if not _is_named(options.setup):
        return []
    here = TakenWith.of(frame)
    of_setup = [one for one in kept if one.setup == options.setup]
    fitting = {one.kind for one in of_setup if one.taken_with.fits(here, one.kind)}
    if fitting:
        newest = {
            one.kind: one
            for one in sorted(of_setup, key=lambda one: one.made)
            if one.kind not in fitting
            and not _is_given(options, _OPTION_OF[one.kind])
            and one.taken_with.is_of(here)
        }
        return [_does_not_fit(one, here) for one in newest.values()]
    message = (
        f"Nothing that is kept for the set-up {options.setup!r} fits this camera, the kind of its "
        "files and, of lamps, the way up of pictures, so that none of it is used: check the name, "
        "or calibrate for it with such photographs."
    )
    return [RunWarning(Code.NOTHING_KEPT, message)]
