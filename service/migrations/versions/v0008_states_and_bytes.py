"""The last jobs of a state, and the bytes of a key's jobs, are told by indexes alone."""

from __future__ import annotations

from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """Add an index of jobs by state and time, and one of their bytes by owner."""
    op.create_index("jobs_by_state", "jobs", ["state", "created", "id"])
    op.create_index("jobs_by_bytes", "jobs", ["owner", "stored_bytes"])
