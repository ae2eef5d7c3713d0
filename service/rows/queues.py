"""The queues that jobs wait in: that of the workers, and one of each camera.

A job whose pair a camera takes waits in the camera's first, and then in that of the workers.
"""

from __future__ import annotations

import sqlalchemy as sa

from service.rows.states import HELD, State
from service.rows.tables import jobs

CAPTURE = "capture"
"""The stage of attempts that take a pair; no other attempt of a job in a camera's queue has it."""

WAITS_FOR_CAMERA = sa.and_(
    jobs.c.state == State.QUEUED, jobs.c.camera.is_not(None), jobs.c.inputs.is_(None)
)
"""Whether a job waits in the queue of its camera."""

HOLDS_CAMERA = sa.and_(jobs.c.state.in_(HELD), jobs.c.stage == CAPTURE)
"""Whether a worker holds a job out of the queue of its camera."""


def waits_in_queue(camera: str | None) -> sa.ColumnElement[bool]:
    """Whether a job waits in the queue of a camera; None: in that of the workers."""
    if camera is not None:
        return sa.and_(WAITS_FOR_CAMERA, jobs.c.camera == camera)
    elsewhere = sa.or_(jobs.c.camera.is_(None), jobs.c.inputs.is_not(None))
    return sa.and_(jobs.c.state == State.QUEUED, elsewhere)


def is_held_from_queue(camera: str | None) -> sa.ColumnElement[bool]:
    """Whether a worker holds a job out of the queue of a camera; None: out of the workers'."""
    if camera is not None:
        return sa.and_(HOLDS_CAMERA, jobs.c.camera == camera)
    return sa.and_(jobs.c.state.in_(HELD), jobs.c.stage.is_distinct_from(CAPTURE))
