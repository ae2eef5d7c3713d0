from __future__ import annotations

import asyncio

import obstore
import pytest
from obstore.exceptions import GenericError
from obstore.store import S3Store

from service.errors import StorageFullError
from service.storage.base import Storage
from service.storage.by_url import storage_at
from tests.unit.service.at_first import raising


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Storage:
    """Storage in S3 whose server is asked for nothing, and is looked at at once."""
    monkeypatch.setenv("AWS_SKIP_SIGNATURE", "true")
    monkeypatch.setattr("service.storage.bucket._LOOK_SECONDS", 0.0)
    return storage_at("s3://photographs")


def test_a_put_goes_on_while_the_store_answers(
    bucket: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However slow the line is."""
    stored: dict[str, bytes] = {}
    looks: list[float] = []

    async def put(_store: object, key: str, data: bytes, **_named: object) -> None:
        while len(looks) < 20:
            await asyncio.sleep(0)
        stored[key] = data

    async def check_within(seconds: float) -> None:
        looks.append(seconds)

    monkeypatch.setattr(obstore, "put_async", put)
    monkeypatch.setattr(bucket, "check_within", check_within)
    bucket.put("jobs/1/1/layers.exr", b"light")
    assert stored == {"jobs/1/1/layers.exr": b"light"}
    assert set(looks) == {45.0}


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Keys of puts that were ended; by themselves they have no end."""
    keys: list[str] = []

    async def put(_store: object, key: str, _data: bytes, **_named: object) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            keys.append(key)

    monkeypatch.setattr(obstore, "put_async", put)
    return keys


def test_a_put_ends_when_the_store_is_silent(
    bucket: Storage, ended: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def check_within(seconds: float) -> None:
        raise GenericError(f"no answer within {seconds:g} s")

    monkeypatch.setattr(bucket, "check_within", check_within)
    with pytest.raises(GenericError, match="no answer within 45 s"):
        bucket.put("jobs/1/1/layers.exr", b"light")
    assert ended == ["jobs/1/1/layers.exr"]


def test_a_put_ends_when_it_is_wanted_no_more(
    bucket: Storage, ended: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def check_within(_seconds: float) -> None:
        await asyncio.Event().wait()

    monkeypatch.setattr("service.storage.bucket._CHECK_SECONDS", 0.0)
    monkeypatch.setattr(bucket, "check_within", check_within)
    with pytest.raises(InterruptedError):
        bucket.put("a", b"light", check=raising(InterruptedError()))
    assert ended == ["a"]


def test_what_a_put_says_itself_goes_before_a_store_that_is_silent(
    bucket: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked = asyncio.Event()

    async def put(*_arguments: object, **_named: object) -> None:
        await looked.wait()
        raise GenericError("Server returned 507 Insufficient Storage")

    async def check_within(_seconds: float) -> None:
        looked.set()
        await asyncio.sleep(0.01)
        raise GenericError("no answer")

    monkeypatch.setattr(obstore, "put_async", put)
    monkeypatch.setattr(bucket, "check_within", check_within)
    with pytest.raises(StorageFullError):
        bucket.put("a", b"light")


def test_a_part_may_take_minutes_and_no_other_option_of_the_store_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    used: list[dict[str, str]] = []

    async def put(store: S3Store, *_arguments: object, **_named: object) -> None:
        used.append(dict(store.client_options or {}))  # type: ignore[arg-type]

    monkeypatch.setattr(obstore, "put_async", put)
    monkeypatch.setenv("AWS_ALLOW_HTTP", "true")
    monkeypatch.setenv("AWS_PROXY_URL", "http://proxy")
    monkeypatch.delenv("AWS_USER_AGENT", raising=False)
    storage_at("s3://photographs").put("a", b"light")
    expected = {"allow_http": "true", "proxy_url": "http://proxy", "timeout": "10m"}
    assert used == [expected]
