from __future__ import annotations

import asyncio
import contextlib
import gc
import http.server
import signal
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.camera import Setting, SettingName
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import FlashError, NoFlashError, SettingError, UnconfirmedError
from drivers.flash import ExternalFlash, Flash, OperatorFlash, leave_flash_off
from drivers.pair import CapturedPair
from drivers.ptp.camera import PtpCamera
from drivers.shot import SETTLE_S
from drivers.sim.address import SimulatedCamera
from drivers.sim.backend import InProcessTransport
from drivers.sim.body import Body, FlashSwitch
from tests.certificates import self_signed
from tests.unit.drivers.fake_camera import NO_FLASH, FakeCamera


class Studio:
    """A simulated camera with a flash that it does not know of, or one on a switch."""

    def __init__(self, clock: Clock, camera: str) -> None:
        fields = {"width": 64, "height": 64, "format": "jpeg", "camera": camera}
        self.body = Body(SimulatedCamera.model_validate(fields), clock)
        self.camera = PtpCamera("sim://studio", InProcessTransport(self.body, clock), clock)
        self.asked: list[str] = []

    def ask(self, request: str, timeout_s: float) -> bool:
        assert timeout_s == 300
        self.asked.append(request)
        self.body.flash = "external" if " on," in request else "off"
        return True


