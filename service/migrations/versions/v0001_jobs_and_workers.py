"""Jobs and workers, as the first version made them without writing its number down."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create both tables."""
    op.create_table(
        "jobs",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("stage", sa.String(16)),
        sa.Column("fraction", sa.Double, nullable=False),
        sa.Column("attempt", sa.Integer, nullable=False),
        sa.Column("lost", sa.Integer, nullable=False),
        sa.Column("worker", sa.String(64)),
        sa.Column("options", sa.JSON, nullable=False),
        sa.Column("capture", sa.JSON),
        sa.Column("inputs", sa.JSON),
        sa.Column("results", sa.JSON),
        sa.Column("error", sa.JSON),
        sa.Column("trace_id", sa.String(32), nullable=False),
        sa.Column("idempotency_key", sa.String(255), unique=True),
        sa.Column("request_hash", sa.String(64), nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("started", sa.Double),
        sa.Column("finished", sa.Double),
    )
    op.create_index("jobs_by_age", "jobs", ["created", "id"])
    op.create_index("jobs_by_state", "jobs", ["state", "created", "id"])
    op.create_table(
        "workers",
        sa.Column("id", sa.String(64), primary_key=True),
        sa.Column("seen", sa.Double, nullable=False),
    )
