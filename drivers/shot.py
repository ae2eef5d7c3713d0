"""One photograph: release, wait, find it on the card, fetch it."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

from drivers.camera import RAW_KINDS, Camera, CameraObject, EventKind, SettingName
from drivers.clock import Clock
from drivers.errors import (
    CameraBusyError,
    CaptureError,
    PairVerificationError,
    SettingError,
    StoreFullError,
    TransferError,
)
from drivers.exif import ExposureFacts, read_exposure

PATIENCE_S = 5.0
"""How long after the exposure a photograph may take to reach the card, events or not."""

SETTLE_S = 0.3
"""How long files may still reach the card after events have called the capture complete.

Not waited for where the camera's setting of its format says which files come, and all have come.
"""

DOWNLOAD_ATTEMPTS = 4
"""How often in a row a transfer may break off without a byte gained."""

LARGEST_BYTES = 1 << 29
"""No camera's photograph is larger; a size beyond it is a mistake."""

_BUSY_PAUSES_S = (0.05, 0.1, *[0.2] * 39)  # charging a flash takes long; 8 s
_UNTOLD_S = 30.0  # of an exposure, where the camera does not tell
_LONGEST_S = 3600.0  # what is longer is no time: bulb is told as five days
_LONG_S = 1.0  # from here on cameras may take a dark photograph of equal time, against noise
_NOISE_REDUCTION = " and noise reduction of long exposures"
_PREFERRED = (*RAW_KINDS, "jpeg")

CaptureProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class Shot:
    """One release of the shutter.

    files: bytes by kind, a RAW kind or "jpeg" or both. exposure: as its EXIF says. stored: the
    files on the camera's card, in the order of files, then copies of them on a second one.
    """

    files: dict[str, bytes]
    exposure: ExposureFacts
    stored: tuple[CameraObject, ...] = field(default=(), compare=False)

    @property
    def best(self) -> bytes:
        """The RAW file where there is one, else the JPEG."""
        return self.files[self.best_kind]

    @property
    def best_kind(self) -> str:
        """Which kind of file that is."""
        return next(kind for kind in _PREFERRED if kind in self.files)


def take_shot(
    camera: Camera,
    clock: Clock,
    progress: Callable[[float], None],
    earlier: Sequence[CameraObject],
) -> Shot:
    """Take one photograph with the settings as they are and fetch it.

    progress: told the share of its bytes that came. earlier: photographs of which copies may still
    reach a second card; such a copy is counted to this one. Raises FocusError, StoreFullError,
    CaptureError, TransferError, PairVerificationError where no file of it has EXIF.
    """
    progress(0.0)
    exposure_s = _exposure_s(camera)
    long = exposure_s >= _LONG_S
    patience_s = (2 if long else 1) * exposure_s + PATIENCE_S
    camera.events(timeout_s=0)  # what is still waiting belongs to earlier shots
    promised = _promised(camera)
    look = partial(photographs_since, camera, _release(camera, clock), earlier)
    deadline = clock.monotonic() + patience_s
    photographs, copies, others = _new_photographs(camera, clock, look, promised, deadline)
    if not photographs and others:
        raise CaptureError(
            f"The camera wrote its photograph as a file that cannot be used, {_endings(others)}: "
            "set the camera to RAW or JPEG and try again."
        )
    if not photographs:
        raise CaptureError(
            f"The camera released, but no photograph reached its card in {round(patience_s, 1):g} "
            f"s: check the card, switch the camera's self-timer{_NOISE_REDUCTION if long else ''} "
            "off and try again."
        )
    total = max(1, sum(item.size for item in photographs))  # a camera may say 0 bytes
    files: dict[str, bytes] = {}

    def received(count: int) -> None:
        progress((sum(map(len, files.values())) + count) / total)

    for item in photographs:
        files[item.kind] = fetch(camera, item, received)
    return Shot(files, _exposure_of(files), (*photographs, *copies))


def _exposure_of(files: dict[str, bytes]) -> ExposureFacts:
    """Read the exposure of the best file that tells it; all that do must be of one photograph.

    Raises PairVerificationError where none tells, CaptureError.
    """
    kinds = [kind for kind in _PREFERRED if kind in files]
    told: list[ExposureFacts] = []
    for kind in kinds:
        try:
            told.append(read_exposure(files[kind]))
        except PairVerificationError:
            if kind == kinds[-1] and not told:
                raise
    best, *others = told
    if any(other.flash_fired != best.flash_fired for other in others):
        raise CaptureError(
            "Files of two photographs came as one: wait until the camera is idle and take the "
            "pair again."
        )
    openings = (one.f_number for one in told if one.f_number is not None)
    return replace(best, f_number=next(openings, None))


def _release(camera: Camera, clock: Clock) -> set[int]:
    """Press the release; gives the handles that the card held just before.

    A camera that is busy may still be writing an earlier photograph, so that they are listed anew.
    """
    for pause in _BUSY_PAUSES_S:
        before = camera.objects()
        try:
            camera.trigger()
            return before
        except CameraBusyError:
            clock.sleep(pause)
            camera.events(timeout_s=0)
    before = camera.objects()
    camera.trigger()
    return before


