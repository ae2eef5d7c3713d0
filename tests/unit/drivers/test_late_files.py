"""Files that reach the card after their photograph was called complete."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from drivers.camera import Event, EventKind
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import CaptureError, PairVerificationError
from drivers.flash import ExternalFlash, PropertyFlash
from drivers.shot import SETTLE_S
from tests.unit.drivers.test_capture_rules import FLASH, NO_FLASH, FakeCamera


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
