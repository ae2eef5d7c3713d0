"""Cameras on USB are known by the host that they hang on."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Add the column of cameras."""
    op.add_column("cameras", sa.Column("host", sa.String(32)))
