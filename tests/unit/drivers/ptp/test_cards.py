"""Cards that come and go while a camera is asked about them."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.clock import Clock
from drivers.errors import StoreFullError
from drivers.ptp.camera import PtpCamera
from drivers.ptp.codes import Operation, Response
from drivers.sim.address import SimulatedCamera
from drivers.sim.backend import InProcessTransport
from drivers.sim.body import STORAGE, Body, Refusal
from drivers.sim.responder import Responder

OPTIONS = SimulatedCamera(width=64, height=64, format="jpeg")


def opened(clock: Clock) -> PtpCamera:
    return PtpCamera("sim://studio", InProcessTransport(Body(OPTIONS, clock), clock), clock)


def refuse(monkeypatch: pytest.MonkeyPatch, operation: Operation, times: int) -> list[int]:
    """Have a card be gone so many times that the camera is asked; gives which was asked about."""
    asked: list[int] = []
    name = f"_{operation.name.lower()}"
    original: Any = getattr(Responder, name)

    def answer(responder: Responder, *parameters: int) -> Any:
        asked.append(parameters[0])
        if len(asked) <= times:
            raise Refusal(Response.INVALID_STORAGE_ID)
        return original(responder, *parameters)

    monkeypatch.setattr(Responder, name, answer)
    return asked


def test_a_card_that_is_taken_up_anew_is_listed_again(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = refuse(monkeypatch, Operation.GET_OBJECT_HANDLES, 1)
    assert opened(clock).objects() == {1}
    assert asked == [STORAGE, STORAGE]
    assert clock.monotonic() == 1


def test_a_card_that_stays_away_is_told(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = refuse(monkeypatch, Operation.GET_OBJECT_HANDLES, 9)
    with pytest.raises(StoreFullError, match="has no memory card it can write to: insert one"):
        opened(clock).objects()
    assert asked == [STORAGE, STORAGE]


def test_of_a_card_that_has_just_gone_no_room_is_told(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse(monkeypatch, Operation.GET_STORAGE_INFO, 1)
    info = opened(clock).info()
    assert (info.model, info.free_bytes) == ("NIKON D5100", 0)
