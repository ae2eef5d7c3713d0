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
    op.drop_index("jobs_by_state", "jobs")
    with op.batch_alter_table("jobs", naming_convention=_NAMES) as jobs:
        for column in _columns():
            jobs.add_column(column)
        jobs.alter_column("state", existing_type=sa.String(16), type_=sa.String(24))
        jobs.drop_constraint("jobs_idempotency_key_key", type_="unique")
        jobs.create_unique_constraint("jobs_by_idempotency_key", ["owner", "idempotency_key"])
    op.create_index("jobs_by_age", "jobs", ["owner", "created", "id"])
    op.create_index("jobs_by_rank", "jobs", ["state", "rank", "created", "id"])
    op.create_index("jobs_by_flow", "jobs", ["state", "owner", "priority", "rank"])
    op.create_index("jobs_by_deadline", "jobs", ["state", "deadline"])
    op.create_index("jobs_by_expiry", "jobs", ["state", "expires"])
    op.create_index("jobs_by_likeness", "jobs", ["likeness", "state", "created"])
    news = sa.text("webhook IS NOT NULL AND delivery IS NULL")
    op.create_index(
        "jobs_with_news", "jobs", ["finished"], sqlite_where=news, postgresql_where=news
    )
    _create_keys()
    _create_uploads()


def _columns() -> list[sa.Column[object]]:
    return [
        sa.Column("revision", sa.Integer, nullable=False, server_default="1"),
        sa.Column("owner", sa.String(32), nullable=False, server_default=""),
        sa.Column("priority", sa.String(8), nullable=False, server_default="normal"),
        sa.Column("rank", sa.Integer, nullable=False, server_default="1"),
        sa.Column("progress", sa.Double, nullable=False, server_default="0"),
        sa.Column("eta", sa.Double),
        sa.Column("likeness", sa.String(64), nullable=False, server_default=""),
        sa.Column("stage_seconds", sa.JSON),
        sa.Column("webhook", sa.JSON),
        sa.Column("delivery", sa.JSON),
        sa.Column("span_id", sa.String(16)),
        sa.Column("deadline", sa.Double),
        sa.Column("expires", sa.Double),
        sa.Column("stored_bytes", sa.BigInteger, nullable=False, server_default="0"),
    ]


def _create_keys() -> None:
    op.create_table(
        "keys",
        sa.Column("id", sa.String(16), primary_key=True),
        sa.Column("digest", sa.String(64), nullable=False),
        sa.Column("name", sa.String(100), nullable=False),
        sa.Column("scopes", sa.JSON, nullable=False),
        sa.Column("waiting_jobs", sa.Integer),
        sa.Column("jobs_per_day", sa.Integer),
        sa.Column("stored_bytes", sa.BigInteger),
        sa.Column("day", sa.Integer, nullable=False),
        sa.Column("jobs_of_day", sa.Integer, nullable=False),
        sa.Column("created", sa.Double, nullable=False),
        sa.Column("expires", sa.Double),
        sa.Column("revoked", sa.Double),
        sa.Column("used", sa.Double),
    )


def _create_uploads() -> None:
    op.create_table(
        "uploads",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("owner", sa.String(32), nullable=False),
        sa.Column("length", sa.BigInteger, nullable=False),
        sa.Column("received", sa.BigInteger, nullable=False),
        sa.Column("parts", sa.JSON, nullable=False),
        sa.Column("metadata", sa.Text),
        sa.Column("expires", sa.Double, nullable=False),
    )
    op.create_index("uploads_by_expiry", "uploads", ["expires"])
