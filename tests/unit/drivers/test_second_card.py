"""Cameras that write each photograph to two cards, or RAW to one and JPEG to the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import pytest

from drivers.camera import CameraObject, Event, EventKind, SettingName
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import CaptureError
from drivers.shot import SETTLE_S
from tests.unit.drivers.fake_camera import FLASH, NO_FLASH, FakeCamera


@dataclass
class TwoCards(FakeCamera):
    """Names a photograph alike on both cards; its copy comes so long after it."""

    clock: Clock = field(kw_only=True)
    delay_s: float = 0.0
    coming: list[tuple[float, int]] = field(default_factory=list)
    copies: dict[int, int] = field(default_factory=dict)  # of which handle

    def trigger(self) -> None:
        self.coming += [(self.clock.monotonic() + self.delay_s, each) for each in self._shoot()]
        self.waiting.append(Event(EventKind.CAPTURE_COMPLETE))

    def _shoot(self) -> Iterator[int]:
        for kind, data in self.shots.pop(0).items():
            handle = max(self.card) + 1
            self.card[handle] = (kind, data)
            yield handle

    def objects(self) -> set[int]:
        for due, original in list(self.coming):
            if due <= self.clock.monotonic():
                self.coming.remove((due, original))
                handle = max(self.card) + 1
                self.card[handle] = self.card[original]
                self.copies[handle] = original
        return super().objects()

    def describe(self, handle: int) -> CameraObject:
        original = self.copies.get(handle, handle)
        card = "first" if original == handle else "second"
        return replace(super().describe(handle), name=f"DSC_{original}", storage=card)


SHOTS = [{"jpeg": NO_FLASH}, {"jpeg": FLASH}]
BOTH = [{"dng": NO_FLASH, "jpeg": NO_FLASH}, {"dng": FLASH, "jpeg": FLASH}]


@pytest.mark.parametrize("shots", [SHOTS, BOTH])
@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("delay_s", [0.0, SETTLE_S - 0.01, 2 * SETTLE_S - 0.01])
def test_copies_on_a_second_card_are_fetched_once_and_deleted_both(
    clock: Clock, shots: list[dict[str, bytes]], told: bool, delay_s: float
) -> None:
    """Also a copy that comes with the next photograph."""
    camera = TwoCards(shots=list(shots), clock=clock, delay_s=delay_s)
    if told:
        camera.set(SettingName.FORMAT, "+".join(shots[0]).replace("dng", "raw"))
    taken = capture_pair(camera, lambda *_: clock.sleep(0.2), clock=clock)
    assert [taken.no_flash.files, taken.flash.files] == shots
    assert len(camera.copies) == 2 * len(shots[0])
    taken.delete_from(camera)
    assert camera.card == {1: ("folder", b"")}


def test_copies_of_the_best_files_are_deleted_alone(clock: Clock) -> None:
    camera = TwoCards(shots=list(BOTH), clock=clock)
    taken = capture_pair(camera, clock=clock)
    taken.delete_from(camera, best_alone=True)
    assert list(camera.card.values()) == [
        ("folder", b""),
        ("jpeg", NO_FLASH),
        ("jpeg", NO_FLASH),
        ("jpeg", FLASH),
        ("jpeg", FLASH),
    ]


@pytest.mark.parametrize(("shots", "late"), [(SHOTS, 2), ([SHOTS[0], SHOTS[0], *SHOTS], 3)])
def test_a_copy_that_comes_after_the_next_release_is_none_of_its_photographs(
    clock: Clock, shots: list[dict[str, bytes]], late: int
) -> None:
    """Nor is one of the flash frame for which the pair was taken again."""

    class WithTheNext(TwoCards):
        def trigger(self) -> None:
            self.coming = [(0.0, original) for _, original in self.coming]
            self.delay_s = math.inf if len(self.shots) == late else 0.0
            super().trigger()

    camera = WithTheNext(shots=list(shots), clock=clock)
    taken = capture_pair(camera, clock=clock)
    assert [taken.no_flash.files, taken.flash.files] == SHOTS
    assert len(camera.copies) == len(shots)


Change = Callable[[CameraObject], CameraObject]


@pytest.mark.parametrize(
    "change",
    [
        lambda item: replace(item, name=str(item.handle)),
        lambda item: replace(item, size=item.size + item.handle),
        lambda item: replace(item, storage="first"),
        lambda item: replace(item, storage=""),
    ],
)
def test_two_photographs_that_are_not_each_others_copy_are_an_error(
    clock: Clock, change: Change
) -> None:
    class Other(TwoCards):
        def describe(self, handle: int) -> CameraObject:
            return change(super().describe(handle))

    with pytest.raises(CaptureError, match="single frames"):
        capture_pair(Other(clock=clock), clock=clock)


def test_another_photograph_that_comes_late_is_no_copy(clock: Clock) -> None:
    class Bursts(TwoCards):
        def download(
            self, handle: int, offset: int = 0, into: memoryview | None = None
        ) -> Iterator[bytes]:
            if len(self.shots) % 2 == 0:  # the flash frame's
                self.card[max(self.card) + 1] = ("jpeg", FLASH + b"more")
            return super().download(handle, offset, into)

    with pytest.raises(CaptureError, match="long after its photograph was called complete"):
        capture_pair(Bursts(shots=SHOTS * 2, clock=clock), clock=clock)
