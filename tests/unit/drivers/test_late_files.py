"""Files that reach the card after their photograph was called complete."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from drivers.camera import Event, EventKind, SettingName
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import CaptureError, PairVerificationError, SettingError
from drivers.flash import ExternalFlash, PropertyFlash
from drivers.shot import PATIENCE_S, SETTLE_S
from tests.unit.drivers.fake_camera import FLASH, MANUAL, NO_FLASH, FakeCamera


@dataclass
class Delaying(FakeCamera):
    """Names all that it adds, and says complete, but puts its JPEGs onto the card later."""

    clock: Clock = field(kw_only=True)
    delay_s: float = field(kw_only=True)
    coming: list[tuple[float, bytes]] = field(default_factory=list)

    def trigger(self) -> None:
        shot = self.shots.pop(0)
        self.coming.append((self.clock.monotonic() + self.delay_s, shot["jpeg"]))
        self._add("dng", shot["dng"])
        self.waiting.append(Event(EventKind.CAPTURE_COMPLETE))

    def objects(self) -> set[int]:
        due = [each for each in self.coming if each[0] <= self.clock.monotonic()]
        self.coming = [each for each in self.coming if each not in due]
        for _, data in due:
            self._add("jpeg", data)
        return super().objects()

    def _add(self, kind: str, data: bytes) -> None:
        handle = max(self.card) + 1
        self.card[handle] = (kind, data)
        self.waiting.append(Event(EventKind.OBJECT_ADDED, handle))


RAW_AND_JPEG = [{"dng": NO_FLASH, "jpeg": NO_FLASH}, {"dng": FLASH, "jpeg": FLASH}]


def test_the_card_settles_after_each_photograph(clock: Clock) -> None:
    capture_pair(FakeCamera(), clock=clock)
    assert clock.monotonic() == pytest.approx(2 * SETTLE_S)


@pytest.mark.parametrize("delay_s", [0, 0.01, 0.29])
def test_a_second_file_may_come_while_the_card_settles(clock: Clock, delay_s: float) -> None:
    camera = Delaying(shots=list(RAW_AND_JPEG), clock=clock, delay_s=delay_s)
    pair = capture_pair(camera, clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == RAW_AND_JPEG
    assert camera.shots == []


@pytest.mark.parametrize("delay_s", [0.31, 0.45, 0.59])
@pytest.mark.parametrize("told", [True, False])
def test_a_second_file_that_comes_with_the_next_photograph_makes_no_pair(
    clock: Clock, delay_s: float, told: bool
) -> None:
    shots = RAW_AND_JPEG if told else [RAW_AND_JPEG[0]] * 2  # as of a flash unknown to the camera
    camera = Delaying(shots=shots * 2, clock=clock, delay_s=delay_s)
    brightness = itertools.cycle((1.0, 2.0)).__next__
    flash = PropertyFlash() if told else ExternalFlash("true {state}", lambda _: brightness(), 0)
    with pytest.raises((CaptureError, PairVerificationError)):
        capture_pair(camera, clock=clock, flash=flash)


def test_a_file_that_comes_while_the_last_is_fetched_makes_the_pair_be_taken_again(
    clock: Clock,
) -> None:
    class Slow(Delaying):
        def download(
            self, handle: int, offset: int = 0, into: memoryview | None = None
        ) -> Iterator[bytes]:
            clock.sleep(0.1)
            return super().download(handle, offset, into)

    camera = Slow(shots=RAW_AND_JPEG * 2, clock=clock, delay_s=0.75)  # first listed at 0.8
    with pytest.raises(CaptureError, match="long after its photograph was called complete"):
        capture_pair(camera, clock=clock)
    assert camera.shots == []


def test_a_second_file_that_never_comes_in_time_leaves_the_raw_files(clock: Clock) -> None:
    pair = capture_pair(Delaying(shots=list(RAW_AND_JPEG), clock=clock, delay_s=6), clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == [{"dng": NO_FLASH}, {"dng": FLASH}]


def _of_format(camera: FakeCamera, value: str) -> FakeCamera:
    camera.set(SettingName.FORMAT, value)
    return camera


@pytest.mark.parametrize(
    ("value", "shots"),
    [
        ("raw", [{"dng": NO_FLASH}, {"dng": FLASH}]),
        ("raw", [{"nef": NO_FLASH}, {"nef": FLASH}]),
        ("jpeg_fine", [{"jpeg": NO_FLASH}, {"jpeg": FLASH}]),
        ("raw+jpeg_fine", RAW_AND_JPEG),
        ("raw+jpeg", RAW_AND_JPEG),
    ],
)
def test_files_as_the_format_says_are_all_that_is_waited_for(
    clock: Clock, value: str, shots: list[dict[str, bytes]]
) -> None:
    pair = capture_pair(_of_format(FakeCamera(shots=list(shots)), value), clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == shots
    assert clock.monotonic() == 0
    assert pair.settings[SettingName.FORMAT] == value


@pytest.mark.parametrize("value", ["jpeg_fine", "raw+jpeg_fine", "0x0006", "Large Fine JPEG"])
def test_files_other_than_the_format_says_settle(clock: Clock, value: str) -> None:
    shots = [{"dng": NO_FLASH}, {"dng": FLASH}]
    pair = capture_pair(_of_format(FakeCamera(shots=list(shots)), value), clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == shots
    assert clock.monotonic() >= 2 * SETTLE_S


@pytest.mark.parametrize("delay_s", [0.01, 0.31, 0.45, 2.0, 4.9])
def test_a_second_file_that_the_format_promises_is_waited_for(clock: Clock, delay_s: float) -> None:
    camera = Delaying(shots=list(RAW_AND_JPEG), clock=clock, delay_s=delay_s)
    pair = capture_pair(_of_format(camera, "raw+jpeg_fine"), clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == RAW_AND_JPEG
    assert 2 * delay_s <= clock.monotonic() < 2 * (delay_s + SETTLE_S)


def test_a_promised_file_that_never_comes_leaves_the_raw_files_after_the_patience(
    clock: Clock,
) -> None:
    camera = Delaying(shots=list(RAW_AND_JPEG), clock=clock, delay_s=60)
    pair = capture_pair(_of_format(camera, "raw+jpeg_fine"), clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == [{"dng": NO_FLASH}, {"dng": FLASH}]
    assert clock.monotonic() == pytest.approx(
        2 * (PATIENCE_S + float(MANUAL[SettingName.SHUTTER_S])), abs=2 * SETTLE_S
    )


def test_a_format_turned_between_the_photographs_is_told(clock: Clock) -> None:
    class Turned(FakeCamera):
        def trigger(self) -> None:
            super().trigger()
            self.set(SettingName.FORMAT, "raw")

    camera = _of_format(Turned(), "jpeg_fine")
    with pytest.raises(SettingError, match="format went from jpeg_fine to raw"):
        capture_pair(camera, clock=clock)
