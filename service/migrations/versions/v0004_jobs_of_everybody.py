"""Jobs of everybody are listed by pages, without a look at all of them."""

from __future__ import annotations

from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Add an index of jobs by their time alone."""
    op.create_index("jobs_by_time", "jobs", ["created", "id"])
