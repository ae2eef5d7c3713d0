from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from service.api.context import Context
from service.cli import run
from service.dbos_queue import entries
from service.frames import FRAMES
from service.object_keys import describe_inputs, inputs_key
from service.rows import attempts, cameras, jobs, keys, tables
from service.rows.states import State
from service.settings import Settings
from tests.unit.service.asking import bearing, owner_of, queued, stored


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """The settings of the command, which reads them from the environment."""
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / "data"))
    return Settings()


@pytest.fixture(autouse=True)
def _a_job(context: Context) -> None:
    """One job of a pair, queued, with all that an operator may see."""
    for frame in FRAMES:
        context.storage.put(inputs_key("a", frame), frame.encode())
    values: dict[str, Any] = {
        "id": "a",
        "owner": "key1",
        "priority": "high",
        "options": {"lights": 2},
        "inputs": describe_inputs("a", dict.fromkeys(FRAMES, "digest")),
        "webhook": {"url": "https://example.org/done", "secret": "whsec_hidden"},
        "trace_id": "1" * 32,
        "request_hash": "",
    }
    with context.engine.begin() as connection:
        rank = jobs.add(connection, values)
        context.queue.submit(connection, "a", rank)


def _fail(context: Context) -> None:
    with context.engine.begin() as connection:
        held = attempts.claim(connection, "a", "w")
        assert held is not None
        assert attempts.fail(connection, held, {"type": "urn:lightlayers:problem:crashed"})


