"""What this host is called where hosts are told apart: by their workers, and by what is on USB."""

from __future__ import annotations

import socket

import sqlalchemy as sa


def name() -> str:
    """Name this host, in up to 32 characters."""
    return socket.gethostname()[:32]


def of_usb(engine: sa.Engine) -> str | None:
    """Name this host where cameras may hang on several; None where there is no other.

    A service on SQLite is on one machine, whatever that or its containers are called by and by.
    """
    return None if engine.dialect.name == "sqlite" else name()
