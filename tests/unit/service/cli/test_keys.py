from __future__ import annotations

import json
from pathlib import Path

import httpx
import pytest

from service.api.context import Context
from service.cli import run
from service.cli.keys import key_of_requests
from service.rows import keys
from tests.unit.service.asking import bearing

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _own_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / "data"))


def test_keys_are_made_listed_and_revoked(capsys: Captured) -> None:
    quotas = ["--waiting-jobs", "2", "--jobs-per-day", "30", "--stored-bytes", "4000"]
    assert run(["keys", "create", "phone", "--scopes", "read, admin", *quotas, "--days", "1"]) == 0
    said = capsys.readouterr()
    text = said.out.strip()
    assert keys.is_key(text) and text not in said.err
    assert run(["keys", "list", "--json"]) == 0
    listed = capsys.readouterr().out
    (told,) = json.loads(listed)
    assert text[14:] not in listed
    assert told.pop("created") < told.pop("expires")
    assert told == {
        "id": text[3:13],
        "name": "phone",
        "scopes": ["admin", "read"],
        "waiting_jobs": 2,
        "jobs_per_day": 30,
        "stored_bytes": 4000,
        "revoked": None,
        "used": None,
    }
    assert run(["keys", "revoke", text[3:13]]) == 0
    assert text[3:13] in capsys.readouterr().out
    assert run(["keys", "list"]) == 0
    shown = capsys.readouterr().out
    assert text[3:13] in shown and "revoked" in shown


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["create"], "Missing argument"),
        (["create", ""], "NAME"),
        (["create", "a\x1b[2Jb"], "NAME"),
        (["create", "x" * 101], "NAME"),
        (["create", "x", "--scopes", "root"], "there is no 'root'"),
        (["create", "x", "--scopes", ""], "there is no ''"),
        (["create", "x", "--days", "-1"], "--days"),
        (["create", "x", "--days", "nan"], "--days"),
        (["create", "x", "--waiting-jobs", "0"], "waiting-jobs"),
        (["create", "x", "--waiting-jobs", str(2**31)], "waiting-jobs"),
        (["create", "x", "--jobs-per-day", str(2**31)], "jobs-per-day"),
        (["create", "x", "--stored-bytes", str(2**63)], "stored-bytes"),
        (["revoke", "nothing"], "no key of this ID"),
        (["revoke", "\udcff"], "no key of this ID"),
    ],
)
def test_what_cannot_be_done_is_one_sentence(
    arguments: list[str], words: str, capsys: Captured
) -> None:
    assert run(["keys", *arguments]) == 2
    said = capsys.readouterr()
    assert words in said.err and len(said.err.splitlines()) == 1 and said.out == ""


def test_a_key_comes_from_a_file_or_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    assert key_of_requests(None) is None
    run(["keys", "create", "phone"])
    text = capsys.readouterr().out
    (tmp_path / "key").write_text(text)
    assert key_of_requests(tmp_path / "key") == text.strip()
    monkeypatch.setenv("LIGHTLAYERS_KEY", text)
    assert key_of_requests(None) == text.strip()


def test_what_is_no_key_is_not_sent_nor_shown(
    pair: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Captured
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_KEY", "hush\r\nX-Other: 1")
    assert run(["submit", *pair, "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "LIGHTLAYERS_KEY holds no key" in said and "hush" not in said


def test_a_service_that_needs_a_key_says_so_to_the_command(
    pair: list[str], tmp_path: Path, http: httpx.Client, context: Context, capsys: Captured
) -> None:
    bearing(context, "read")
    out = ["-o", str(tmp_path / "out"), "--url", str(http.base_url)]
    assert run(["submit", *pair, *out]) == 2
    said = capsys.readouterr().err
    assert "This service needs a key" in said and "commands have it in LIGHTLAYERS_KEY" in said
