from __future__ import annotations

import contextlib

import pytest

from drivers.clock import Clock
from drivers.errors import BadAddressError
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import Body
from drivers.sim.ip_responder import IpResponder


def test_a_place_that_is_taken_is_told_before_the_scene_is_rendered(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = Body(SimulatedCamera(width=64, height=64), clock)
    with contextlib.closing(IpResponder(body)) as first:
        host, _, port = first.address.partition(":")
        monkeypatch.setattr(Body, "prepare", lambda _body: pytest.fail("it was rendered"))
        with pytest.raises(BadAddressError) as refusal:
            IpResponder(body, host, int(port))
    assert str(refusal.value) == (
        f"The simulated camera cannot listen on {first.address}: choose another --port or --host."
    )


@pytest.mark.parametrize("host", ["a..b", 70 * "ä"])
def test_what_can_be_no_name_of_a_host_is_told(clock: Clock, host: str) -> None:
    body = Body(SimulatedCamera(width=64, height=64), clock)
    with pytest.raises(BadAddressError, match=f"cannot listen on {host}:0: choose another --port"):
        IpResponder(body, host)
