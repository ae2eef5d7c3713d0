"""The capture of a pair: one photograph without the flash, one with it, all else equal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from drivers.camera import Camera, CameraObject, EventKind, SettingName, SettingValue
from drivers.clock import Clock, SystemClock
from drivers.errors import (
    CaptureError,
    PairVerificationError,
    SettingError,
    StoreFullError,
    TransferError,
)
from drivers.exif import ExposureFacts, read_exposure

CAPTURE_STAGES = ("prepare", "no_flash", "flash", "verify")
"""The stages of a capture, in order."""

PATIENCE_S = 5.0
"""How long after the exposure a photograph may take to reach the card, events or not."""

SETTLE_S = 0.3
"""Events come before the card's list is complete; so long it takes to settle."""

DOWNLOAD_ATTEMPTS = 4
"""How often in a row a transfer may break off without a byte gained."""

LARGEST_BYTES = 1 << 29
"""No camera's photograph is larger; a size beyond it is a mistake."""

_PREFERRED = ("dng", "jpeg")

CaptureProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class Shot:
    """One release of the shutter.

    files: bytes by kind, "dng" or "jpeg" or both. exposure: as its EXIF says.
    """

    files: dict[str, bytes]
    exposure: ExposureFacts

    @property
    def best(self) -> bytes:
        """The RAW file where there is one, else the JPEG."""
        return next(self.files[kind] for kind in _PREFERRED if kind in self.files)


@dataclass(frozen=True)
class CapturedPair:
    """The two photographs."""

    no_flash: Shot
    flash: Shot


def capture_pair(
    camera: Camera,
    progress: CaptureProgress = lambda _stage, _fraction: None,
    clock: Clock | None = None,
) -> CapturedPair:
    """Take a photograph without the flash and one with it.

    Shutter time, f-number and ISO stay as they are set; exposure program, focus and drive are
    put to manual, manual and single, an automatic ISO or white balance to a fixed one. The
    camera keeps its own copies. progress(stage, fraction): stage is one of CAPTURE_STAGES.

    Raises SettingError, FocusError, StoreFullError, CaptureError, TransferError,
    PairVerificationError, and what every method of Camera may raise.
    """
    clock = clock or SystemClock()
    progress("prepare", 0.0)
    _fix_everything(camera)
    progress("prepare", 1.0)
    shots = []
    for stage, flash in (("no_flash", "off"), ("flash", _firing_mode(camera))):
        camera.write(SettingName.FLASH, flash)
        shots.append(_shoot(camera, clock, partial(progress, stage)))
    progress("verify", 0.0)
    pair = CapturedPair(*shots)
    _verify(pair)
    progress("verify", 1.0)
    return pair


def _fix_everything(camera: Camera) -> None:
    _ensure(camera, SettingName.PROGRAM, "manual")
    _ensure(camera, SettingName.FOCUS, "manual")
    _ensure(camera, SettingName.DRIVE, "single")
    _ensure(camera, SettingName.ISO, _fixed_iso(camera))
    white_balance = camera.read(SettingName.WHITE_BALANCE).value
    _ensure(
        camera,
        SettingName.WHITE_BALANCE,
        "daylight" if white_balance in ("auto", "one_push") else white_balance,
    )


def _ensure(camera: Camera, name: SettingName, value: SettingValue) -> None:
    """Write a setting, unless it stands right already: a dial need not be writable then."""
    setting = camera.read(name)
    if setting.writable or setting.value != value:
        camera.write(name, value)


def _fixed_iso(camera: Camera) -> SettingValue:
    setting = camera.read(SettingName.ISO)
    if setting.value != "auto":
        return setting.value
    speeds = [choice for choice in setting.choices if not isinstance(choice, str)]
    if not speeds:
        raise SettingError("The camera chooses the ISO itself: set a fixed ISO on the camera.")
    return min(speeds)


def _firing_mode(camera: Camera) -> SettingValue:
    setting = camera.read(SettingName.FLASH)
    for mode in ("fill", "external"):
        if mode in setting.choices or not setting.choices:
            return mode
    raise SettingError(
        "The camera offers no flash mode that always fires: put up or attach its flash, or take "
        "the two photographs by hand."
    )


