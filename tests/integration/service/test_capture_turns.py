"""Captures take turns, whoever claims them: at a flash's switch, and at a camera on USB."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from service import migrations
from service.rows import cameras, database, heartbeats, jobs

_ON_NETWORK = [f"ptp+ip://192.168.1.{number}" for number in range(6)]
_ONE_BODY = ["ptp+usb://", "ptp+usb://1", "gphoto2://", "gphoto2://usb:001,004"]
"""Each of which may be the camera that another is."""


@pytest.mark.parametrize(
    ("addresses", "flash"), [(_ON_NETWORK, "external"), (_ONE_BODY, "property")]
)
def test_of_workers_that_claim_at_once_one_has_it(
    url: str, addresses: list[str], flash: str
) -> None:
    engine = database.connect(url)
    migrations.upgrade(engine)
    at_once = threading.Barrier(len(addresses))

    def claim(number: int) -> str | None:
        at_once.wait()
        with engine.begin() as connection:
            held = cameras.claim(connection, f"job{number}", f"worker{number}")
        return held.id if held else None

    for number, address in enumerate(addresses):
        row = {"id": f"job{number}", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
        with engine.begin() as connection:
            heartbeats.beat(connection, f"worker{number}")
            camera = cameras.add(connection, address)
            capture = {"camera": address, "flash": flash}
            jobs.add(connection, row | {"camera": camera, "capture": capture})
    with ThreadPoolExecutor(len(addresses)) as pool:
        claimed = [one for one in pool.map(claim, range(len(addresses))) if one]

    assert len(claimed) == 1
    engine.dispose()
