from __future__ import annotations

import asyncio
import json
import shutil
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from obstore.exceptions import GenericError

from service import belonging
from service.api import create_app
from service.api.context import Context
from service.errors import StartError
from service.opening import open_database
from service.rows import keys
from service.serve import _remove_expired, _Server, serve
from service.settings import Settings
from service.storage.base import Storage
from tests.ports import free_port
from tests.unit.service.at_first import raising
from tests.unit.service.full_disk import full_disk
from tests.unit.service.upload_rows import added


def test_a_port_in_use_is_told(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        settings = Settings(data_dir=tmp_path / "data", port=other.getsockname()[1])
        with pytest.raises(StartError, match="cannot be listened on: address already in use"):
            serve(settings, worker=False)
    assert not (tmp_path / "data").exists()


def test_a_worker_has_a_port_of_its_own_for_metrics(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    settings = Settings(data_dir=tmp_path, port=port, metrics_port=port - 1)

    with pytest.raises(StartError, match=f"port {port}, one above"):
        serve(settings, worker=True)


@pytest.mark.parametrize("host", ["300.1.1.1", "no host", "192.0.2.1", "2001:db8::1"])
def test_an_address_that_is_not_this_machines_is_told(host: str, tmp_path: Path) -> None:
    with pytest.raises(StartError, match="give another --port or --host"):
        serve(Settings(data_dir=tmp_path, host=host, port=0), worker=False)


@pytest.mark.parametrize(
    "chosen", [{"host": "0.0.0.0"}, {"host": "::"}, {"host": "127.0.0.1", "keys": "required"}]
)
def test_a_service_that_needs_keys_does_not_start_without_one(
    chosen: dict[str, Any], tmp_path: Path
) -> None:
    with pytest.raises(StartError, match="lightlayers keys create"):
        serve(Settings(data_dir=tmp_path, port=0, **chosen), worker=False)


def test_a_revoked_key_is_none_to_start_with(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, port=0, keys="required")
    engine = open_database(settings)
    with engine.begin() as connection:
        text = keys.create(connection, "old", {keys.Scope.READ}, keys.Quotas(), None)
        keys.revoke(connection, keys.id_of(text))
    engine.dispose()
    with pytest.raises(StartError, match="none that is good"):
        serve(settings, worker=False)


@pytest.mark.parametrize(("stop", "code"), [(SystemExit(0), 0), (KeyboardInterrupt(), 130)])
def test_a_stop_waits_for_no_thread_that_a_store_holds_up(
    stop: BaseException, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codes: list[int] = []
    monkeypatch.setattr(_Server, "run", raising(stop))
    monkeypatch.setattr("service.serve.os._exit", codes.append)
    monkeypatch.setattr("service.serve.logging.shutdown", lambda: None)
    monkeypatch.setattr("service.serve.signal.signal", lambda *_: None)
    monkeypatch.setattr("service.serve.logs.configure", lambda: None)
    serve(Settings(data_dir=tmp_path, port=0), worker=False)
    assert codes == [code]


@pytest.mark.parametrize("hindered", ["the database's disk is full", "the store is away"])
def test_uploads_that_cannot_be_removed_keep_no_service_from_starting(
    hindered: str,
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    if hindered == "the store is away":
        monkeypatch.setattr(Storage, "folders", raising(GenericError("the store is away")))
    added(context.engine, "over", 6, seconds=-3601)
    with full_disk(context.engine):
        _remove_expired(context)
    (record,) = caplog.records
    assert record.getMessage().startswith("uploads that have expired stay until the next sweep: ")


def test_a_store_is_its_databases_from_the_first_start(context: Context) -> None:
    _remove_expired(context)
    assert context.storage.list("") == ["database-id"]
    assert belonging.standing(context.engine, context.storage) == "ours"


def test_a_start_beside_the_store_of_another_database_removes_nothing(context: Context) -> None:
    context.storage.put("uploads/anothers/000-x", b"light")
    _remove_expired(context)
    assert context.storage.list("") == ["uploads/anothers/000-x"]


def test_a_service_that_would_refuse_every_job_does_not_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage("/")
    monkeypatch.setattr("shutil.disk_usage", lambda _path: usage._replace(total=10**9))
    with pytest.raises(StartError) as caught:
        serve(Settings(data_dir=tmp_path, port=0, free_bytes=10**9 + 1), worker=False)
    assert str(caught.value) == (
        "LIGHTLAYERS_FREE_BYTES is 1000000001, and the store's disk has 1000000000 in all, so that "
        "every job would be refused: set less, or put the store on a larger disk."
    )


def test_a_variable_that_is_no_setting_is_told_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_JOB_SECOND", "secret")
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / "file"))
    (tmp_path / "file").write_text("no folder, so that both end at once")
    for command in (["serve", "--port", str(free_port())], ["worker"]):
        done = subprocess.run(
            [sys.executable, "-m", "service.cli", *command], capture_output=True, text=True
        )
        line = json.loads(done.stderr.splitlines()[0])
        assert (line["level"], line["message"]) == (
            "warning",
            "LIGHTLAYERS_JOB_SECOND is no setting; did you mean LIGHTLAYERS_JOB_SECONDS?",
        )
        assert "secret" not in done.stderr


def test_a_worker_is_told_to_stop_before_the_last_requests_are_waited_for(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopping = threading.Event()
    told: list[bool] = []

    async def wait(*_arguments: object) -> None:
        told.append(stopping.is_set())

    monkeypatch.setattr(uvicorn.Server, "shutdown", wait)
    server = _Server(uvicorn.Config(create_app(), log_config=None), context, 5.0, stopping)
    server.handle_exit(signal.SIGTERM, None)
    assert not stopping.is_set()  # it goes on while it drains
    asyncio.run(server.shutdown())
    assert told == [True]


def test_the_api_loads_nothing_that_decodes() -> None:
    """Photographs are opened in processes of their own, and the API stays small."""
    program = "import sys, service.serve; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    loaded = set(done.stdout.split())
    assert "service.api" in loaded
    decoders = {"rawpy", "OpenEXR", "tifffile", "imagecodecs", "PIL", "simplejpeg", "pillow_heif"}
    assert loaded.isdisjoint(decoders | {"numba", "scipy", "pipeline.process"})
