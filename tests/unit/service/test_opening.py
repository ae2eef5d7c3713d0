from __future__ import annotations

from pathlib import Path

import psycopg.errors
import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from service.cli import run
from service.errors import StartError
from service.opening import open_database, open_storage
from service.settings import Settings


def test_a_new_database_has_the_tables_of_jobs_and_queue(tmp_path: Path) -> None:
    engine = open_database(Settings(data_dir=tmp_path / "data"))
    tables = set(sa.inspect(engine).get_table_names())
    engine.dispose()
    assert {"jobs", "workers", "workflow_status"} <= tables


@pytest.mark.parametrize(
    "url",
    [
        "nonsense",
        "mysql://nowhere/x",
        "postgresql://user:secret@127.0.0.1:1/x",
        "postgresql://user:secret@127.0.0.1:port/x",
        "postgresql://user:secret@[::1/x",
        "postgresql://user:@secret:secret@host:secret/x",
        "sqlite:////dev/null/x.sqlite",
    ],
)
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # what a failed connection leaves behind
def test_a_database_that_cannot_be_opened_is_told(url: str, tmp_path: Path) -> None:
    with pytest.raises(StartError, match="LIGHTLAYERS_DATABASE_URL") as caught:
        open_database(Settings(data_dir=tmp_path, database_url=url))
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_database_whose_disk_is_full_is_told_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = sa.exc.OperationalError("x", None, psycopg.errors.DiskFull("no space"))

    def connect(_url: str) -> sa.Engine:
        raise full

    monkeypatch.setattr("service.opening.database.connect", connect)
    with pytest.raises(StartError) as caught:
        open_database(Settings(data_dir=tmp_path))
    assert str(caught.value) == "The disk of the database of jobs is full: make room on it."


@pytest.mark.parametrize(
    "url",
    [
        "nonsense",
        "mysql://x",
        "sqlite+nothing:///x",
        "sqlite://",
        "sqlite:///:memory:",
        "postgresql://user:secret@127.0.0.1:port/x",
        "postgresql://user:a@secret@127.0.0.1/x",
    ],
)
def test_an_address_of_no_database_that_is_known_says_what_one_is_like(
    url: str, tmp_path: Path
) -> None:
    with pytest.raises(StartError) as caught:
        open_database(Settings(data_dir=tmp_path, database_url=url))
    assert str(caught.value) == (
        "The address in LIGHTLAYERS_DATABASE_URL cannot be used: write one like sqlite:///file or "
        "postgresql://user:password@host/name, with @ : / of the password as %40 %3A %2F."
    )


@pytest.mark.parametrize(
    "url", ["nonsense", "ftp://nowhere/x", "file:///dev/null/x", "s3://id:secret@b/\\"]
)
def test_a_store_that_cannot_be_opened_is_told(url: str, tmp_path: Path) -> None:
    with pytest.raises(StartError, match="LIGHTLAYERS_STORE_URL") as caught:
        open_storage(Settings(data_dir=tmp_path, store_url=url))
    assert "secret" not in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("mark", ["?", "#", "#shots/store", "?shots/store"])
@pytest.mark.parametrize("place", ["file://{}/photographs", "s3://bucket/photographs"])
def test_a_store_is_never_another_folder_than_was_written(
    place: str, mark: str, tmp_path: Path
) -> None:
    """What follows these marks is no part of a URL's path, and was left out."""
    with pytest.raises(StartError) as caught:
        open_storage(Settings(data_dir=tmp_path, store_url=place.format(tmp_path) + mark))
    assert str(caught.value) == (
        "The store of photographs cannot be opened: check LIGHTLAYERS_STORE_URL and the AWS_ "
        "variables (write ? and # in it as %3F and %23)."
    )
    assert list(tmp_path.iterdir()) == []


def test_a_data_folder_may_have_any_name(tmp_path: Path) -> None:
    data_dir = tmp_path / "a #1? 100%"
    open_storage(Settings(data_dir=data_dir)).put("a", b"light")
    assert (data_dir / "store" / "a").read_bytes() == b"light"


@pytest.mark.parametrize(
    "url",
    ["memory:///", "gs://bucket", "s3:///x", "file:folder", "file://folder/store", "/folder"],
)
def test_a_store_of_another_kind_says_what_one_is_like(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StartError) as caught:
        open_storage(Settings(data_dir=tmp_path, store_url=url))
    assert str(caught.value) == (
        "The store of photographs cannot be opened: check LIGHTLAYERS_STORE_URL and the AWS_ "
        "variables (it is like file:///folder or s3://bucket/prefix)."
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"])
def test_a_store_with_half_of_its_credentials_names_both(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for other in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(other, raising=False)
    monkeypatch.setenv(name, "half")
    with pytest.raises(StartError) as caught:
        open_storage(Settings(data_dir=tmp_path, store_url="s3://photographs"))
    assert str(caught.value) == (
        "The store of photographs that LIGHTLAYERS_STORE_URL names is given no credentials: set "
        "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY."
    )


def test_a_store_without_credentials_names_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(_storage: object) -> None:
        raise GenericError("Error performing PUT http://169.254.169.254/latest/api/token in 2 ms")

    monkeypatch.setattr("service.opening.Storage.check", check)
    with pytest.raises(StartError, match="no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_"):
        open_storage(Settings(data_dir=tmp_path, store_url="s3://photographs"))


@pytest.mark.parametrize("name", ["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT"])
@pytest.mark.parametrize(
    "address",
    ["", "store:8333", "https://", "ftp://store", "http://a b", "https://h:99999", "https://[::1"],
)
def test_a_stores_endpoint_that_is_no_address_is_named(
    address: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, address)
    with pytest.raises(StartError) as caught:
        open_storage(Settings(data_dir=tmp_path, store_url="s3://photographs"))
    assert str(caught.value) == (
        f"{name} is no address of a store: write one like https://host:port, or leave it out."
    )
    open_storage(Settings(data_dir=tmp_path, store_url=(tmp_path / "store").as_uri()))


def test_a_store_without_tls_names_what_allows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in {
        "AWS_ENDPOINT_URL": "http://127.0.0.1:1",
        "AWS_REGION": "us-east-1",
        "AWS_ACCESS_KEY_ID": "id",
        "AWS_SECRET_ACCESS_KEY": "secret",
    }.items():
        monkeypatch.setenv(name, text)
    monkeypatch.delenv("AWS_ALLOW_HTTP", raising=False)
    with pytest.raises(StartError) as caught:
        open_storage(Settings(data_dir=tmp_path, store_url="s3://photographs"))
    assert str(caught.value) == (
        "The store of photographs is reached by plain HTTP, which has to be allowed: set "
        "AWS_ALLOW_HTTP=true."
    )


@pytest.mark.parametrize("command", ["serve", "worker"])
def test_a_service_that_cannot_start_says_why(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / "file"))
    monkeypatch.setenv("LIGHTLAYERS_PORT", "0")
    assert run([command]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert "LIGHTLAYERS_DATA_DIR" in said[0]
