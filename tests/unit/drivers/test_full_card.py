"""Cameras whose card is full, or was filled by the photograph just taken."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from drivers.camera import Event, EventKind, SettingName
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import StoreFullError
from drivers.shot import SETTLE_S
from tests.unit.drivers.fake_camera import FLASH, NO_FLASH, FakeCamera

FULL, COMPLETE = Event(EventKind.STORE_FULL), Event(EventKind.CAPTURE_COMPLETE)
SHOTS = [{"dng": NO_FLASH}, {"dng": FLASH}]


@dataclass
class Filled(FakeCamera):
    """Tells these events after each release."""

    told: tuple[Event, ...] = field(kw_only=True)

    def trigger(self) -> None:
        super().trigger()
        self.waiting = list(self.told)


@pytest.mark.parametrize("told", [(FULL, COMPLETE), (COMPLETE, FULL), (FULL,)])
@pytest.mark.parametrize("word", ["raw", "0x0003"])
def test_a_photograph_that_fills_the_card_is_a_photograph(
    clock: Clock, told: tuple[Event, ...], word: str
) -> None:
    camera = Filled(shots=list(SHOTS), told=told)
    camera.set(SettingName.FORMAT, word)
    taken = capture_pair(camera, clock=clock)
    assert [taken.no_flash.files, taken.flash.files] == SHOTS


@pytest.mark.parametrize("told", [(FULL, COMPLETE), (COMPLETE, FULL), (FULL,)])
@pytest.mark.parametrize(("word", "shot"), [("raw", {}), ("raw+jpeg", {"dng": NO_FLASH})])
def test_what_does_not_fit_any_more_is_waited_for_no_longer_than_the_card_settles(
    clock: Clock, told: tuple[Event, ...], word: str, shot: dict[str, bytes]
) -> None:
    camera = Filled(shots=[shot], told=told)
    camera.set(SettingName.FORMAT, word)
    with pytest.raises(StoreFullError, match="memory card is full: make room on it"):
        capture_pair(camera, clock=clock)
    assert clock.monotonic() == pytest.approx(SETTLE_S)