def _shoot(camera: Camera, clock: Clock, progress: Callable[[float], None]) -> Shot:
    progress(0.0)
    patience_s = float(camera.read(SettingName.SHUTTER_S).value) + PATIENCE_S
    camera.events(timeout_s=0)  # what is still waiting belongs to earlier shots
    before = camera.objects()
    camera.trigger()
    photographs = _new_photographs(camera, clock, before, clock.monotonic() + patience_s)
    total = sum(item.size for item in photographs)
    files: dict[str, bytes] = {}

    def received(count: int) -> None:
        progress((sum(map(len, files.values())) + count) / total)

    for item in photographs:
        files[item.kind] = _fetch(camera, item, received)
    best = next(files[kind] for kind in _PREFERRED if kind in files)
    return Shot(files, read_exposure(best))


def _new_photographs(
    camera: Camera, clock: Clock, before: set[int], deadline: float
) -> list[CameraObject]:
    """Find the photographs that the card did not hold before; events only say when to look."""
    complete, photographs = True, list[CameraObject]()
    while complete and not photographs:  # a late event of an earlier shot must not end the wait
        complete = _await_completion(camera, clock, deadline)
        clock.sleep(SETTLE_S)
        new = [camera.describe(handle) for handle in sorted(camera.objects() - before)]
        photographs = [item for item in new if item.kind in _PREFERRED]
    if not photographs:
        raise CaptureError(
            "The camera released, but no photograph reached its card: check the card and try again."
        )
    if len({item.kind for item in photographs}) < len(photographs):
        raise CaptureError(
            "More than one photograph reached the card: set the camera to single frames and try "
            "again."
        )
    return photographs


def _await_completion(camera: Camera, clock: Clock, deadline: float) -> bool:
    """Wait; true once the camera says that the capture is complete, false at the deadline."""
    while (left := deadline - clock.monotonic()) > 0:
        for event in camera.events(timeout_s=left):
            if event.kind is EventKind.STORE_FULL:
                raise StoreFullError(
                    "The camera's memory card is full: make room on it and try again."
                )
            if event.kind is EventKind.CAPTURE_COMPLETE:
                return True
    return False


def _fetch(camera: Camera, item: CameraObject, progress: Callable[[int], None]) -> bytes:
    """Download one file, going on from where a transfer broke off."""
    if item.size > LARGEST_BYTES:
        raise TransferError(
            f"The camera says that a photograph has {item.size} bytes, which is more than one can "
            "have: take the pair again."
        )
    received, failures, whole = bytearray(), 0, False
    while not whole:
        try:
            for chunk in camera.download(item.handle, len(received)):
                received += chunk
                failures = 0
                progress(len(received))
            whole = True
        except TransferError:
            failures += 1
            if failures == DOWNLOAD_ATTEMPTS:
                raise
    if len(received) != item.size:
        raise TransferError(
            f"The camera sent {len(received)} of {item.size} bytes of a photograph: take the "
            "pair again."
        )
    return bytes(received)


def _verify(pair: CapturedPair) -> None:
    if pair.no_flash.files.keys() != pair.flash.files.keys():
        raise PairVerificationError(
            "The two photographs came as files of different kinds: take the pair again."
        )
    without, with_flash = pair.no_flash.exposure, pair.flash.exposure
    if without.flash_fired:
        raise PairVerificationError(
            "The flash fired in the photograph that was to be without it: switch it to manual and "
            "take the pair again."
        )
    if not with_flash.flash_fired:
        raise PairVerificationError(
            "The flash did not fire: put it up, let it charge and take the pair again."
        )
    for name, first, second in (
        ("exposure time", without.time_s, with_flash.time_s),
        ("f-number", without.f_number, with_flash.f_number),
        ("ISO", without.iso, with_flash.iso),
    ):
        if first != second:
            raise PairVerificationError(
                f"The two photographs differ in {name} ({first} and {second}): set the camera to "
                "manual exposure and take the pair again."
            )
