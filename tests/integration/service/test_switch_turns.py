"""Captures of several cameras take turns at the one switch of a flash, whoever claims them."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

from service import migrations
from service.rows import cameras, database, heartbeats, jobs

_CAMERAS = 6


def test_of_workers_that_claim_at_once_one_has_the_switch(url: str) -> None:
    engine = database.connect(url)
    migrations.upgrade(engine)
    at_once = threading.Barrier(_CAMERAS)

    def claim(number: int) -> str | None:
        at_once.wait()
        with engine.begin() as connection:
            held = cameras.claim(connection, f"job{number}", f"worker{number}")
        return held.id if held else None

    for number in range(_CAMERAS):
        address = f"ptp+ip://192.168.1.{number}"
        row = {"id": f"job{number}", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
        with engine.begin() as connection:
            heartbeats.beat(connection, f"worker{number}")
            camera = cameras.add(connection, address)
            capture = {"camera": address, "flash": "external"}
            jobs.add(connection, row | {"camera": camera, "capture": capture})
    with ThreadPoolExecutor(_CAMERAS) as pool:
        claimed = [one for one in pool.map(claim, range(_CAMERAS)) if one]

    assert len(claimed) == 1
    engine.dispose()
