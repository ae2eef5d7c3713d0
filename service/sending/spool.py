"""Pairs on their way to a service, in a folder that outlasts crashes and power cuts.

waiting/NUMBER-SHOT/   a pair: its two photographs, pair.json, and uploads.json once it is under way
aside/NUMBER-SHOT/     one that the service will never take, with reason.txt if there was room
lock                   held by the one agent that uses the folder

A pair is made under a name of its own and renamed once all of it is on the disk, so that what is
in `waiting` is whole. It goes when the service has said that it has the same bytes.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import shutil
import tempfile
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from pipeline.errors import InputError, reason_of
from service import durable
from service.frames import FRAMES

_PARTIAL = ".partial-"
_ABOUT, _UPLOADS, _REASON = "pair.json", "uploads.json", "reason.txt"


class Photograph(BaseModel):
    """A file of a pair. sha256: hexadecimal."""

    name: str
    sha256: str


class About(BaseModel):
    """What is kept beside the photographs. id: the Idempotency-Key of the pair's request."""

    id: str
    shot: str
    options: dict[str, Any]
    photographs: dict[str, Photograph]


class DamagedPairError(Exception):
    """A pair could not be read and was put aside. The message says which, and where it is."""


@dataclass(frozen=True)
class SpooledPair:
    """A pair in its folder.

    doubt: why a power cut may take it, in a few words; None where it would outlast one.
    """

    folder: Path
    about: About
    doubt: str | None = field(default=None, compare=False)

    @property
    def shot(self) -> str:
        """What the pair is called."""
        return self.about.shot

    def path(self, frame: str) -> Path:
        """Where one of the FRAMES is."""
        return self.folder / self.about.photographs[frame].name

    def damage(self) -> str | None:
        """Tell what has become of the photographs on this disk; None if they are as they were."""
        for frame in FRAMES:
            with self.path(frame).open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != self.sha256[frame]:
                    return f"its photograph {frame} was damaged on this disk"
        return None

    @property
    def sha256(self) -> dict[str, str]:
        """Hexadecimal digests by frame."""
        return {frame: self.about.photographs[frame].sha256 for frame in FRAMES}


