"""Photographs that take long: their exposure, and a dark one of equal time against noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from drivers.camera import Event, EventKind, SettingName, SettingValue
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import CaptureError
from drivers.shot import SETTLE_S
from tests.unit.drivers.fake_camera import FLASH, NO_FLASH, FakeCamera

BULB_S = 0xFFFFFFFF / 10_000  # as PTP tells it


@dataclass
class Exposing(FakeCamera):
    """Puts a photograph onto its card so long after the release."""

    clock: Clock = field(kw_only=True)
    takes_s: float = field(kw_only=True)
    due: float | None = None

    def trigger(self) -> None:
        self.due = self.clock.monotonic() + self.takes_s

    def events(self, timeout_s: float) -> list[Event]:
        if self.due is None or self.due > self.clock.monotonic() + timeout_s:
            self.clock.sleep(timeout_s)
            return []
        self.clock.sleep(self.due - self.clock.monotonic())
        self.due = None
        super().trigger()
        return [Event(EventKind.CAPTURE_COMPLETE)]


def _camera(clock: Clock, exposure: SettingValue | None, takes_s: float) -> Exposing:
    camera = Exposing(clock=clock, takes_s=takes_s)
    del camera.table[SettingName.SHUTTER_S]
    if exposure is not None:
        camera.set(SettingName.SHUTTER_S, exposure)
    return camera


@pytest.mark.parametrize(
    ("exposure", "takes_s"),
    [
        (0.5, 5.4),
        (1, 6.9),
        (30, 64.9),
        (60, 124.9),
        (900, 1804.9),
        ("bulb", 64.9),
        ("nan", 64.9),
        (BULB_S, 64.9),
        (None, 64.9),
    ],
)
def test_a_photograph_is_waited_for_as_long_as_it_can_take(
    clock: Clock, exposure: SettingValue | None, takes_s: float
) -> None:
    pair = capture_pair(_camera(clock, exposure, takes_s), clock=clock)
    assert (pair.no_flash.best, pair.flash.best) == (NO_FLASH, FLASH)


@pytest.mark.parametrize(
    ("exposure", "patience_s", "advice"),
    [
        (0.5, 5.5, "check the card, switch the camera's self-timer off and try again."),
        (
            60,
            125,
            "check the card, switch the camera's self-timer and noise reduction of long exposures "
            "off and try again.",
        ),
    ],
)
def test_a_photograph_that_takes_longer_is_missed(
    clock: Clock, exposure: float, patience_s: float, advice: str
) -> None:
    with pytest.raises(CaptureError) as raised:
        capture_pair(_camera(clock, exposure, patience_s + 0.1), clock=clock)
    assert str(raised.value) == (
        f"The camera released, but no photograph reached its card in {patience_s:g} s: {advice}"
    )
    assert clock.monotonic() == pytest.approx(patience_s + SETTLE_S)
