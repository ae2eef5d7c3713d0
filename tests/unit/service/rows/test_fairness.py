from __future__ import annotations

import itertools

import pytest
import sqlalchemy as sa

from service.rows import attempts, jobs, queues, tables
from service.rows.fairness import MAX_RANK

_numbers = itertools.count()


def _add(engine: sa.Engine, owner: str, priority: str = "normal", camera: str | None = None) -> str:
    """Put a job into the queue; its id, which begins with its owner."""
    job_id = f"{owner} {next(_numbers)}"
    row: dict[str, object] = {"options": {}, "trace_id": "t", "request_hash": "h", "camera": camera}
    with engine.begin() as connection:
        jobs.add(connection, {"id": job_id, "owner": owner, "priority": priority, **row})
    return job_id


def _go(engine: sa.Engine, end: bool = True, camera: str | None = None) -> str:
    """Have a worker take the job that is first; its id. camera: in the camera's queue."""
    order = (tables.jobs.c.rank, tables.jobs.c.created, tables.jobs.c.id)
    with engine.begin() as connection:
        waiting = sa.select(tables.jobs.c.id).where(queues.waits_in_queue(camera))
        job_id: str = connection.execute(waiting.order_by(*order).limit(1)).scalar_one()
        held = attempts.claim(connection, job_id, "w", queues.CAPTURE if camera else None)
        assert held is not None
        if end:
            attempts.succeed(connection, held, [])
    return job_id


def _rank(engine: sa.Engine, job_id: str) -> int:
    with engine.connect() as connection:
        job = jobs.find(connection, job_id)
    assert job is not None
    return job.rank


def _owners(engine: sa.Engine, count: int) -> str:
    return "".join(_go(engine)[0] for _ in range(count))


def test_one_owners_thousand_jobs_do_not_hold_up_anothers_one(engine: sa.Engine) -> None:
    many = [_add(engine, "a") for _ in range(1000)]
    assert _go(engine, end=False) == many[0]
    one = _add(engine, "b")
    assert [_go(engine) for _ in range(3)] == [many[1], one, many[2]]


def test_owners_with_many_jobs_go_by_turns(engine: sa.Engine) -> None:
    for owner in "aaaaaabbbbbb":
        _add(engine, owner)
    assert _owners(engine, 12) == "abababababab"


def test_jobs_of_one_owner_keep_their_order(engine: sa.Engine) -> None:
    added = [_add(engine, "a") for _ in range(5)]
    assert [_go(engine) for _ in range(5)] == added


def test_a_high_job_goes_before_what_waits_already(engine: sa.Engine) -> None:
    normal = [_add(engine, "a") for _ in range(3)]
    _go(engine, end=False)
    low, high = _add(engine, "a", "low"), _add(engine, "a", "high")
    assert [_go(engine) for _ in range(4)] == [high, normal[1], normal[2], low]


def test_priorities_share_sixteen_to_four_to_one(engine: sa.Engine) -> None:
    for priority in ("low", "normal", "high"):
        for _ in range(50):
            _add(engine, f"{priority[0]}", priority)
    first = _owners(engine, 21 * 3)
    assert {owner: first.count(owner) for owner in "hnl"} == {"h": 48, "n": 12, "l": 3}


def test_an_owner_who_sends_one_after_the_other_gets_every_second_turn(engine: sa.Engine) -> None:
    for _ in range(10):
        _add(engine, "a")
    gone = ""
    _add(engine, "b")
    for _ in range(8):
        gone += _go(engine)[0]
        if gone[-1] == "b":
            _add(engine, "b")
    assert gone == "abababab"


def test_a_low_job_is_not_starved_by_new_ones(engine: sa.Engine) -> None:
    low = _add(engine, "a", "low")
    gone = []
    for number in range(8):
        _add(engine, f"b{number}")
        gone.append(_go(engine, end=False))
    assert low in gone


def test_a_queue_without_a_worker_is_shared_as_well(engine: sa.Engine) -> None:
    for owner in "aaaa":
        _add(engine, owner)
    _owners(engine, 2)  # none is held now
    for owner in "bb":
        _add(engine, owner)
    assert _owners(engine, 4) == "abab"


def test_who_needs_no_camera_does_not_wait_for_what_a_camera_does(engine: sa.Engine) -> None:
    for _ in range(20):
        _add(engine, "a", camera="studio")
    for _ in range(10):
        _go(engine, camera="studio")
    held = _go(engine, end=False, camera="studio")
    waiting = [_add(engine, "b"), _add(engine, "b")]
    _go(engine, end=False)
    one = _add(engine, "c", "high")
    assert [_rank(engine, job_id) for job_id in (held, *waiting, one)] == [44, 4, 8, 5]
    assert _rank(engine, _add(engine, "c", camera="another")) == 8


def test_a_capture_that_waits_does_not_send_others_before_what_waits(engine: sa.Engine) -> None:
    _add(engine, "a", camera="studio")  # for hours, as one that is delayed
    jobs_of_b = [_add(engine, "b") for _ in range(4)]
    for _ in range(2):
        _go(engine)
    assert _rank(engine, _add(engine, "c")) == 12 == _rank(engine, jobs_of_b[2])


def test_a_burst_that_waits_for_its_camera_holds_up_no_upload_of_its_owner(
    engine: sa.Engine,
) -> None:
    for _ in range(10):
        _add(engine, "a", camera="studio")
    for owner in "bbba":
        _add(engine, owner)
    assert _owners(engine, 4) == "babb"


def test_owners_go_by_turns_at_a_camera_whose_pairs_no_worker_has(engine: sa.Engine) -> None:
    for _ in range(10):
        _add(engine, "a", camera="studio")
    _add(engine, "b", camera="studio")
    gone = ""
    for _ in range(6):
        gone += _go(engine, end=False, camera="studio")[0]
        if gone[-1] == "b":
            _add(engine, "b", camera="studio")
    assert gone == "ababab"


def test_ranks_start_again_when_the_queue_is_empty(engine: sa.Engine) -> None:
    for _ in range(5):
        _add(engine, "a")
    _owners(engine, 5)
    assert _rank(engine, _add(engine, "a")) == 4


@pytest.mark.parametrize("priority", ["high", "low"])
def test_ranks_end_where_the_queue_can_count_no_further(priority: str, engine: sa.Engine) -> None:
    first = _add(engine, "a")
    with engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(rank=MAX_RANK))
    second = _add(engine, "a", priority)
    assert _rank(engine, second) <= MAX_RANK
    assert {_go(engine), _go(engine)} == {first, second}
