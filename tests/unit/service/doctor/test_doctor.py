from __future__ import annotations

from pathlib import Path

import psycopg.errors
import pytest
import sqlalchemy as sa

from service import migrations
from service.cli import run
from service.errors import StorageFullError
from tests.unit.service.at_first import raising
from tests.unit.service.findings import Look


@pytest.mark.usefixtures("worker")
def test_a_service_that_works_has_nothing_wrong(
    look: Look, capsys: pytest.CaptureFixture[str]
) -> None:
    found = look()
    assert [part for part, finding in found.items() if finding.grade == "wrong"] == []
    assert found["database"].sentence == f"it answers, at schema {migrations.newest()}."
    assert found["workers"].sentence.startswith("1 live")
    parts = {"clock", "store", "store's disk", "disk", "memory", "ulimits", "kernels", "port"}
    assert parts <= set(found)
    assert run(["doctor"]) == 0
    assert "\nok     clock: it agrees" in capsys.readouterr().out


def test_before_the_first_start_only_the_start_is_missing(look: Look) -> None:
    found = look()
    assert found["database"].grade == "note"
    assert found["data_dir"].grade == "ok"  # it makes the folder, for its user alone
    assert "wrong" not in {finding.grade for finding in found.values()}


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("LIGHTLAYERS_DATABSE_URL", "did you mean LIGHTLAYERS_DATABASE_URL?"),
        ("LIGHTLAYERS_QQQQ", "is no setting; take it out."),
    ],
)
def test_a_mistyped_variable_is_named(
    name: str,
    advice: str,
    look: Look,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv(name, "x")
    assert look()["variables"].grade == "wrong"
    assert run(["doctor"]) == 1
    said = capsys.readouterr().out
    assert f"wrong  variables: {name} is no setting" in said
    assert advice in said


def test_the_variables_of_other_parts_are_known(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    assert look()["variables"].grade == "ok"


def test_a_folder_of_spectra_that_is_not_there_is_told(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path / "nowhere"))
    found = look()["variables"]
    assert (found.grade, found.sentence) == (
        "wrong",
        "LIGHTLAYERS_SPECTRA names no folder of this host, so that a worker here fails each "
        "separation: set it to one with spectra.",
    )


@pytest.mark.parametrize("text", ["abc", "0", "nan"])
def test_a_limit_of_pixels_that_is_no_number_is_told(
    text: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_MAX_PIXELS", text)
    found = look()["variables"]
    assert (found.grade, found.sentence) == (
        "wrong",
        f"LIGHTLAYERS_MAX_PIXELS is '{text}': set it to a number of pixels.",
    )


def test_a_value_out_of_range_ends_the_examination(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_WORKER_CONCURRENCY", "0")
    found = look()
    assert found["settings"].grade == "wrong"
    assert "worker_concurrency" in found["settings"].sentence
    assert "store" not in found


def test_full_disks_are_findings_among_others(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    full = sa.exc.OperationalError("x", None, psycopg.errors.DiskFull("no space"))
    look()
    monkeypatch.setattr("service.doctor.database.is_missing_file", lambda _url: False)
    monkeypatch.setattr("service.doctor.database.migrations.check", raising(full))
    monkeypatch.setattr(
        "service.storage.folder.FolderStorage.put", raising(StorageFullError("It is full."))
    )
    found = look()
    assert (found["database"].grade, found["database"].sentence) == (
        "wrong",
        "The disk of the database of jobs is full: make room on it.",
    )
    assert (found["store"].grade, found["store"].sentence) == ("wrong", "It is full.")
    assert found["memory"].grade == "ok"
