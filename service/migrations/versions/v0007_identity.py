"""Databases have names, so that each knows its store."""

from __future__ import annotations

import uuid

import sqlalchemy as sa
from alembic import op

from service.rows.clock import now

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Add the table of the name, and give one that no other database has."""
    identity = op.create_table(
        "identity",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("created", sa.Double, nullable=False),
    )
    op.execute(sa.insert(identity).values(id=uuid.uuid4().hex, created=now()))