def _exposure_s(camera: Camera) -> float:
    """How long the exposure can take; some cameras tell no time, or one in words."""
    try:
        told_s = float(camera.read(SettingName.SHUTTER_S).value)
    except (SettingError, ValueError):
        return _UNTOLD_S
    return told_s if 0 <= told_s <= _LONGEST_S else _UNTOLD_S


def _promised(camera: Camera) -> set[str]:
    """Tell what files a photograph gives by the camera's setting, "raw", "jpeg"; none: unknown."""
    try:
        parts = str(camera.read(SettingName.FORMAT).value).split("+")
    except SettingError:
        return set()
    families = {part.partition("_")[0] for part in parts}
    return families if families <= {"raw", "jpeg"} else set()


class Found(NamedTuple):
    """Files on the cards. copies: of photographs on another card. others: of kinds not read."""

    photographs: list[CameraObject]
    copies: list[CameraObject]
    others: list[CameraObject]


def photographs_since(camera: Camera, before: set[int], earlier: Sequence[CameraObject]) -> Found:
    """Describe the files on the cards but those that they held before.

    A camera with two cards may write each photograph to both. earlier: photographs whose copies
    are told from new ones.
    """
    found = Found([], [], [])
    for item in [camera.describe(handle) for handle in sorted(camera.objects() - before)]:
        if item.kind in _PREFERRED:
            is_copy = item.is_copy_of((*earlier, *found.photographs, *found.copies))
            (found.copies if is_copy else found.photographs).append(item)
        elif item.kind != "folder":
            found.others.append(item)
    return found


def _new_photographs(
    camera: Camera, clock: Clock, look: Callable[[], Found], promised: set[str], deadline: float
) -> Found:
    """Find the photographs that the card did not hold before; events only say when to look.

    Gives none where none came by the deadline.
    """
    found = Found([], [], [])
    told: EventKind | None = EventKind.CAPTURE_COMPLETE
    # a late event of an earlier shot must not end the wait
    while told is EventKind.CAPTURE_COMPLETE and not found.photographs:
        told = _await_end(camera, clock, deadline)
        if told is EventKind.STORE_FULL:
            deadline = clock.monotonic()  # what is not there now does not fit
        found = _settled(clock, look, promised, deadline)
    photographs = found.photographs
    # the last photograph that fits may fill the card
    if told is EventKind.STORE_FULL and (not photographs or promised - _families(photographs)):
        raise StoreFullError("The camera's memory card is full: make room on it and try again.")
    if len({item.kind for item in photographs}) < len(photographs):
        raise CaptureError(
            "More than one photograph reached the card: set the camera to single frames and try "
            "again."
        )
    return found


def _settled(clock: Clock, look: Callable[[], Found], promised: set[str], deadline: float) -> Found:
    """List the new photographs once all that were promised are there, or nothing more comes."""
    found = look()
    settling = clock.monotonic() + SETTLE_S
    while not promised or _families(found.photographs) != promised:
        patient = promised and found.photographs
        if clock.monotonic() >= (max(deadline, settling) if patient else settling):
            break
        clock.sleep(SETTLE_S)
        found = look()
    return found


def _families(photographs: list[CameraObject]) -> set[str]:
    return {"raw" if item.kind in RAW_KINDS else item.kind for item in photographs}


def _endings(files: list[CameraObject]) -> str:
    """Tell how names end, a few, as far as a terminal should be told by a camera."""
    endings = sorted({item.name.rpartition(".")[2] for item in files})
    return ", ".join(f".{''.join(filter(str.isprintable, each))[:8]}" for each in endings[:3])


def _await_end(camera: Camera, clock: Clock, deadline: float) -> EventKind | None:
    """Wait until the camera says that its card is full, or the capture complete; gives which.

    None where it says neither by the deadline.
    """
    while (left := deadline - clock.monotonic()) > 0:
        told = {event.kind for event in camera.events(timeout_s=left)}
        for kind in (EventKind.STORE_FULL, EventKind.CAPTURE_COMPLETE):
            if kind in told:
                return kind
    return None


def fetch(
    camera: Camera, item: CameraObject, progress: Callable[[int], None] = lambda _received: None
) -> bytes:
    """Download one file, going on from where a transfer broke off.

    progress: told the bytes that came. Raises TransferError.
    """
    if item.size > LARGEST_BYTES:
        raise TransferError(
            f"The camera says that a photograph has {item.size} bytes, which is more than one can "
            "have: take the pair again."
        )
    file = io.BytesIO(bytes(item.size))  # filled in place, so that nothing is copied again
    received = failures = 0

    def go_on(whole: memoryview) -> None:
        nonlocal received, failures
        for chunk in camera.download(item.handle, received, whole):
            received += len(chunk)
            failures = 0
            progress(received)

    with file.getbuffer() as whole:
        while True:
            try:
                go_on(whole)
                break
            except TransferError:
                failures += 1
                if failures == DOWNLOAD_ATTEMPTS:
                    raise
    if received != item.size:
        raise TransferError(
            f"The camera sent {received} of {item.size} bytes of a photograph: take the pair again."
        )
    return file.getvalue()
