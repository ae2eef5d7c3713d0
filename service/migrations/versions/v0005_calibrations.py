"""Calibrations are found without a look at all that their owner has ever made."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add an index of calibrations alone."""
    calibrates = sa.text("likeness LIKE 'calibrate-%'")
    op.create_index(
        "jobs_that_calibrate",
        "jobs",
        ["owner", "state", "created"],
        sqlite_where=calibrates,
        postgresql_where=calibrates,
    )
