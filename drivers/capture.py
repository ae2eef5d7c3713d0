"""The capture of a pair: one photograph without the flash, one with it, all else equal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from drivers.camera import Camera, CameraObject, SettingName, SettingValue, meant
from drivers.clock import Clock, SystemClock
from drivers.errors import (
    CameraBusyError,
    CaptureError,
    DriverError,
    NoFlashError,
    SettingError,
    TransferError,
)
from drivers.flash import Flash, PropertyFlash, State
from drivers.pair import CapturedPair, verify
from drivers.shot import CaptureProgress, Shot, photographs_since, take_shot

CAPTURE_STAGES = ("prepare", "no_flash", "flash", "verify")
"""The stages of a capture, in order."""

PAIR_ATTEMPTS = 2
"""How often a pair is begun, where its second photograph fails."""

RECHARGE_S = 5.0
"""How long the flash may charge before a pair is taken once more."""

_MANUAL: dict[SettingName, SettingValue] = {
    SettingName.PROGRAM: "manual",
    SettingName.FOCUS: "manual",
    SettingName.DRIVE: "single",
}
_AUTOMATIC: dict[SettingName, tuple[SettingValue, ...]] = {
    SettingName.ISO: ("auto",),
    SettingName.WHITE_BALANCE: ("auto", "one_push"),
}
_WORTH_ANOTHER_PAIR = {CaptureError, NoFlashError, TransferError, CameraBusyError}
"""What may pass by itself; of other errors of the same family that cannot be said."""


def capture_pair(
    camera: Camera,
    progress: CaptureProgress = lambda _stage, _fraction: None,
    clock: Clock | None = None,
    flash: Flash | None = None,
    settings: Mapping[SettingName, SettingValue] | None = None,
) -> CapturedPair:
    """Take a photograph without the flash and one with it.

    Exposure program, focus and drive are put to manual, manual and single; then `settings` are
    written and read back, those of an earlier pair among them. What they do not name stays as it
    is set, but for an automatic ISO or white balance, which is put to a fixed one. All of it stays
    so in the camera, its flash mode too; a flash that has a switch of its own is left off.
    progress(stage, fraction): stage is one of CAPTURE_STAGES; the fractions start anew where a
    pair is taken once more, because its second photograph failed. flash: what switches it, by
    default the camera's own setting.

    Raises SettingError, FlashError, FocusError, StoreFullError, CaptureError, TransferError,
    PairVerificationError, and what every method of Camera may raise.
    """
    clock, flash, wanted = clock or SystemClock(), flash or PropertyFlash(), settings or {}
    check_settings(wanted)
    progress("prepare", 0.0)
    camera.check_release()
    frozen = _fix_everything(camera, wanted)
    flash.check(camera)  # what modes it has can depend on the exposure program
    progress("prepare", 1.0)
    taking = _Taking(camera, flash, clock, progress, frozen)
    try:
        pair = taking.pair()
    finally:
        flash.leave_off()
    progress("verify", 1.0)
    return pair


def _with_late_copies(camera: Camera, before: set[int], pair: CapturedPair) -> CapturedPair:
    """Add copies that a second card got late.

    Raises CaptureError where the card holds more of the pair than was fetched.
    """
    stored = (*pair.no_flash.stored, *pair.flash.stored)
    known = {item.handle for item in stored}
    late, copies, _ = photographs_since(camera, before | known, stored)
    if late:
        raise CaptureError(
            "A file reached the card long after its photograph was called complete: wait until the "
            "camera is idle and take the pair again."
        )
    return replace(pair, flash=replace(pair.flash, stored=(*pair.flash.stored, *copies)))


def check_settings(settings: Mapping[SettingName, SettingValue]) -> None:
    """Refuse settings with which no pair could be taken. Raises SettingError."""
    if SettingName.FLASH in settings:
        raise SettingError("The flash is switched by the capture: leave the setting flash out.")
    for name, value in settings.items():
        if name in _MANUAL and value != _MANUAL[name]:
            raise SettingError(f"A pair is taken with {name} {_MANUAL[name]}: leave {name} out.")
        if value in _AUTOMATIC.get(name, ()):
            raise SettingError(f"A pair is taken with a fixed {name}: {value} is none.")


def _fix_everything(
    camera: Camera, wanted: Mapping[SettingName, SettingValue]
) -> dict[SettingName, SettingValue]:
    """Make every setting manual or as wanted; gives all that must not change from here on."""
    offered = {setting.name for setting in camera.settings()}
    for name, value in _MANUAL.items():
        if name in offered:
            _ensure(camera, name, value)
    write_settings(camera, wanted)
    offered = {setting.name for setting in camera.settings()}  # others come and go with these
    if SettingName.ISO in offered:
        _ensure(camera, SettingName.ISO, _fixed_iso(camera))
    if SettingName.WHITE_BALANCE in offered:
        white_balance = camera.read(SettingName.WHITE_BALANCE).value
        automatic = white_balance in _AUTOMATIC[SettingName.WHITE_BALANCE]
        _ensure(camera, SettingName.WHITE_BALANCE, "daylight" if automatic else white_balance)
    kept = offered - {SettingName.FLASH}
    return {name: camera.read(name).value for name in SettingName if name in kept}


def write_settings(camera: Camera, settings: Mapping[SettingName, SettingValue]) -> None:
    """Write settings, program, focus and drive first: others can be locked until they stand right.

    Raises what Camera.read and Camera.write raise.
    """
    for name in sorted(settings, key=[*_MANUAL, *SettingName].index):
        _ensure(camera, name, settings[name])


def _ensure(camera: Camera, name: SettingName, value: SettingValue) -> None:
    """Write a setting, unless it stands right already: a dial need not be writable then."""
    setting = camera.read(name)
    if setting.writable or setting.value != meant(name, value, (setting.value,)):
        camera.write(name, value)


def _fixed_iso(camera: Camera) -> SettingValue:
    setting = camera.read(SettingName.ISO)
    if setting.value != "auto":
        return setting.value
    speeds = [choice for choice in setting.choices if not isinstance(choice, str)]
    if not speeds:
        raise SettingError("The camera chooses the ISO itself: set a fixed ISO on the camera.")
    return min(speeds)


@dataclass(frozen=True)
class _Taking:
    """The photographs of one pair, taken with the same settings."""

    camera: Camera
    flash: Flash
    clock: Clock
    progress: CaptureProgress
    frozen: dict[SettingName, SettingValue]
    stored: list[CameraObject] = field(default_factory=list)  # of all photographs so far

    def pair(self) -> CapturedPair:
        """Take both photographs, and both once more where the second one fails."""
        for left in reversed(range(PAIR_ATTEMPTS)):
            before = self.camera.objects()
            no_flash = self.shoot("no_flash", "off")
            try:
                pair = CapturedPair(no_flash, self.shoot("flash", "on"), self.frozen)
                self.progress("verify", 0.0)
                pair = _with_late_copies(self.camera, before, pair)
                verify(pair, self.flash.brightness)
                return pair
            except DriverError as error:
                if not left or type(error) not in _WORTH_ANOTHER_PAIR:
                    raise
                self.clock.sleep(RECHARGE_S)
        raise AssertionError

    def shoot(self, stage: str, state: State) -> Shot:
        """Switch the flash and take one photograph."""
        self.flash.switch(self.camera, state, self.clock)
        for name, value in self.frozen.items():
            found = self.camera.read(name).value
            if found != value:
                raise SettingError(
                    f"The camera's {name} went from {value} to {found} in the middle of the pair: "
                    "leave its dials alone and take the pair again."
                )
        progress = partial(self.progress, stage)
        shot = take_shot(self.camera, self.clock, progress, self.stored)
        self.stored.extend(shot.stored)
        return shot
