from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
import sqlalchemy as sa

from service import migrations
from service.api.context import Context
from service.doctor.finding import Finding
from service.opening import WRONG_ADDRESS, open_database
from service.rows import clock, database, keys
from service.settings import Settings
from tests.unit.service.findings import Look


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # what a failed connection leaves behind
def test_a_database_that_is_away_is_told(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", "postgresql://u:secret@127.0.0.1:1/x")
    found = look()["database"]
    assert found.grade == "wrong"
    assert "start it, or correct LIGHTLAYERS_DATABASE_URL" in found.sentence
    assert "secret" not in found.sentence


@pytest.mark.parametrize(
    "url",
    [
        "nonsense",
        "mysql://x",
        "postgresql://u:secret@h:port/x",
        "sqlite://",
        "sqlite:///:memory:",
    ],
)
def test_an_address_of_no_database_that_processes_can_share_is_told(
    url: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", url)
    found = look()["database"]
    assert (found.grade, found.sentence) == ("wrong", WRONG_ADDRESS)


def test_a_folder_in_the_database_s_place_is_told(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", f"sqlite:///{tmp_path}")
    found = look()["database"]
    assert found.grade == "wrong"
    assert "unable to open database file" in found.sentence


def test_an_older_schema_is_told_and_left_alone(look: Look, settings: Settings) -> None:
    engine = database.connect(settings.database_url)
    migrations.upgrade(engine, "0001")
    found = look()["database"]
    assert (found.grade, "run `lightlayers migrate`" in found.sentence) == ("wrong", True)
    with pytest.raises(migrations.SchemaError, match="schema 0001"):
        migrations.check(engine)
    engine.dispose()


@pytest.mark.usefixtures("context")
def test_a_service_without_workers_is_told(look: Look) -> None:
    found = look()["workers"]
    assert (found.grade, "lightlayers worker" in found.sentence) == ("wrong", True)


def test_a_service_that_lacks_a_key_is_told(
    look: Look, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert look()["keys"] == Finding("ok", "keys", "none is needed to start.")
    monkeypatch.setenv("LIGHTLAYERS_KEYS", "required")
    assert look()["keys"].grade == "wrong"  # before the first start
    engine = open_database(settings)
    assert "lightlayers keys create" in look()["keys"].sentence
    with engine.begin() as connection:
        keys.create(connection, "phone", {keys.Scope.READ}, keys.Quotas(), None)
    engine.dispose()
    assert look()["keys"] == Finding("ok", "keys", "there is one.")


def test_a_clock_that_is_off_is_told(
    look: Look, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    with context.engine.begin() as connection:
        ahead = connection.execute(sa.select(clock.now())).scalar_one() + 1000
    monkeypatch.setattr("service.doctor.database.time", SimpleNamespace(time=lambda: ahead))
    found = look()["clock"]
    assert found.grade == "wrong"
    assert re.search("by (1000|9[0-9]{2}) s", found.sentence)  # the database's goes on
