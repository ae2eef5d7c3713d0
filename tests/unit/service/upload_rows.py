"""Rows of uploads as tests make and find them."""

from __future__ import annotations

import sqlalchemy as sa

from service.rows import uploads


def added(
    engine: sa.Engine, upload_id: str, length: int, owner: str = "a", seconds: float = 60
) -> uploads.Upload:
    """An upload of which nothing has come, to be kept for some seconds."""
    values = {"id": upload_id, "owner": owner, "length": length}
    with engine.begin() as connection:
        uploads.add(connection, values, seconds)
    return found(engine, upload_id, owner)


def found(engine: sa.Engine, upload_id: str, owner: str = "a") -> uploads.Upload:
    """An upload as the database has it."""
    with engine.connect() as connection:
        upload = uploads.find(connection, owner, upload_id)
    assert upload is not None
    return upload