def test_jobs_of_all_owners_are_listed(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    other = {"id": "b", "owner": "", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        jobs.add(connection, other)
        held = attempts.claim(connection, "b", "w")
        assert held is not None
        attempts.report(connection, held, "align", 0.25)
    assert run(["jobs", "list"]) == 0
    lines = sorted(line.split() for line in capsys.readouterr().out.splitlines())
    assert [line[:2] for line in lines] == [["a", "queued"], ["b", "running"]]
    assert lines[0][-1] == "key1"
    assert lines[1][2:5] == ["align", "25%", "1"]
    assert run(["jobs", "list", "--state", "running"]) == 0
    assert [line[0] for line in capsys.readouterr().out.splitlines()] == ["b"]
    assert run(["jobs", "list", "--limit", "1"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_all_times_of_a_job_are_shown_as_dates(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    moments = ("created", "started", "finished", "deadline", "expires", "request_until", "eta")
    with context.engine.begin() as connection:
        known = {name: 86400.0 * day for day, name in enumerate(moments, 1)}
        connection.execute(sa.update(tables.jobs).values(known))
    assert run(["jobs", "show", "a"]) == 0
    job = json.loads(capsys.readouterr().out)
    assert {name: job[name] for name in moments} == {
        name: f"1970-01-0{day}T00:00:00+00:00" for day, name in enumerate(moments, 2)
    }


def test_a_job_is_shown_without_its_secrets(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["jobs", "show", "a"]) == 0
    said = capsys.readouterr().out
    assert "whsec" not in said
    job = json.loads(said)
    assert (job["id"], job["state"], job["owner"]) == ("a", "queued", "key1")
    assert job["webhook"] == {"url": "https://example.org/done"}
    assert job["created"].endswith("+00:00")


def test_a_failed_job_is_made_anew(context: Context, capsys: pytest.CaptureFixture[str]) -> None:
    _fail(context)
    assert run(["jobs", "retry", "a"]) == 0
    new_id = capsys.readouterr().out.strip()
    new, old = stored(context.engine, new_id), stored(context.engine, "a")
    assert (old.state, new.state) == (State.FAILED, State.QUEUED)
    assert (new.owner, new.priority, new.options) == ("key1", "high", {"lights": 2})
    assert new.webhook == old.webhook
    assert new.trace_id != old.trace_id
    assert new.inputs == describe_inputs(new_id, dict.fromkeys(FRAMES, "digest"))
    assert context.storage.get(inputs_key(new_id, "flash")) == b"flash"
    assert new_id in queued(context)


def test_a_captured_job_is_made_anew_with_its_pair(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = {"iso": 400, "f_number": 8.0}
    with context.engine.begin() as connection:
        camera = cameras.add(connection, "sim://studio")
        captured = {"camera": camera, "capture": {"camera": "sim://studio"}, "stored_bytes": 13}
        row = sa.update(tables.jobs).values(**captured, camera_settings=settings)
        connection.execute(row)
    _fail(context)
    assert run(["jobs", "retry", "a"]) == 0
    new_id = capsys.readouterr().out.strip()
    new = stored(context.engine, new_id)
    assert (new.capture, new.camera_settings) == ({"camera": "sim://studio"}, settings)
    assert (new.stored_bytes, new.inputs) == (
        len("no_flash") + len("flash"),
        describe_inputs(new_id, dict.fromkeys(FRAMES, "digest")),
    )
    with context.engine.connect() as connection:
        assert cameras.count_waiting(connection, camera) == 0
    assert new_id in queued(context)  # for a worker, and not for the camera


def test_a_job_beyond_the_quotas_of_its_owner_is_not_made_anew(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    owner = owner_of(bearing(context, "submit", jobs_per_day=0))
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(owner=owner))
    _fail(context)
    assert run(["jobs", "retry", "a"]) == 2
    assert "This key may make 0 jobs a day" in capsys.readouterr().err
    assert context.storage.list("jobs/") == [inputs_key("a", frame) for frame in sorted(FRAMES)]


def test_a_job_that_may_still_run_is_not_made_anew(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["jobs", "retry", "a"]) == 2
    assert "The job is queued" in capsys.readouterr().err
    with context.engine.connect() as connection:
        assert len(jobs.page(connection, None, 10)) == 1


def test_without_its_photographs_a_job_is_not_made_anew(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    _fail(context)
    context.storage.delete_below("jobs/a/inputs/flash")
    (context.settings.data_dir / "store" / inputs_key("a", "flash")).unlink(missing_ok=True)
    assert run(["jobs", "retry", "a"]) == 2
    assert "photographs of the job are removed" in capsys.readouterr().err
    assert len(context.storage.list("jobs")) == 1  # what was copied before is gone, too


def test_a_waiting_job_is_canceled(context: Context, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["jobs", "cancel", "a"]) == 0
    assert capsys.readouterr().out == "canceled\n"
    assert stored(context.engine, "a").state == State.CANCELED
    assert queued(context) == []


def test_a_canceled_job_is_kept_no_longer_than_others(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_RETENTION_DAYS", "2")
    assert run(["jobs", "cancel", "a"]) == 0
    job = stored(context.engine, "a")
    assert job.expires is not None and job.finished is not None
    assert job.expires - job.finished == pytest.approx(2 * 86400, abs=1)


def test_a_job_that_has_ended_asks_for_nothing_any_more(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["jobs", "cancel", "a"]) == 0
    assert run(["jobs", "confirm", "a"]) == 2
    assert "The job is canceled; it asks for nothing any more." in capsys.readouterr().err


def test_a_running_job_is_asked_to_stop(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    with context.engine.begin() as connection:
        attempts.claim(connection, "a", "w")
    assert run(["jobs", "cancel", "a"]) == 0
    assert capsys.readouterr().out == "canceling\n"


@pytest.mark.parametrize("job", ["nothing", "\udcff"])  # the second is no UTF-8
@pytest.mark.parametrize("command", ["show", "retry", "cancel", "confirm"])
def test_a_job_that_is_not_there_is_told(
    command: str, job: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["jobs", command, job]) == 2
    assert capsys.readouterr().err == f"There is no job {job!r}; it may have been deleted.\n"


def test_a_database_that_breaks_is_told(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    with context.engine.begin() as connection:
        connection.execute(sa.text("ALTER TABLE jobs RENAME TO gone"))
    assert run(["jobs", "list"]) == 1
    assert capsys.readouterr().err.startswith("The database of jobs does not answer")


def test_what_a_job_asks_for_is_shown_and_confirmed(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    with context.engine.begin() as connection:
        held = attempts.claim(connection, "a", "w")
        assert held is not None
        attempts.ask_operator(connection, held, "Switch the flash off, then confirm.", 60)
    assert run(["jobs", "list", "--state", "waiting_for_operator"]) == 0
    line, request = capsys.readouterr().out.splitlines()
    assert line.split()[:2] == ["a", "waiting_for_operator"]
    assert request == "  asks: Switch the flash off, then confirm."
    assert run(["jobs", "show", "a"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["request"] == "Switch the flash off, then confirm."
    assert shown["request_until"].endswith("+00:00")
    assert run(["jobs", "confirm", "a"]) == 0
    assert stored(context.engine, "a").state == State.RUNNING
    assert run(["jobs", "confirm", "a"]) == 2
    assert "it asks for nothing" in capsys.readouterr().err


@pytest.mark.parametrize("host", [None, "studio"])
def test_a_capture_that_failed_waits_for_its_camera_again(
    host: str | None, context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    row = {"id": "c", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        camera = cameras.add(connection, "sim://studio")
        jobs.add(connection, row | {"camera": camera, "capture": {"camera": "sim://studio"}})
        held = cameras.claim(connection, "c", "w")
        assert held is not None
        attempts.fail(connection, held, {"type": "urn:lightlayers:problem:camera-failed"})
        connection.execute(sa.update(tables.cameras).values(host=host))
    assert run(["jobs", "retry", "c"]) == 0
    new_id = capsys.readouterr().out.strip()
    with context.engine.connect() as connection:
        assert cameras.count_waiting(connection, camera) == 1
        queue = sa.text("SELECT queue_name FROM workflow_status WHERE workflow_uuid = :id")
        found = connection.execute(queue, {"id": entries.capture_id(new_id)}).scalar()
    assert found == entries.captures_on(host)


def test_jobs_are_looked_at_and_stopped_while_the_store_is_away(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", "file:///dev/null/store")
    for command in (["list"], ["show", "a"], ["cancel", "a"]):
        assert run(["jobs", *command]) == 0
    assert run(["jobs", "retry", "a"]) == 2
    assert "LIGHTLAYERS_STORE_URL" in capsys.readouterr().err


@pytest.mark.parametrize("limit", ["0", "1000001", "9" * 30, "many"])
def test_a_number_of_jobs_that_cannot_be_is_told(
    limit: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["jobs", "list", "--limit", limit]) == 2
    assert capsys.readouterr().err.startswith("Invalid value for '--limit': ")


def test_a_state_that_there_is_not_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["jobs", "list", "--state", "bad"]) == 2
    assert capsys.readouterr().err.startswith("Invalid value for '--state': 'bad' is not one of ")


def _ids(context: Context) -> list[str]:
    with context.engine.connect() as connection:
        return sorted(job.id for job in jobs.page(connection, None, 10))


def _refused(context: Context, capsys: pytest.CaptureFixture[str]) -> str:
    """Retry the job in vain; what is said. Nothing is stored for the job that was not made."""
    assert run(["jobs", "retry", "a"]) == 2
    assert _ids(context) == ["a"]
    assert context.storage.list("jobs/") == [inputs_key("a", frame) for frame in sorted(FRAMES)]
    return capsys.readouterr().err


def test_options_that_a_job_cannot_have_any_more_are_told_at_once(
    context: Context, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(options={"neutral": "D655"}))
    _fail(context)
    assert _refused(context, capsys) == (
        "neutral: No neutral light spectrum is called 'D655': near names are D65, D55, ID65, D75.\n"
    )


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("QUEUED_JOBS", "1", "1 job waits already"),
        ("QUEUED_JOBS_PER_KEY", "1", "1 job of yours waits already"),
        ("FREE_BYTES", str(10**18), "The store of photographs is nearly full"),
    ],
)
def test_a_job_for_which_there_is_no_room_is_not_made_anew(
    name: str,
    value: str,
    said: str,
    context: Context,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _fail(context)
    other = {"id": "b", "owner": "key1", "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        jobs.add(connection, other)
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", value)
    assert run(["jobs", "retry", "a"]) == 2
    assert said in capsys.readouterr().err
    assert _ids(context) == ["a", "b"]


def test_a_mix_of_what_cannot_be_mixed_is_not_made_anew(
    context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"kind": "mix", "of": "a", "mix": {"lamps": [{}]}}
    mix = {"id": "m", "options": options, "trace_id": "1" * 32, "request_hash": ""}
    with context.engine.begin() as connection:
        jobs.add(connection, mix)
        jobs.request_cancel(connection, "m")
    assert run(["jobs", "retry", "m"]) == 2
    assert "The job is queued; results are there once it is succeeded." in capsys.readouterr().err
    _fail(context)
    assert run(["jobs", "retry", "m"]) == 2
    assert (
        "The job is failed; its `error` says why, and there will be no results"
        in capsys.readouterr().err
    )
    with context.engine.begin() as connection:
        connection.execute(sa.delete(tables.jobs).where(tables.jobs.c.id == "a"))
    assert run(["jobs", "retry", "m"]) == 2
    assert "There is no job 'a'" in capsys.readouterr().err
    assert _ids(context) == ["m"]


@pytest.mark.parametrize(
    ("name", "value", "row", "said"),
    [
        ("WEBHOOK_HTTPS", "true", {"webhook": {"url": "http://example.org/"}}, "webhook.url: "),
        ("CAMERAS", "ptp+usb://", {"capture": {"camera": "sim://studio"}}, "This camera is none"),
        (
            "CAMERAS",
            "sim://",
            {"capture": {"camera": "sim://studio", "flash": "external"}},
            "flash: this service has no switch for a flash",
        ),
    ],
)
def test_what_settings_have_come_to_forbid_is_not_reached_by_a_job_made_anew(
    name: str,
    value: str,
    row: dict[str, Any],
    said: str,
    context: Context,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    untaken = {"inputs": None} if "capture" in row else {}
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(row | untaken))
    _fail(context)
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", value)
    assert _refused(context, capsys).startswith(said)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ({}, "none like it may have its webhook told; make one with a key that is good.\n"),
        (
            {"webhook": None, "inputs": None, "capture": {"camera": "sim://studio"}},
            "none like it may use its camera; make one with a key that is good.\n",
        ),
        ({"webhook": None}, None),
    ],
)
def test_a_key_that_has_ended_reaches_nothing_by_a_job_made_anew(
    row: dict[str, Any], said: str | None, context: Context, capsys: pytest.CaptureFixture[str]
) -> None:
    owner = owner_of(bearing(context, "submit", "capture"))
    with context.engine.begin() as connection:
        connection.execute(sa.update(tables.jobs).values(row | {"owner": owner}))
        assert not keys.has_ended(connection, owner)
        keys.revoke(connection, owner)
        assert keys.has_ended(connection, owner)
    _fail(context)
    if said is None:
        assert run(["jobs", "retry", "a"]) == 0
    else:
        assert _refused(context, capsys).endswith(said)
