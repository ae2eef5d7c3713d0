"""The folder in which the command line keeps calibrations for later separations."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.calibration.kept_calibrations import Kept
    from pipeline.taken_with import Kind, TakenWith


def folder() -> Path:
    """Where calibrations are kept: as the setting says, or the user's own folder."""
    import typer

    from service.settings import Settings

    named = Settings().calibrations_dir
    return named or Path(typer.get_app_dir("lightlayers")) / "calibrations"


def keep(kind: Kind, setup: str, manifest: dict[str, Any], content: bytes, marks: bytes) -> Path:
    """Keep what a calibration found. One of the same camera, set-up and kind is replaced.

    content: the file that was found. marks: the picture of where, which is put beside it.
    Raises pipeline.errors.InputError, and then what was kept before still is.
    """
    from pipeline.calibration.kept_calibrations import Kept
    from pipeline.errors import InputError, reason_of
    from pipeline.taken_with import TakenWith
    from service import durable

    taken_with = TakenWith.model_validate(manifest["taken_with"])
    path = folder() / setup / f"{kind}_{_camera_in_name(kind, taken_with)}.json"
    kept = Kept(
        kind=kind,
        setup=setup,
        name=path.name,
        made=datetime.now(UTC).isoformat(timespec="seconds"),
        taken_with=taken_with,
        content=content.decode(),
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        durable.replace(marks_beside(path), marks)
        durable.replace(path, f"{kept.model_dump_json(indent=1)}\n".encode())
    except OSError as error:
        raise InputError(f"The file {path} cannot be written: {reason_of(error)}.") from error
    return path


def _camera_in_name(kind: Kind, taken_with: TakenWith) -> str:
    """Spell in a file's name all by which a calibration of a kind is told from another camera's."""
    parts = [taken_with.make, taken_with.model, taken_with.body]
    parts += ["rendered"] if taken_with.rendered else []
    if kind != "flash":  # whose spectrum is the same, but approximate when found with renderings
        parts += ["linear"] if taken_with.encoding == "linear" else []
    parts += ["upright"] if kind == "lamps" and taken_with.upright else []
    if kind == "lamps" and taken_with.orientation not in (None, 1):
        parts += [f"turned{taken_with.orientation}"]
    return "_".join("".join(c if c.isalnum() else "-" for c in part) for part in parts if part)


def marks_beside(path: Path) -> Path:
    """Where the picture lies that shows the marks of a calibration's file."""
    return path.with_name(f"{path.stem}_marks.jpg")


def kept_for(setup: str) -> list[Kept]:
    """The calibrations that are kept for a set-up. Raises pipeline.errors.InputError."""
    from pydantic import ValidationError

    from pipeline.calibration.kept_calibrations import Kept
    from pipeline.errors import InputError

    found = []
    for path in sorted((folder() / setup).glob("*.json")):
        try:
            found.append(Kept.model_validate_json(path.read_bytes()))
        except (OSError, ValidationError) as error:
            raise InputError(
                f"The kept calibration {path} cannot be read: calibrate anew, or remove it."
            ) from error
    return found
