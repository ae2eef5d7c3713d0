"""Cameras are known, have queues, and jobs may ask for a hand."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Add the columns of jobs, then the table of cameras."""
    with op.batch_alter_table("jobs") as jobs:
        jobs.add_column(sa.Column("camera", sa.String(16)))
        jobs.add_column(sa.Column("camera_settings", sa.JSON))
        jobs.add_column(sa.Column("request", sa.String(200)))
        jobs.add_column(sa.Column("requests", sa.Integer, nullable=False, server_default="0"))
        jobs.add_column(sa.Column("request_until", sa.Double))
    op.create_index("jobs_by_camera", "jobs", ["camera", "state"])
    op.create_table(
        "cameras",
        sa.Column("id", sa.String(16), primary_key=True),
        sa.Column("address", sa.String(300), nullable=False),
        sa.Column("make", sa.String(255), nullable=False),
        sa.Column("model", sa.String(255), nullable=False),
        sa.Column("serial", sa.String(255), nullable=False),
        sa.Column("battery_percent", sa.Integer),
        sa.Column("free_bytes", sa.BigInteger),
        sa.Column("answered", sa.Boolean, nullable=False),
        sa.Column("looked", sa.Double, nullable=False),
        sa.Column("taken_until", sa.Double, nullable=False),
    )
