"""A camera that is busy when its release is pressed, as while its flash charges."""

from __future__ import annotations

import pytest

from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import CameraBusyError
from tests.unit.drivers.fake_camera import FLASH, FakeCamera


class Charging(FakeCamera):
    """A camera whose flash charges: busy until a time of the clock."""

    def __init__(self, clock: Clock, until_s: float) -> None:
        super().__init__()
        self.clock, self.until_s = clock, until_s
        self.released_s: list[float] = []

    def trigger(self) -> None:
        if self.clock.monotonic() < self.until_s:
            raise CameraBusyError("The camera is busy.")
        self.released_s.append(self.clock.monotonic())
        super().trigger()


@pytest.mark.parametrize("charging_s", [0.3, 1.0, 3.1, 7.0])
def test_a_flash_that_charges_is_awaited_and_no_longer_than_it_takes(
    clock: Clock, charging_s: float
) -> None:
    camera = Charging(clock, clock.monotonic() + charging_s)
    assert capture_pair(camera, clock=clock).flash.best == FLASH
    assert camera.until_s <= camera.released_s[0] <= camera.until_s + 0.21


def test_a_camera_that_stays_busy_is_given_up_after_eight_seconds(clock: Clock) -> None:
    begin = clock.monotonic()
    with pytest.raises(CameraBusyError):
        capture_pair(Charging(clock, begin + 3600), clock=clock)
    assert 7.5 < clock.monotonic() - begin < 8.5
