from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import sqlalchemy as sa

from pipeline.options import Spectrum
from pipeline.taken_with import TakenWith
from service.rows import jobs, kept, tables
from service.rows.jobs import Job
from tests.plans import plans

TAKEN = {"make": "NIKON", "model": "D5100", "body": "", "rendered": False}
Make = Callable[..., Job]


@pytest.fixture
def make(engine: sa.Engine) -> Make:
    """Add a calibration that has succeeded at the second `at`."""

    def add(name: str, at: int, **more: Any) -> Job:
        options = {"kind": "flash", "setup": "default", **more.pop("options", {})}
        values = {
            "id": name,
            "options": options,
            "likeness": f"calibrate-{options['kind']}",
            "inputs": {"camera": TAKEN},
            "trace_id": "1" * 32,
            "request_hash": "",
            **more,
        }
        with engine.begin() as connection:
            jobs.add(connection, values)
            ended = {"state": "succeeded", "created": at, "finished": at + 5, "attempt": 1}
            table = tables.jobs
            connection.execute(
                table.update().where(table.c.id == name).values({**ended, **more.get("end", {})})
            )
            job = jobs.find(connection, name)
        assert job is not None
        return job

    return add


def _names(engine: sa.Engine, make: Make, **options: Any) -> list[str]:
    """What a separation of these options is given."""
    job = make("separation", 9_999, likeness="separate-", options={"kind": None, **options})
    with engine.connect() as connection:
        return sorted(row.id for row in kept.for_separation(connection, job))


def test_the_newest_of_each_kind_and_camera_is_given(engine: sa.Engine, make: Make) -> None:
    make("old", 100)
    make("new", 200)
    make("lamps", 50, options={"kind": "lamps"})
    make("other", 60, inputs={"camera": {**TAKEN, "model": "D850"}})
    assert _names(engine, make, setup="default") == ["lamps", "new", "other"]


def test_once_the_newest_is_deleted_the_one_before_is_given(engine: sa.Engine, make: Make) -> None:
    make("old", 100)
    make("new", 200)
    with engine.begin() as connection:
        connection.execute(tables.jobs.delete().where(tables.jobs.c.id == "new"))
    assert _names(engine, make, setup="default") == ["old"]


def test_a_set_up_has_its_own(engine: sa.Engine, make: Make) -> None:
    make("default", 100)
    make("table", 100, options={"setup": "table"})
    make("none", 100, options={"setup": "none"})
    assert _names(engine, make, setup="table") == ["table"]


def test_without_a_set_up_it_is_the_default(engine: sa.Engine, make: Make) -> None:
    make("default", 100)
    make("table", 100, options={"setup": "table"})
    job = make("separation", 300, likeness="separate-")
    del job.options["setup"]
    with engine.connect() as connection:
        assert [row.id for row in kept.for_separation(connection, job)] == ["default"]


def test_none_goes_without(engine: sa.Engine, make: Make) -> None:
    make("default", 100)
    make("none", 100, options={"setup": "none"})
    assert _names(engine, make, setup="none") == []


def test_those_of_others_and_those_not_made_are_left(engine: sa.Engine, make: Make) -> None:
    make("theirs", 100, owner="another")
    make("nameless", 100, options={"setup": None})
    assert _names(engine, make, setup="default") == []


def test_a_calibration_tells_its_camera_and_when_it_was_made(make: Make) -> None:
    one = kept.made_of(make("a", 1_000_000_000), b"wavelength_nm,power\n400,1\n700,2\n")
    assert (one.kind, one.setup, one.name) == ("flash", "default", "a")
    assert one.made == "2001-09-09T01:46:45+00:00"  # when it ended
    assert one.taken_with == TakenWith(make="NIKON", model="D5100")
    value = one.value()
    assert isinstance(value, Spectrum)
    assert value.power == [1.0, 2.0]


def test_a_camera_that_was_not_noted_fits_nothing(make: Make) -> None:
    unknown = kept.taken_with(make("a", 1, inputs={}))
    assert unknown == TakenWith()
    assert not unknown.fits(TakenWith.model_validate(TAKEN), "flash")


@pytest.mark.parametrize("setup", [None, "default"])
def test_calibrations_are_found_by_their_index(engine: sa.Engine, setup: str | None) -> None:
    with engine.connect() as connection, plans(engine) as found:
        assert jobs.kept_calibrations(connection, "a", setup) == []
    (plan,) = found
    assert len(plan.splitlines()) == 1  # no sort
    assert "USING INDEX jobs_that_calibrate" in plan


def test_the_camera_of_a_calibration_is_found_where_it_was_noted(make: Make) -> None:
    noted = kept.with_camera({"flash": {"key": "k"}}, TAKEN)
    assert noted["flash"] == {"key": "k"}
    assert kept.taken_with(make("noted", 1, inputs=noted)) == TakenWith.model_validate(TAKEN)
