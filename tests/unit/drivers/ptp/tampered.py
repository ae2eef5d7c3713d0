"""A sound camera whose answers are changed on the way."""

from __future__ import annotations

from collections.abc import Callable

from drivers.clock import Clock
from drivers.ptp.camera import PtpCamera
from drivers.ptp.codes import ContainerType
from drivers.ptp.containers import Container
from drivers.ptp.transport import DATASET_BYTES
from drivers.sim.address import SimulatedCamera
from drivers.sim.backend import InProcessTransport
from drivers.sim.body import Body

Tamper = Callable[[bytes], bytes]
OPTIONS = SimulatedCamera(width=64, height=64, noise="off", format="both")


class Tampered(InProcessTransport):
    """A sound camera whose data are changed on the way, by operation."""

    def __init__(self, clock: Clock, tampers: dict[int, Tamper]) -> None:
        super().__init__(Body(OPTIONS, clock), clock)
        self.tampers = tampers

    def receive(self, most: int = DATASET_BYTES, into: memoryview | None = None) -> Container:
        answer = super().receive(most, into)
        if answer.type is not ContainerType.DATA or answer.code not in self.tampers:
            return answer
        payload = self.tampers[answer.code](bytes(answer.payload))
        return Container(answer.type, answer.code, answer.transaction, payload)


def opened(clock: Clock, tampers: dict[int, Tamper] | None = None) -> PtpCamera:
    return PtpCamera("sim://studio", Tampered(clock, tampers or {}), clock)


def photographed(clock: Clock, tampers: dict[int, Tamper] | None = None) -> PtpCamera:
    camera = opened(clock, tampers)
    camera.trigger()
    clock.sleep(1)
    camera.events(0)
    return camera
