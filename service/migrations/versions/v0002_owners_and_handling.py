"""Jobs have owners, and say how they are to be dealt with."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"

_NAMES = {"uq": "%(table_name)s_%(column_0_name)s_key"}
"""What PostgreSQL calls a unique column; SQLite calls it nothing, and alembic goes by the name."""


def upgrade() -> None:
    """Add the columns of jobs, then the tables that came with them."""
    op.drop_index("jobs_by_age", "jobs")
    with op.batch_alter_table("jobs", naming_convention=_NAMES) as jobs:
        for column in _columns():
            jobs.add_column(column)
        jobs.alter_column("state", existing_type=sa.String(16), type_=sa.String(24))
        jobs.drop_constraint("jobs_idempotency_key_key", type_="unique")
        jobs.create_unique_constraint("jobs_by_idempotency_key", ["owner", "idempotency_key"])
    op.create_index("jobs_by_age", "jobs", ["owner", "created", "id"])


def _columns() -> list[sa.Column[object]]:
    return [
        sa.Column("revision", sa.Integer, nullable=False, server_default="1"),
        sa.Column("owner", sa.String(32), nullable=False, server_default=""),
        sa.Column("priority", sa.String(8), nullable=False, server_default="normal"),
        sa.Column("rank", sa.Integer, nullable=False, server_default="1"),
        sa.Column("webhook", sa.JSON),
        sa.Column("span_id", sa.String(16)),
        sa.Column("deadline", sa.Double),
        sa.Column("expires", sa.Double),
    ]
