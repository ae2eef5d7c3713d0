"""What a camera can do, whichever cable or network it hangs on.

A camera is opened by `drivers.registry.open_camera` and used as a context manager:

    with open_camera("sim://studio") as camera:
        camera.write(SettingName.ISO, 100)
        before = camera.objects()
        camera.trigger()
        camera.events(timeout_s=5)
        for handle in camera.objects() - before:
            photograph = b"".join(camera.download(handle))

One camera serves one caller at a time. Every method may raise CameraDisconnectedError,
CameraTimeoutError, CameraBusyError (after retries) and ProtocolError, next to the errors that it
names itself.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from types import TracebackType
from typing import Self

SettingValue = str | int | float


RAW_KINDS = ("dng", "nef", "nrw", "cr2", "cr3", "arw", "raf", "rw2", "orf", "pef", "srw")
"""Kinds of RAW files, named as their files end."""


class SettingName(StrEnum):
    """The settings that the capture of a pair needs."""

    SHUTTER_S = "shutter_s"  # exposure time in seconds
    F_NUMBER = "f_number"  # relative aperture
    ISO = "iso"  # ISO speed, or "auto"
    FLASH = "flash"  # auto, off, fill, red_eye_auto, red_eye_fill, external
    WHITE_BALANCE = "white_balance"  # manual, auto, one_push, or a kind of light: daylight, …
    PROGRAM = "program"  # manual, auto, aperture, shutter, creative, action, portrait
    FOCUS = "focus"  # manual, auto, macro
    DRIVE = "drive"  # single, burst, timelapse
    FORMAT = "format"  # raw, jpeg_fine, raw+jpeg_fine and the like, or the camera's own word


class EventKind(StrEnum):
    """What a camera tells unasked. Events are hints: they get lost, and they come late."""

    OBJECT_ADDED = "object_added"
    CAPTURE_COMPLETE = "capture_complete"
    STORE_FULL = "store_full"
    SETTING_CHANGED = "setting_changed"
    OTHER = "other"


_LARGEST_CARD_BYTES = 2**60  # cameras that do not know tell numbers of 64 bits, all of them set


@dataclass(frozen=True)
class CameraInfo:
    """Who the camera is. Of what follows, None is for what it does not tell.

    battery_percent: 0…100. free_bytes: room on its cards, in bytes.
    """

    address: str
    make: str
    model: str
    serial: str
    battery_percent: int | None
    free_bytes: int | None = None

    def __post_init__(self) -> None:
        """Leave out what no terminal should be told by a camera, and room that no card has."""
        if self.free_bytes is not None and self.free_bytes > _LARGEST_CARD_BYTES:
            object.__setattr__(self, "free_bytes", None)
        for name in ("make", "model", "serial"):
            words = "".join(filter(str.isprintable, getattr(self, name)))
            object.__setattr__(self, name, words)


@dataclass(frozen=True)
class Setting:
    """A setting's value and what else it could be.

    value: in the unit that SettingName gives. choices: every value the camera offers, empty where
    it does not list them. writable: false where only a dial on the camera changes it.
    """

    name: SettingName
    value: SettingValue
    choices: tuple[SettingValue, ...]
    writable: bool


_LONGEST_S = 1e9  # no camera offers more; a whole number of any size is compared, not converted
_ALIKE = 0.01  # cameras round 1/60 s to 0.0166 or 0.0167; their steps are a quarter apart
_TICK_S, _NEAR = 1e-4, 0.1  # many tell no more digits, and cut 1/640 s to 0.0015


def meant(name: SettingName, value: SettingValue, offered: Iterable[SettingValue]) -> SettingValue:
    """Give the offered exposure time that a value stands for; else the value itself.

    It may be 1 % off, below 10 ms as much as 0.1 ms but no more than a tenth.
    """
    # by value: the names of settings out of JSON are plain text
    if name != SettingName.SHUTTER_S or isinstance(value, str) or not abs(value) < _LONGEST_S:
        return value
    numbers = [each for each in offered if not isinstance(each, str)]
    nearest = min(numbers, key=lambda each: abs(each - value), default=value)
    slack = max(_ALIKE * abs(value), min(_TICK_S, _NEAR * abs(value)))
    return nearest if abs(nearest - value) <= slack else value


@dataclass(frozen=True)
class Event:
    """Something the camera told. handle: the object meant, where there is one."""

    kind: EventKind
    handle: int | None = None


@dataclass(frozen=True)
class CameraObject:
    """A file on the camera's card.

    kind: "jpeg", "folder", "other", or the kind of RAW file: one of RAW_KINDS. size: bytes.
    name: the camera's name for it. storage: the camera's word for the card; empty: it has none.
    """

    handle: int
    kind: str
    size: int
    name: str
    storage: str = ""

    def is_copy_of(self, others: Iterable[CameraObject]) -> bool:
        """Whether one of the others is alike in all but its place, and that on another card."""
        alike = [
            other.storage
            for other in others
            if (other.name, other.kind, other.size) == (self.name, self.kind, self.size)
        ]
        return bool(alike) and self.storage not in alike


def kind_of_name(name: str) -> str:
    """Tell the kind of a file from how its name ends."""
    ending = name.rpartition(".")[2].lower()
    if ending in RAW_KINDS:
        return ending
    return "jpeg" if ending in ("jpg", "jpeg") else "other"


class Camera(ABC):
    """A camera with an open connection."""

    @property
    @abstractmethod
    def address(self) -> str:
        """The address it was opened by."""

    @abstractmethod
    def info(self) -> CameraInfo:
        """Make, model, serial number, battery and room on the cards."""

    @abstractmethod
    def settings(self) -> list[Setting]:
        """Every setting of SettingName that this camera has."""

    @abstractmethod
    def read(self, name: SettingName) -> Setting:
        """Read one setting. Raises SettingError where the camera has none of that name."""

    @abstractmethod
    def write(self, name: SettingName, value: SettingValue) -> Setting:
        """Write one setting, a time as the offered one next to it, and read it back.

        Raises SettingError where it is missing, read-only, refused, or reads back otherwise.
        """

    @abstractmethod
    def objects(self) -> set[int]:
        """List the handles of everything on the card, folders too."""

    @abstractmethod
    def describe(self, handle: int) -> CameraObject:
        """Kind, size and name of an object."""

    @abstractmethod
    def delete(self, handle: int) -> None:
        """Delete an object from the card."""

    def check_release(self) -> None:  # noqa: B027  not every camera tells before it is released
        """Look whether trigger() can work at all. Raises SettingError."""

    @abstractmethod
    def trigger(self) -> None:
        """Press the release; returns at once, the photograph comes later.

        Raises FocusError, StoreFullError where the camera refuses, and CameraBusyError at once.
        """

    @abstractmethod
    def events(self, timeout_s: float) -> list[Event]:
        """Every event waiting; if there is none, the first that comes within timeout_s seconds."""

    @abstractmethod
    def download(
        self, handle: int, offset: int = 0, into: memoryview | None = None
    ) -> Iterator[bytes | bytearray | memoryview]:
        """Chunks of an object's bytes from offset to its end.

        into: room for just the whole object, where each chunk is put in its place. Raises
        TransferError where a chunk comes incomplete: call again with the offset reached.
        """

    @abstractmethod
    def close(self) -> None:
        """Give the camera back. Closing twice is fine."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
