"""Cameras that lie and fail at random: python -m tests.tether.faults [--packets N] [--sequences N].

Mutated packets must end in an answer or an error of the drivers; random sequences of faults must
end in a true pair or such an error, in bounded time. Everything follows from the seed.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import socket
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from random import Random
from typing import Any, get_args

import drivers
from drivers.capture import capture_pair
from drivers.errors import CameraBusyError
from drivers.ptp import usb
from drivers.ptp.camera import PtpCamera, open_awake
from drivers.ptp.containers import Container
from drivers.ptp.ip import IpTransport
from drivers.ptp.ip_packets import Greeting, PacketStream, PacketType, encode_packet
from drivers.sim.address import SimulatedCamera
from drivers.sim.backend import InProcessTransport
from drivers.sim.body import Body
from drivers.sim.faults import Fault
from drivers.sim.files import Shooting
from drivers.sim.ip_responder import IpResponder, _packets
from drivers.sim.responder import Responder
from drivers.sim.usb_bus import SimulatedBus

LONGEST_S = 400.0
"""No capture takes longer, whatever the camera does; seconds of the simulated clock."""

_CAPTURES = 3  # in a sequence, at most
_HELD_S = 60.0  # a call that takes longer over a mutated packet hangs; seconds of the real clock


@dataclass
class QuickClock:
    """Time that passes only while somebody waits."""

    seconds: float = 0.0

    def monotonic(self) -> float:
        return self.seconds

    def sleep(self, seconds: float) -> None:
        self.seconds += seconds

    def now(self) -> datetime:
        return datetime(2024, 2, 29, 23, 59, 58)


class QuickBody(Body):
    """A camera that develops each kind of photograph once."""

    developed: dict[Any, Any] = {}  # noqa: RUF012  shared by all

    def _photograph(self, shooting: Shooting) -> Any:
        key = (shooting, self._options.format)
        if key not in self.developed:
            self.developed[key] = super()._photograph(shooting)
        return self.developed[key]


def body(clock: QuickClock, **options: Any) -> QuickBody:
    fields = {"width": 64, "height": 64, "noise": "off", **options}
    return QuickBody(SimulatedCamera.model_validate(fields), clock)


def mutated(raw: bytes, random: Random) -> bytes:
    """Change a packet as a broken or hostile camera might."""
    data = bytearray(raw)
    match random.randrange(6):
        case 0:
            for _ in range(random.randint(1, 4)):
                data[random.randrange(len(data))] = random.randrange(256)
        case 1:
            at = random.randrange(0, max(1, len(data) - 3))
            extreme = random.choice((0, 1, 0x7FFFFFFF, 0xFFFFFFFE, 0xFFFFFFFF))
            data[at : at + 4] = extreme.to_bytes(4, "little")
        case 2:
            del data[random.randrange(len(data)) :]
        case 3:
            data += random.randbytes(random.randint(1, 40))
        case 4:
            data = data + data
        case 5:
            data = bytearray(random.randbytes(random.randint(0, 60)))
    return bytes(data)


class LyingBus(SimulatedBus):
    """A bus on which some transfers are changed; counts them."""

    random: Random
    changed = 0

    def _cut(self, answers: list[Container]) -> list[bytes]:
        raw = super()._cut(answers)
        if self.random.random() < 0.1:
            at = self.random.randrange(len(raw)) if raw else 0
            raw[at : at + 1] = [mutated(raw[at] if raw else b"\0" * 12, self.random)]
            LyingBus.changed += 1
        return raw


class LyingWire(IpTransport):
    """PTP/IP over a pair of sockets with a responder that changes some packets; counts them."""

    changed = 0

    def __init__(self, camera: Body, random: Random) -> None:
        self._far: list[socket.socket] = []
        self._responder, self._random = Responder(camera), random
        super().__init__("simulated", 1, answer_s=0.02)

    def _connect(self, host: str, port: int) -> PacketStream:  # noqa: ARG002
        near, far = socket.socketpair()
        self._far.append(far)
        greeting = (
            encode_packet(
                PacketType.INIT_COMMAND_ACK, b"\1\0\0\0", Greeting(b"0" * 16, "x").encode()
            )
            if len(self._far) == 1
            else encode_packet(PacketType.INIT_EVENT_ACK)
        )
        self._tell(far, greeting, 0.02)
        stream = PacketStream.__new__(PacketStream)
        stream.socket, stream._silence_s = near, math.inf
        self._streams.append(stream)
        return stream

    def _tell(self, far: socket.socket, raw: bytes, share: float) -> None:
        lies = self._random.random() < share
        try:
            far.sendall(mutated(raw, self._random) if lies else raw)
            if lies:
                LyingWire.changed += 1
                far.shutdown(socket.SHUT_WR)  # so that nobody waits for what a length promises
        except BrokenPipeError:
            pass  # it lied before

    def send(self, container: Container) -> None:
        super().send(container)
        for answer in self._responder.answer(container):
            for packet in _packets(answer):
                self._tell(self._far[0], encode_packet(*packet), 0.07)
        while (event := self._responder.next_event()) is not None:
            told = encode_packet(PacketType.EVENT, event[6:8], event[8:12], event[12:])
            self._tell(self._far[1], told, 0.3)

    def close(self) -> None:
        super().close()
        for far in self._far:
            far.close()


USES: tuple[Callable[[Any], Any], ...] = (
    lambda camera: camera.info(),
    lambda camera: camera.settings(),
    lambda camera: camera.write(drivers.SettingName.FLASH, "off"),
    lambda camera: [camera.describe(handle) for handle in camera.objects()],
    lambda camera: list(camera.download(2)),
    lambda camera: (camera.trigger(), camera.events(0.0)),
)


def mutate_packets(count: int, seed: int) -> Counter[str]:
    """Change that many packets on their way from cameras; gives how calls ended."""
    random, told = Random(seed), Counter[str]()
    clock = QuickClock()
    camera = body(clock, format="jpeg")
    camera.release()
    clock.sleep(1)
    camera.advance()
    LyingBus.changed = LyingWire.changed = 0
    while LyingBus.changed + LyingWire.changed < count:
        started = time.monotonic()
        try:
            with _lying(camera, clock, random) as opened:
                for use in random.choices(USES, k=8):
                    use(opened)
                    clock.sleep(1)
            told["answered"] += 1
        except drivers.DriverError as error:
            told[type(error).__name__] += 1
        if time.monotonic() - started > _HELD_S:
            raise AssertionError(f"a call hung for {time.monotonic() - started:.0f} s")
        camera.objects = {h: camera.objects[h] for h in (1, 2)}
    return told


def _lying(camera: Body, clock: QuickClock, random: Random) -> PtpCamera:
    if random.random() < 0.5:
        bus = LyingBus(camera, clock)
        bus.random = random
        return PtpCamera("usb", usb.connect("", bus, clock), clock)
    return PtpCamera("ip", LyingWire(camera, random), clock)


def mutate_initiators(count: int, seed: int) -> None:
    """Send that many changed packets to the simulated camera; it must serve the next one."""
    random = Random(seed)
    served = IpResponder(body(QuickClock()))
    host, port = served.address.split(":")
    sound = (
        encode_packet(PacketType.INIT_COMMAND_REQUEST, Greeting(b"0" * 16, "x").encode()),
        encode_packet(PacketType.INIT_EVENT_REQUEST, b"\1\0\0\0"),
        encode_packet(PacketType.OPERATION, b"\1\0\0\0\x02\x10\0\0\0\0\1\0\0\0"),
        encode_packet(PacketType.OPERATION, b"\2\0\0\0\x16\x10\1\0\0\0\x0c\x50\0\0"),
        encode_packet(PacketType.START_DATA, b"\1\0\0\0\2\0\0\0\0\0\0\0"),
        encode_packet(PacketType.END_DATA, b"\1\0\0\0\2\0"),
    )
    for _ in range(count // len(sound) + 1):
        with (
            socket.create_connection((host, int(port))) as wire,
            contextlib.suppress(OSError),  # it may hang up on nonsense
        ):
            wire.settimeout(_HELD_S)
            wire.sendall(sound[0] if random.random() < 0.7 else mutated(sound[0], random))
            wire.sendall(b"".join(mutated(each, random) for each in sound[1:]))
            wire.shutdown(socket.SHUT_WR)
            while wire.recv(65536):
                pass
    deadline = time.monotonic() + _HELD_S
    while True:  # the last one may just be leaving
        try:
            with drivers.open_camera(f"ptp+ip://{served.address}") as camera:
                assert camera.objects() == {1}
            break
        except CameraBusyError:
            if time.monotonic() > deadline:
                raise
    served.close()


@dataclass
class Sequence:
    """Some captures with one camera, each with faults that come and go."""

    random: Random
    told: Counter[str]
    clock: QuickClock = field(default_factory=QuickClock)

    def run(self) -> None:
        random = self.random
        options = {
            "format": random.choice(("jpeg", "dng", "both")),
            "camera": random.choice(("standard", "native")),
        }
        camera = body(self.clock, **options)
        bus = SimulatedBus(camera, self.clock)
        for _ in range(random.randint(1, _CAPTURES)):
            started, camera.fault = self.clock.seconds, self._fault()
            bus.plug_in()
            try:
                with self._opened(camera, bus) as opened:
                    pair = capture_pair(opened, self._meddle(camera), self.clock)
                check_pair(pair, camera)
                self.told["pair"] += 1
            except drivers.DriverError as error:
                self.told[type(error).__name__] += 1
            if self.clock.seconds - started > LONGEST_S:
                raise AssertionError(f"a capture took {self.clock.seconds - started:.0f} s")

    def _fault(self) -> Fault:
        return self.random.choice(get_args(Fault))

    def _opened(self, camera: Body, bus: SimulatedBus) -> PtpCamera:
        if self.random.random() < 0.5:
            return open_awake("usb", lambda: usb.connect("", bus, self.clock), self.clock)
        return open_awake("sim", lambda: InProcessTransport(camera, self.clock), self.clock)

    def _meddle(self, camera: Body) -> Callable[[str, float], None]:
        def progress(_stage: str, _fraction: float) -> None:
            if self.random.random() < 0.1:
                camera.fault = self._fault()

        return progress


def check_pair(pair: drivers.CapturedPair, camera: Body) -> None:
    """Neither swapped nor mixed: two releases, one after the other, as the card has them."""
    numbers, card = [], {each.data: each.info.name for each in camera.objects.values()}
    for shot, fired in ((pair.no_flash, False), (pair.flash, True)):
        assert shot.exposure.flash_fired is fired
        (number,) = {card[data].partition(".")[0] for data in shot.files.values()}
        numbers.append(int(number.removeprefix("DSC_")))
    assert numbers[1] == numbers[0] + 1


def fault_sequences(count: int, seed: int) -> Counter[str]:
    """Run that many sequences; gives how captures ended."""
    told = Counter[str]()
    for number in range(count):
        try:
            Sequence(Random(f"{seed}/{number}"), told).run()
        except BaseException:
            print(f"sequence {number} of seed {seed}")  # noqa: T201
            raise
    return told


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.tether.faults")
    parser.add_argument("--packets", type=int, default=100_000)
    parser.add_argument("--sequences", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    for name, told in (
        (f"{asked.sequences} sequences", fault_sequences(asked.sequences, asked.seed)),
        (f"{asked.packets} packets of cameras", mutate_packets(asked.packets, asked.seed)),
    ):
        print(name, dict(told.most_common()), flush=True)  # noqa: T201
    mutate_initiators(asked.packets // 10, asked.seed)
    print(f"{asked.packets // 10} packets of initiators: served on")  # noqa: T201


if __name__ == "__main__":
    main()
