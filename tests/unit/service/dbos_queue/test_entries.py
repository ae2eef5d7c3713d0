from __future__ import annotations

from service.dbos_queue import entries


def test_an_id_in_the_queue_of_jobs_tells_the_job_and_how_often_it_was_put_back() -> None:
    ids = [entries.run_id("a1", again) for again in (0, 1, 30)]
    assert ids == ["a1", "a1-again-1", "a1-again-30"]
    assert [entries.times_put_back(queued) for queued in ids] == [0, 1, 30]
    held = [entries.Held(queued, "w", entries.JOBS) for queued in ids]
    assert {(one.job, one.work, one.runs) for one in held} == {("a1", "a1", True)}
    capture = entries.Held(entries.capture_id("a1"), "w", entries.CAPTURES)
    assert (capture.job, capture.work) == ("a1", "a1-capture")
