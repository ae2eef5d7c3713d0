"""A camera of plain tables, and photographs for it to take."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from drivers.camera import (
    Camera,
    CameraInfo,
    CameraObject,
    Event,
    EventKind,
    Setting,
    SettingName,
    SettingValue,
)
from drivers.errors import (
    SettingError,
    TransferError,
)


def tags(flash: int, iso: int = 100, f_number: int | None = 8) -> dict[int, object]:
    told: dict[int, object] = {0x829A: IFDRational(1, 50), 0x8827: iso, 0x9209: flash}
    return told if f_number is None else {**told, 0x829D: IFDRational(f_number)}


def photograph(flash: int, iso: int = 100, f_number: int | None = 8) -> bytes:
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags(flash, iso, f_number))
    file = io.BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=exif)
    return file.getvalue()


NO_FLASH, FLASH = photograph(0x10), photograph(0x09)
MANUAL: dict[SettingName, SettingValue] = {
    SettingName.SHUTTER_S: 0.02,
    SettingName.ISO: 100,
    SettingName.FLASH: "fill",
    SettingName.WHITE_BALANCE: "daylight",
    SettingName.PROGRAM: "manual",
    SettingName.FOCUS: "manual",
    SettingName.DRIVE: "single",
}


@dataclass
class FakeCamera(Camera):
    """A camera of plain tables. Each release adds its entry of shots, {kind: bytes}."""

    shots: list[dict[str, bytes]] = field(
        default_factory=lambda: [{"jpeg": NO_FLASH}, {"jpeg": FLASH}]
    )
    table: dict[SettingName, Setting] = field(
        default_factory=lambda: {
            name: Setting(name, value, (), writable=True) for name, value in MANUAL.items()
        }
    )
    written: list[tuple[str, SettingValue]] = field(default_factory=list)
    waiting: list[Event] = field(default_factory=list)
    card: dict[int, tuple[str, bytes]] = field(default_factory=lambda: {1: ("folder", b"")})
    sizes: dict[int, int] = field(default_factory=dict)
    failures: int = 0  # transfers that break off after their first byte
    stalls: int = 0  # transfers that break off before it

    @property
    def address(self) -> str:
        return "fake://"

    def info(self) -> CameraInfo:
        return CameraInfo("fake://", "Make", "Model", "1", None)

    def settings(self) -> list[Setting]:
        return list(self.table.values())

    def read(self, name: SettingName) -> Setting:
        if name not in self.table:
            raise SettingError(f"no setting {name}")
        return self.table[name]

    def write(self, name: SettingName, value: SettingValue) -> Setting:
        if not self.table[name].writable:
            raise SettingError(f"{name} is locked")
        self.written.append((name, value))
        self.table[name] = replace(self.table[name], value=value)
        return self.table[name]

    def objects(self) -> set[int]:
        return set(self.card)

    def describe(self, handle: int) -> CameraObject:
        kind, data = self.card[handle]
        return CameraObject(handle, kind, self.sizes.get(handle, len(data)), f"{handle}")

    def delete(self, handle: int) -> None:
        del self.card[handle]

    def trigger(self) -> None:
        for kind, data in self.shots.pop(0).items():
            handle = max(self.card) + 1
            self.card[handle] = (kind, data)
        self.waiting.append(Event(EventKind.CAPTURE_COMPLETE))

    def events(self, timeout_s: float) -> list[Event]:
        assert timeout_s >= 0
        told, self.waiting = self.waiting, []
        return told

    def download(
        self, handle: int, offset: int = 0, into: memoryview | None = None
    ) -> Iterator[bytes]:
        if self.stalls:
            self.stalls -= 1
            raise TransferError("stalled")
        data = self.card[handle][1]
        for at in range(offset, len(data), 100):
            if self.failures and at > offset:
                self.failures -= 1
                raise TransferError("broke off")
            part = data[at : at + 100]
            if into is not None and at + len(part) <= len(into):
                into[at : at + len(part)] = part
            yield part

    def close(self) -> None:
        self.waiting = []

    def set(self, name: SettingName, value: SettingValue, *choices: SettingValue) -> None:
        self.table[name] = Setting(name, value, choices, writable=True)