class Spool:
    """The folder, an absolute path. One agent at a time uses it.

    Its methods raise OSError where the disk fails.
    """

    def __init__(self, folder: Path) -> None:
        """Open the folder, or make it. Raises InputError where that cannot be."""
        self.folder = folder = folder.absolute()
        self._unwritten: dict[Path, dict[str, str]] = {}  # uploads, by the pair's folder
        self._waiting, self._aside = folder / "waiting", folder / "aside"
        try:
            for each in (self._waiting, self._aside):
                each.mkdir(mode=0o700, parents=True, exist_ok=True)
            durable.flush(folder)
            self._lock = (folder / "lock").open("w")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in [*self._waiting.glob(f"{_PARTIAL}*"), *self._aside.glob(f"{_PARTIAL}*")]:
                shutil.rmtree(left)  # of a process that was killed
        except BlockingIOError as error:
            self._lock.close()
            raise InputError(
                f"The spool {folder} is in use by another agent: end that one, or give another "
                "--spool."
            ) from error
        except OSError as error:
            raise InputError(f"The spool {folder} cannot be used: {reason_of(error)}.") from error

    def close(self) -> None:
        """Let others use the folder."""
        self._lock.close()

    def add(
        self, shot: str, photographs: Mapping[str, tuple[str, bytes]], options: dict[str, Any]
    ) -> SpooledPair:
        """Put a pair in; it is on the disk when this is done, unless its `doubt` says otherwise.

        photographs: by frame, the ending of its name and its bytes. Raises OSError where the pair
        is not in the spool.
        """
        partial = Path(tempfile.mkdtemp(prefix=_PARTIAL, dir=self._waiting))
        try:
            files: dict[str, Photograph] = {}
            for frame in FRAMES:
                ending, data = photographs[frame]
                name = f"{frame}.{ending}"
                durable.write(partial / name, data)
                files[frame] = Photograph(name=name, sha256=hashlib.sha256(data).hexdigest())
            about = About(id=uuid.uuid4().hex, shot=shot, options=options, photographs=files)
            durable.write(partial / _ABOUT, about.model_dump_json(indent=2).encode())
            durable.flush(partial)
            folder = self._waiting / f"{self._next_number():06d}-{shot}"
            partial.rename(folder)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            raise
        try:
            durable.flush(self._waiting)
        except OSError as error:  # it waits all the same, and may be on its way already
            return SpooledPair(folder, about, reason_of(error))
        return SpooledPair(folder, about)

    def first(self) -> SpooledPair | None:
        """Give the pair that has waited longest.

        Raises DamagedPairError where it cannot be read; the next call gives the one after it.
        """
        folder = next(iter(self._folders()), None)
        if folder is None:
            return None
        try:
            pair = SpooledPair(folder, About.model_validate_json((folder / _ABOUT).read_bytes()))
            if all(pair.path(frame).is_file() for frame in FRAMES):
                return pair
        except (FileNotFoundError, ValidationError, KeyError):
            pass
        reason = "its folder was changed or damaged"
        raise DamagedPairError(
            f"A pair could not be read, {reason}: it is in {self._put_aside(folder, reason)}."
        )

    def count(self) -> int:
        """Count the pairs that wait."""
        return len(self._folders())

    def uploads(self, pair: SpooledPair) -> dict[str, str]:
        """Ids of the uploads that were begun for the pair, by frame."""
        if pair.folder in self._unwritten:
            return dict(self._unwritten[pair.folder])
        try:
            found = json.loads((pair.folder / _UPLOADS).read_bytes())
        except (FileNotFoundError, ValueError):
            return {}
        if not isinstance(found, dict):
            return {}
        return {str(frame): str(each) for frame, each in found.items() if frame in FRAMES}

    def note_uploads(self, pair: SpooledPair, uploads: Mapping[str, str]) -> None:
        """Keep the ids of uploads for after a crash, or on a full disk until then."""
        self._unwritten[pair.folder] = dict(uploads)
        with _unless_full():
            durable.replace(pair.folder / _UPLOADS, json.dumps(uploads).encode())
            del self._unwritten[pair.folder]

    def remove(self, pair: SpooledPair) -> None:
        """Take out a pair that the service has."""
        gone = self._waiting / f"{_PARTIAL}{pair.folder.name}"
        pair.folder.rename(gone)
        self._unwritten.pop(pair.folder, None)
        with contextlib.suppress(OSError):  # it waits no more, and the next start clears it
            durable.flush(self._waiting)
            shutil.rmtree(gone)

    def put_aside(self, pair: SpooledPair, reason: str) -> Path:
        """Keep a pair that the service will never take out of the way of the others; where."""
        return self._put_aside(pair.folder, reason)

    def _put_aside(self, folder: Path, reason: str) -> Path:
        with _unless_full():
            durable.replace(folder / _REASON, f"{reason}\n".encode())
        target = self._aside / folder.name
        if target.exists():  # somebody has moved a pair back by hand, and copied it
            target = self._aside / f"{folder.name}-{uuid.uuid4().hex[:8]}"
        folder.rename(target)
        self._unwritten.pop(folder, None)
        durable.flush(self._aside)
        durable.flush(self._waiting)
        return target

    def _folders(self) -> list[Path]:
        found = (each for each in self._waiting.iterdir() if not each.name.startswith("."))
        return sorted(each for each in found if each.is_dir())

    def _next_number(self) -> int:
        numbers = [each.name.partition("-")[0] for each in self._folders()]
        return 1 + max((int(number) for number in numbers if number.isdecimal()), default=0)


@contextlib.contextmanager
def _unless_full() -> Iterator[None]:
    """Do without what a full disk does not take: pairs that leave it are what makes room."""
    try:
        yield
    except OSError as error:
        if error.errno not in durable.FULL:
            raise
