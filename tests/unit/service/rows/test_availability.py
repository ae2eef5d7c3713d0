from __future__ import annotations

import pytest
import sqlalchemy as sa

from service.errors import EndedError, GoneError, NotReadyError
from service.rows import availability
from service.rows.states import State
from service.storage.base import Storage
from tests.unit.service.job_rows import added

HELD_ON = "results are there once it is succeeded."
OVER = "there will be no results"


def test_a_job_that_has_succeeded_has_results(engine: sa.Engine) -> None:
    availability.check_succeeded(added(engine, "a", state=State.SUCCEEDED))


@pytest.mark.parametrize(
    ("state", "error", "said"),
    [
        ("queued", NotReadyError, f"The job is queued; {HELD_ON}"),
        ("running", NotReadyError, f"The job is running; {HELD_ON}"),
        ("waiting_for_operator", NotReadyError, f"The job is waiting_for_operator; {HELD_ON}"),
        ("canceling", NotReadyError, f"The job is canceling; {HELD_ON}"),
        ("failed", EndedError, f"The job is failed; its `error` says why, and {OVER}."),
        ("canceled", EndedError, f"The job is canceled; {OVER}, so run it again."),
        (
            "expired",
            GoneError,
            "The job's results and photographs are removed; send the pair again.",
        ),
    ],
)
def test_a_job_without_results_is_refused_for_what_it_is_at(
    state: str, error: type[Exception], said: str, engine: sa.Engine
) -> None:
    with pytest.raises(error) as told:
        availability.check_succeeded(added(engine, "a", state=state))
    assert (type(told.value), str(told.value)) == (error, said)


def test_a_file_that_is_not_in_the_store_any_more_is_gone(storage: Storage) -> None:
    storage.put("jobs/a/1/lamp1.jpg", b"light")
    with availability.deleted_meanwhile():
        assert storage.get("jobs/a/1/lamp1.jpg") == b"light"
    with pytest.raises(GoneError) as told, availability.deleted_meanwhile():
        storage.get("jobs/a/1/lamp2.jpg")
    assert str(told.value) == "The job is being deleted; its results are gone."


def test_other_faults_of_the_store_stay_what_they_are() -> None:
    with pytest.raises(PermissionError), availability.deleted_meanwhile():
        raise PermissionError("the disk")