def brightness(photograph: bytes) -> float:
    import cv2
    import numpy as np

    decoded = cv2.imdecode(np.frombuffer(photograph, np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return float(decoded.mean()) / 255


def test_a_camera_without_a_switch_says_so_before_the_first_photograph(clock: Clock) -> None:
    studio = Studio(clock, "switchless")
    with pytest.raises(
        SettingError,
        match=r"offers auto, fill, red_eye_fill: have a switch "
        r"of its own told \(external over HTTP, its command or URL on the command line\), or ",
    ):
        capture_pair(studio.camera, clock=clock)
    assert studio.camera.objects() == {1}


def test_a_person_switches_the_flash_between_the_photographs(clock: Clock) -> None:
    studio = Studio(clock, "switchless")
    flash = OperatorFlash(studio.ask, brightness)
    pair = capture_pair(studio.camera, clock=clock, flash=flash)
    assert studio.asked == [
        "Switch the flash off, then confirm.",
        "Switch the flash on, then confirm.",
    ]
    assert not pair.flash.exposure.flash_fired  # an external flash leaves no trace in EXIF
    assert brightness(pair.flash.best) > 1.2 * brightness(pair.no_flash.best)


def test_nobody_at_the_camera_ends_the_capture(clock: Clock) -> None:
    studio = Studio(clock, "switchless")
    flash = OperatorFlash(lambda _request, _timeout_s: False, brightness)
    with pytest.raises(UnconfirmedError, match="Nobody confirmed that the flash is off"):
        capture_pair(studio.camera, clock=clock, flash=flash)
    assert studio.camera.objects() == {1}


@pytest.mark.parametrize("switch", ["off", "external"])
def test_a_flash_that_lights_nothing_or_both_is_noticed(clock: Clock, switch: FlashSwitch) -> None:
    studio = Studio(clock, "switchless")
    studio.body.flash = switch
    flash = OperatorFlash(lambda _request, _timeout_s: True, brightness)
    with pytest.raises(NoFlashError, match="did not fire, or fired in both photographs: check it,"):
        capture_pair(studio.camera, clock=clock, flash=flash)


def test_a_flash_that_is_on_when_told_off_is_told_from_a_dead_one(clock: Clock) -> None:
    studio = Studio(clock, "switchless")

    def swapped(request: str, _timeout_s: float) -> bool:
        studio.body.flash = "off" if " on," in request else "external"
        return True

    with pytest.raises(
        NoFlashError, match="without the flash is the brighter one: check whether on and off of"
    ):
        capture_pair(studio.camera, clock=clock, flash=OperatorFlash(swapped, brightness))


@pytest.mark.parametrize(
    ("without", "with_flash", "lit"),
    [
        (0.2, 0.203, False),  # by 2 % and no less
        (0.2, 0.205, True),
        (0.0, 0.0002, True),
        (1e-7, 4e-7, False),  # noise of a capped lens
        (-5e-7, -1e-7, False),
    ],
)
def test_a_photograph_is_lit_that_is_brighter_by_more_than_noise(
    clock: Clock, without: float, with_flash: float, lit: bool
) -> None:
    brightnesses = [without, with_flash] * 2
    flash = OperatorFlash(lambda _request, _timeout_s: True, lambda _: brightnesses.pop(0))
    camera = FakeCamera(shots=[{"jpeg": NO_FLASH}, {"jpeg": NO_FLASH}] * 2)
    with contextlib.nullcontext() if lit else pytest.raises(NoFlashError, match="fired in both"):
        capture_pair(camera, clock=clock, flash=flash)


class Relay(http.server.BaseHTTPRequestHandler):
    told: list[str]
    orders: int  # that are obeyed

    def do_GET(self) -> None:
        self.told.append(self.path)
        if "dribble" in self.path:
            with contextlib.suppress(OSError):
                for byte in b"HTTP/1.1 200 OK\r\nServer: " + b"." * 200 + b"\r\n\r\n":
                    self.wfile.write(bytes([byte]))
                    time.sleep(0.02)
            return
        obeys = "turn" in self.path and len(self.told) <= self.orders
        self.send_response(200 if obeys else 500)
        self.end_headers()
        with contextlib.suppress(OSError):
            while "endless" in self.path:
                self.wfile.write(b".")
                time.sleep(0.02)

    def log_message(self, *_: object) -> None: ...


@pytest.fixture
def relay() -> Iterator[tuple[str, list[str]]]:
    Relay.told, Relay.orders = [], 1000
    server = http.server.HTTPServer(("127.0.0.1", 0), Relay)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", Relay.told
    server.shutdown()
    server.server_close()


def switched(flash: Flash, clock: Clock) -> None:
    camera = Studio(clock, "standard").camera
    flash.check(camera)
    flash.switch(camera, "on", clock)
    flash.switch(camera, "off", clock)


def test_a_url_is_told_the_state(clock: Clock, relay: tuple[str, list[str]]) -> None:
    url, told = relay
    switched(ExternalFlash(url + "/relay/0?turn={state}", brightness, settle_s=2), clock)
    assert told == ["/relay/0?turn=on", "/relay/0?turn=off"]
    assert clock.monotonic() == 4


def test_a_command_is_told_the_state(clock: Clock, tmp_path: object) -> None:
    log = f"{tmp_path}/log"
    script = f"import sys; open({log!r}, 'a').write(sys.argv[1] + ';')"
    switched(ExternalFlash(f'{sys.executable} -c "{script}" {{state}}', brightness), clock)
    with open(log, encoding="utf-8") as file:  # noqa: PTH123
        assert file.read() == "on;off;"


def test_a_command_has_obeyed_that_leaves_something_running(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.flash.SWITCH_S", 20.0)
    switched(ExternalFlash("sh -c 'sleep 30 & echo $0' {state}", brightness), clock)


def test_a_command_that_does_not_end_is_an_error(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.flash.SWITCH_S", 0.1)
    with pytest.raises(FlashError, match=r"failed, as it did not end within 0\.1 seconds:"):
        switched(ExternalFlash("sh -c 'exec sleep 5' {state}", brightness), clock)


def test_a_command_is_given_ten_seconds(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[object] = []

    def run(_command: list[str], **how: object) -> None:
        limits.append(how["timeout"])

    monkeypatch.setattr(subprocess, "run", run)
    switched(ExternalFlash("relay {state}", brightness), clock)
    assert limits == [10.0, 10.0]


def test_a_url_is_given_ten_seconds_in_all(
    clock: Clock, relay: tuple[str, list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    limits: list[float | None] = []
    timeout = asyncio.timeout

    def limit(seconds: float | None) -> asyncio.Timeout:
        limits.append(seconds)
        return timeout(seconds)

    monkeypatch.setattr(asyncio, "timeout", limit)
    switched(ExternalFlash(relay[0] + "/{state}?turn", brightness), clock)
    assert limits == [10.0, 10.0]


@pytest.mark.parametrize(
    ("order", "complaint"),
    [
        ("relay on", r"write \{state\} where on or off is to stand"),
        ("relay '{state}", "cannot be read"),
        ("no-such-program {state}", r"failed, as it cannot be run \(no such file or directory\):"),
        ("false {state}", "failed, with exit status 1: run it by hand"),
        ("sh -c 'kill -9 $$' {state}", "failed, as signal 9 ended it:"),
        ("no\0program {state}", "failed, as it cannot be run: run it"),
        ("http://127.0.0.1:1/{state}", "does not answer: check that it is on, and its URL, and"),
        ("http://[{state}", "does not answer: check"),
        ("http://a..b/{state}", "does not answer: check"),
        ("HTTP://127.0.0.1/{state}", "a URL begins with http:// or https://"),
        ("ftp://127.0.0.1/{state}", "a URL begins with http:// or https://"),
    ],
)
def test_orders_that_nothing_obeys_are_errors(clock: Clock, order: str, complaint: str) -> None:
    with pytest.raises(FlashError, match=complaint):
        switched(ExternalFlash(order, brightness), clock)


def test_a_relay_that_refuses_is_an_error(clock: Clock, relay: tuple[str, list[str]]) -> None:
    with pytest.raises(FlashError, match="switch of the flash answers 500: check its URL"):
        switched(ExternalFlash(relay[0] + "/{state}", brightness), clock)


@pytest.mark.parametrize("answer", ["endless", "dribble"])
def test_a_relay_whose_answer_does_not_end_is_an_error(
    clock: Clock, relay: tuple[str, list[str]], monkeypatch: pytest.MonkeyPatch, answer: str
) -> None:
    monkeypatch.setattr("drivers.flash.SWITCH_S", 0.3)
    begun = time.monotonic()
    with pytest.raises(FlashError, match="does not answer: check that it is on"):
        switched(ExternalFlash(f"{relay[0]}/{answer}?turn={{state}}", brightness), clock)
    assert time.monotonic() - begun < 3


def test_a_certificate_that_nobody_vouches_for_is_told_as_such(
    clock: Clock, tmp_path: Path
) -> None:
    certificate = tmp_path / "certificate"
    certificate.write_bytes(self_signed("relay"))
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate)
    with http.server.HTTPServer(("127.0.0.1", 0), Relay) as server:
        server.socket = context.wrap_socket(server.socket, server_side=True)
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        order = f"https://127.0.0.1:{server.server_port}/turn={{state}}"
        with pytest.raises(FlashError, match=r"certificate .* is none that this computer trusts"):
            switched(ExternalFlash(order, brightness), clock)
        server.shutdown()
        thread.join()


ORDERS = ["/turn=off", "/turn=on", "/turn=off"]


def taken(clock: Clock, camera: FakeCamera, url: str) -> CapturedPair:
    """A pair whose flash the camera does not know of, and which is there in its photographs."""
    brightness = iter((0.1, 0.2))
    flash = ExternalFlash(url + "/turn={state}", lambda _: next(brightness), settle_s=2)
    return capture_pair(camera, clock=clock, flash=flash)


def unlit() -> FakeCamera:
    return FakeCamera(shots=[{"jpeg": NO_FLASH}, {"jpeg": NO_FLASH}])


def test_a_switch_is_told_off_after_the_pair(clock: Clock, relay: tuple[str, list[str]]) -> None:
    pair = taken(clock, unlit(), relay[0])
    assert pair.flash.best == NO_FLASH
    assert relay[1] == ORDERS
    assert clock.monotonic() == 2 * 2 + 2 * SETTLE_S  # nothing waits for a flash that goes out


@pytest.mark.parametrize("failure", [SettingError("a dial was turned"), KeyboardInterrupt()])
@pytest.mark.parametrize("orders", [2, 3])
def test_a_switch_is_told_off_whatever_ends_the_pair(
    clock: Clock, relay: tuple[str, list[str]], failure: BaseException, orders: int
) -> None:
    class Failing(FakeCamera):
        def trigger(self) -> None:
            if len(self.shots) == 1:
                raise failure
            super().trigger()

    Relay.orders = orders
    with pytest.raises(type(failure)) as raised:
        taken(clock, Failing(), relay[0])
    assert raised.value is failure
    assert relay[1] == ORDERS


# it may come before subprocess knows what it has started
@pytest.mark.filterwarnings(
    "ignore:Exception ignored in.*Popen.__del__:pytest.PytestUnraisableExceptionWarning"
)
def test_a_switch_whose_last_order_is_interrupted_is_told_once_more(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    # a shell has what it starts in the background ignore it
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    log = tmp_path / "log"
    script = tmp_path / "switch"
    script.write_text(
        f"#!/bin/sh\nif [ -e {log} ]; then echo $1 >> {log}; else\n"
        f"touch {log}; kill -INT $PPID; fi\n"
    )
    script.chmod(0o700)
    with pytest.raises(KeyboardInterrupt):
        leave_flash_off(f"{script} {{state}}")
    assert log.read_text() == "off\n"


class NameServer:
    """Looks names up, the first of them only once it is let.

    hangs: how many these are. meanwhile: called then. asked, answered: threads.
    """

    def __init__(self) -> None:
        self.hangs = 1000
        self.answering = threading.Event()
        self.asked: list[threading.Thread] = []
        self.answered: list[threading.Thread] = []
        self.meanwhile: Callable[[], None] = lambda: None

    def look_up(self, host: bytes, port: int, *_: object, **__: object) -> list[tuple[object, ...]]:
        assert host == b"relay"
        self.asked.append(threading.current_thread())
        if len(self.asked) <= self.hangs:
            self.meanwhile()
            self.answering.wait(30)
        self.answered.append(threading.current_thread())
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", port))]


@pytest.fixture
def name_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[NameServer]:
    server = NameServer()
    monkeypatch.setattr("socket.getaddrinfo", server.look_up)
    yield server
    server.answering.set()
    for thread in server.asked:  # each must find its loop closed without an error
        thread.join()
    assert len(server.answered) == len(server.asked)


def named(url: str) -> str:
    return url.replace("127.0.0.1", "relay") + "/turn={state}"


def test_a_host_is_looked_up(
    clock: Clock, relay: tuple[str, list[str]], name_server: NameServer
) -> None:
    name_server.answering.set()
    switched(ExternalFlash(named(relay[0]), brightness), clock)
    assert relay[1] == ["/turn=on", "/turn=off"]


def test_a_host_that_nobody_finds_is_an_error(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look_up(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr("socket.getaddrinfo", look_up)
    with pytest.raises(FlashError, match="does not answer: check that it is on, and its URL"):
        switched(ExternalFlash("http://relay/{state}", brightness), clock)


def test_a_look_up_that_takes_too_long_is_left_to_itself(
    clock: Clock,
    relay: tuple[str, list[str]],
    name_server: NameServer,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr("drivers.flash.SWITCH_S", 1.0)
    with pytest.raises(FlashError, match="does not answer: check that it is on, and its URL"):
        switched(ExternalFlash(named(relay[0]), brightness), clock)
    leave_flash_off(named(relay[0]))
    assert caplog.messages == [
        "The flash was not switched off after the pair. The switch of the flash does not answer: "
        "check that it is on, and its URL, and try again."
    ]
    assert (len(name_server.asked), name_server.answered) == (2, [])
    assert all(thread.daemon for thread in name_server.asked)  # the interpreter waits for none
    name_server.answering.set()
    for thread in name_server.asked:
        thread.join()
    assert relay[1] == []  # nor is an order given late


def interrupt(_number: int, _frame: object) -> None:
    """As service.cli.signals has it."""
    raise KeyboardInterrupt


@pytest.mark.parametrize("handler", [signal.default_int_handler, interrupt])
def test_a_look_up_that_is_interrupted_is_left_to_itself(
    relay: tuple[str, list[str]],
    name_server: NameServer,
    request: pytest.FixtureRequest,
    handler: Callable[..., None],
    caplog: pytest.LogCaptureFixture,
) -> None:
    before = signal.signal(signal.SIGINT, handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))

    main = threading.main_thread().ident
    assert main is not None
    name_server.hangs = 1
    name_server.meanwhile = lambda: signal.pthread_kill(main, signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        leave_flash_off(named(relay[0]))
    assert name_server.answered == name_server.asked[1:]
    assert relay[1] == ["/turn=off"]  # by the order that is given once more
    gc.collect()
    assert caplog.messages == []


def test_a_pair_is_kept_whose_switch_obeys_no_more(
    clock: Clock, relay: tuple[str, list[str]], caplog: pytest.LogCaptureFixture
) -> None:
    Relay.orders = 2
    assert taken(clock, unlit(), relay[0]).no_flash.best == NO_FLASH
    assert relay[1] == ORDERS
    assert caplog.messages == [
        "The flash was not switched off after the pair. The switch of the flash answers 500: check "
        "its URL and try again."
    ]


def test_a_switch_is_told_nothing_where_no_pair_is_begun(
    clock: Clock, relay: tuple[str, list[str]]
) -> None:
    camera = FakeCamera()
    camera.table[SettingName.PROGRAM] = Setting(SettingName.PROGRAM, "auto", (), writable=False)
    with pytest.raises(SettingError):
        taken(clock, camera, relay[0])
    assert relay[1] == []
