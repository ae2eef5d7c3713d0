from __future__ import annotations

import pytest

from drivers.clock import Clock
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body
from drivers.sim.usb_bus import SimulatedBus


@pytest.fixture
def bus(clock: Clock) -> SimulatedBus:
    return SimulatedBus(Body(SimulatedCamera(width=64, height=64, format="jpeg"), clock), clock)
