"""What this host is called."""

from __future__ import annotations

import socket

import pytest
import sqlalchemy as sa

from service.rows import database
from service.workers import host


def test_hosts_are_told_apart_where_the_database_is_shared(
    engine: sa.Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "studio-" + "x" * 60)
    shared = database.connect("postgresql://lightlayers@127.0.0.1/none")  # never opened
    assert host.of_usb(shared) == host.name() == "studio-" + "x" * 25
    assert host.of_usb(engine) is None
