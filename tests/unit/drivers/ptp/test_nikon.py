from __future__ import annotations

import pytest

from drivers.camera import EventKind
from drivers.capture import capture_pair
from drivers.clock import Clock
from drivers.errors import ProtocolError
from drivers.ptp.camera import PtpCamera
from drivers.ptp.codes import NIKON, Operation, Response
from drivers.ptp.datasets import DeviceInfo
from drivers.ptp.nikon import Calls
from drivers.ptp.session import Session
from drivers.sim.address import SimulatedCamera
from drivers.sim.backend import InProcessTransport
from drivers.sim.body import Body, Refusal
from drivers.sim.responder import Answer, Responder

CALLS = (
    Operation.NIKON_CAPTURE_TO_CARD,
    Operation.NIKON_GET_EVENTS,
    Operation.NIKON_DEVICE_READY,
)


def a_body(clock: Clock, camera: str) -> Body:
    options = {"camera": camera, "width": 64, "height": 64, "format": "jpeg"}
    return Body(SimulatedCamera.model_validate(options), clock)


@pytest.mark.parametrize(
    ("maker", "vendor", "ours"),
    [
        ("Nikon Corporation", NIKON, True),
        ("NIKON CORPORATION", 6, True),  # MTP's
        ("Nikon", 0xFFFFFFFF, True),
        ("Make", NIKON, True),
        ("Make", 6, False),
        ("", 0, False),
    ],
)
def test_calls_are_made_of_cameras_of_nikon_alone(
    clock: Clock, maker: str, vendor: int, ours: bool
) -> None:
    device = DeviceInfo(CALLS, (), (), (), maker, "Model", "1", "", vendor)
    calls = Calls(Session(InProcessTransport(a_body(clock, "native"), clock), clock), device)
    assert (calls.can_capture, calls.can_tell) == (ours, ours)


def made_by_nikon(clock: Clock) -> tuple[Calls, Session]:
    device = DeviceInfo(CALLS, (), (), (), "Nikon", "Model", "1", "", NIKON)
    session = Session(InProcessTransport(a_body(clock, "native"), clock), clock)
    return Calls(session, device), session


def test_a_release_neither_focuses_nor_leaves_the_card_out(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, session = made_by_nikon(clock)
    asked: list[tuple[int, ...]] = []
    monkeypatch.setattr(session, "request_once", lambda *what: asked.append(what))

    calls.capture()

    assert asked == [(0x9207, 0xFFFFFFFF, 0)]


def test_more_than_a_thousand_events_are_no_list_of_them(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, session = made_by_nikon(clock)
    monkeypatch.setattr(session, "is_busy", lambda _operation: False)
    for count in (1000, 1001):
        event = (0x4002).to_bytes(2, "little") + (7).to_bytes(4, "little")
        data = count.to_bytes(2, "little") + count * event
        monkeypatch.setattr(session, "request", lambda _operation, data=data: data)
        if count == 1000:
            told = calls.events(timeout_s=0)
            assert [(one.code, one.parameters) for one in told] == [(0x4002, (7,))] * 1000
        else:
            with pytest.raises(ProtocolError, match="tells of 1001 events at once"):
                calls.events(timeout_s=0)


def test_a_camera_that_names_another_extension_is_asked_for_its_events(clock: Clock) -> None:
    body = a_body(clock, "native")
    assert body.model.vendor != NIKON
    with PtpCamera("sim://studio", InProcessTransport(body, clock), clock) as camera:
        camera.trigger()
        told = camera.events(timeout_s=5)
    assert [event.kind for event in told] == [EventKind.OBJECT_ADDED, EventKind.CAPTURE_COMPLETE]


@pytest.mark.parametrize(
    "code",
    [
        Response.DEVICE_BUSY,
        Response.NIKON_BULB_RELEASE_BUSY,
        Response.NIKON_SILENT_RELEASE_BUSY,
    ],
)
def test_a_camera_that_exposes_says_so_in_several_ways(
    clock: Clock, code: Response, monkeypatch: pytest.MonkeyPatch
) -> None:
    _says_while_it_exposes(monkeypatch, code)
    body = a_body(clock, "native")
    asked: list[bool] = []
    get_events = Responder._get_events

    def note(self: Responder, *parameters: int) -> Answer:
        asked.append(body.seconds_to_wait() is not None)
        return get_events(self, *parameters)

    monkeypatch.setattr(Responder, "_get_events", note)
    with PtpCamera("sim://studio", InProcessTransport(body, clock), clock) as camera:
        pair = capture_pair(camera, clock=clock)
    stored = (*pair.no_flash.stored, *pair.flash.stored)
    assert [item.handle for item in stored] == [2, 3]
    # of its events a busy one is not asked
    assert any(asked) is (code == Response.NIKON_SILENT_RELEASE_BUSY)


def test_another_answer_is_none(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    _says_while_it_exposes(monkeypatch, Response.GENERAL_ERROR)
    body = a_body(clock, "native")
    with PtpCamera("sim://studio", InProcessTransport(body, clock), clock) as camera:
        camera.trigger()
        with pytest.raises(ProtocolError, match="NIKON_DEVICE_READY with the response 0x2002"):
            camera.events(timeout_s=5)


def _says_while_it_exposes(monkeypatch: pytest.MonkeyPatch, code: Response) -> None:
    def device_ready(self: Responder, *_: int) -> Answer:
        if self._body.seconds_to_wait() is not None:
            raise Refusal(code)
        return None, ()

    monkeypatch.setattr(Responder, "_device_ready", device_ready)
