"""The states of a job, and the one table of the ways between them."""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """What a job is at."""

    QUEUED = "queued"  # waits for a worker
    RUNNING = "running"  # a worker has it
    WAITING_FOR_OPERATOR = "waiting_for_operator"  # a worker has it and asks for a hand
    CANCELING = "canceling"  # a worker has it and was asked to stop
    SUCCEEDED = "succeeded"  # results are there
    FAILED = "failed"  # `error` says why
    CANCELED = "canceled"  # stopped on request
    EXPIRED = "expired"  # its files are being removed, and then its row


NEXT: dict[State, tuple[State, ...]] = {
    State.QUEUED: (State.RUNNING, State.CANCELED, State.FAILED),
    State.RUNNING: (
        State.QUEUED,
        State.WAITING_FOR_OPERATOR,
        State.CANCELING,
        State.SUCCEEDED,
        State.FAILED,
    ),
    State.WAITING_FOR_OPERATOR: (State.RUNNING, State.QUEUED, State.CANCELING, State.FAILED),
    State.CANCELING: (State.CANCELED,),
    State.SUCCEEDED: (State.EXPIRED,),
    State.FAILED: (State.EXPIRED,),
    State.CANCELED: (State.EXPIRED,),
    State.EXPIRED: (),
}
"""What may follow a state; a job starts as queued, and a worker that ends puts its job back."""

HELD = (State.RUNNING, State.WAITING_FOR_OPERATOR, State.CANCELING)
"""The states in which a worker has the job."""

ENDED = (State.SUCCEEDED, State.FAILED, State.CANCELED, State.EXPIRED)
"""The states in which nothing is done for the job any more."""


def before(state: State) -> list[State]:
    """States from which a job may go to this one."""
    return [earlier for earlier, following in NEXT.items() if state in following]
