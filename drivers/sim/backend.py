"""The simulated camera behind its address: the driver of every PTP camera, no cable."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

from drivers.camera import Camera, CameraInfo
from drivers.clock import Clock, SystemClock
from drivers.errors import CameraDisconnectedError, CameraTimeoutError, ProtocolError
from drivers.ptp import containers
from drivers.ptp.camera import open_awake
from drivers.ptp.codes import ContainerType
from drivers.ptp.containers import Container
from drivers.ptp.transport import ANSWER_S, DATASET_BYTES, Transport, put
from drivers.sim.address import parse
from drivers.sim.body import Body
from drivers.sim.responder import Responder


class InProcessTransport(Transport):
    """Carries the bytes of containers to a responder in the same process."""

    def __init__(self, body: Body, clock: Clock) -> None:
        self._body, self._clock = body, clock
        self._responder = Responder(body)
        self._answers: deque[bytes] = deque()
        self._closed = False

    def send(self, container: Container) -> None:
        """Send a command or its data."""
        self._check_connected()
        self._answers.extend(self._responder.accept(container.encode()))

    def receive(self, most: int = DATASET_BYTES, into: memoryview | None = None) -> Container:
        """Take the next data or response container."""
        self._check_connected()
        if not self._answers:
            self._clock.sleep(ANSWER_S)
            raise CameraTimeoutError(
                f"The camera gave no answer for {ANSWER_S:.0f} s: switch it off and on and take "
                "the pair anew."
            )
        answer = containers.decode(self._answers.popleft())
        if len(answer.payload) > most:
            raise ProtocolError(
                f"The camera sent {len(answer.payload)} bytes where {most} are the most"
            )
        if answer.type is ContainerType.DATA:
            return replace(answer, payload=put(answer.payload, into))
        return answer

    def receive_event(self, timeout_s: float) -> Container | None:
        """Take the next event, waiting at most timeout_s seconds; None if there is none."""
        self._check_connected()
        raw = self._responder.next_event()
        if raw is None and timeout_s > 0:
            wait = self._body.seconds_to_wait()
            self._clock.sleep(timeout_s if wait is None else min(wait, timeout_s))
            raw = self._responder.next_event()
        return None if raw is None else containers.decode(raw)

    def close(self) -> None:
        """Let go of the connection."""
        self._closed = True

    def _check_connected(self) -> None:
        if self._closed or self._responder.unplugged:
            raise CameraDisconnectedError(
                "The connection to the camera broke: connect it again and take the pair anew."
            )


def open_camera(address: str, clock: Clock | None = None) -> Camera:
    """Open the simulated camera. Raises BadAddressError, CameraNotFoundError."""
    clock = clock or SystemClock()
    options = parse(address)
    body = Body(options, clock)
    if options.cable == "direct":
        return open_awake(address, lambda: InProcessTransport(body, clock), clock)
    from drivers.ptp import usb
    from drivers.sim.usb_bus import SimulatedBus

    bus = SimulatedBus(body, clock)
    return open_awake(address, lambda: usb.connect("", bus, clock), clock)


def check_address(address: str) -> None:
    """Read the address. Raises BadAddressError, CameraNotFoundError."""
    parse(address)


def list_cameras() -> list[CameraInfo]:
    """List the one simulated camera, with the settings of a bare address."""
    with open_camera("sim://studio") as camera:
        return [camera.info()]
