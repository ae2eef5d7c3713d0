from __future__ import annotations

import re
import resource
import shutil
import socket
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import psycopg.errors
import pytest
import sqlalchemy as sa
from obstore.exceptions import GenericError

from pipeline import compiling
from service import belonging, migrations
from service.api.context import Context
from service.cli import run
from service.doctor import Finding, examine
from service.errors import StorageFullError
from service.opening import WRONG_ADDRESS, open_database
from service.rows import clock, database, heartbeats, keys
from service.settings import MIB, Settings
from service.storage import Storage
from tests.ports import free_port
from tests.unit.service.at_first import raising

Look = Callable[[], dict[str, Finding]]


@pytest.fixture
def settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """A set-up that is right, in variables."""
    monkeypatch.setenv("LIGHTLAYERS_PORT", str(free_port()))
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "0")
    monkeypatch.setenv("LIGHTLAYERS_UPLOAD_BYTES", str(MIB))
    return Settings()


@pytest.fixture
def look(settings: Settings) -> Look:
    """What was found of each part, the last one where there are several."""
    assert settings.data_dir.name == "data"
    return lambda: {finding.part: finding for finding in examine()}


@pytest.fixture
def worker(context: Context) -> None:
    """A service with a worker that lives."""
    with context.engine.begin() as connection:
        heartbeats.beat(connection, "w")


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
    monkeypatch.setattr("service.doctor.time", SimpleNamespace(time=lambda: ahead))
    found = look()["clock"]
    assert found.grade == "wrong"
    assert re.search("by (1000|9[0-9]{2}) s", found.sentence)  # the database's goes on


def test_a_store_that_cannot_be_opened_is_told(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", "file:///dev/null/x")
    assert look()["store"].grade == "wrong"


def test_a_store_that_fails_is_told_with_its_cause(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_arguments: object) -> None:
        raise GenericError("status code: 500 Internal Server Error\n\nDebug source")

    monkeypatch.setattr("service.storage.Storage.put", fail)
    found = look()["store"]
    assert (found.grade, found.sentence) == (
        "wrong",
        "it answers and cannot be written (status code: 500 Internal Server Error): allow reading, "
        "writing, listing and deleting, or see what its own log says.",
    )


def test_the_store_is_left_as_it_was(look: Look, context: Context) -> None:
    assert look()["store"].grade == "ok"
    assert context.storage.list("") == []


def test_a_folder_that_is_a_file_is_told(look: Look, settings: Settings) -> None:
    settings.data_dir.write_text("no folder")
    found = look()["data_dir"]
    assert (found.grade, "LIGHTLAYERS_DATA_DIR" in found.sentence) == ("wrong", True)


def test_a_folder_that_cannot_be_looked_at_is_told_with_the_rest(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / ("x" * 300)))  # even by root
    found = look()
    assert {part for part, finding in found.items() if finding.grade == "wrong"} == {
        "data_dir",
        "database",
        "store",
    }
    assert "LIGHTLAYERS_DATA_DIR" in found["data_dir"].sentence
    assert found["disk"].sentence.endswith(f"free at {tmp_path}.")
    assert found["port"].grade == "ok"


def test_a_folder_that_others_may_read_is_told(look: Look, settings: Settings) -> None:
    settings.data_dir.mkdir(mode=0o755)
    assert look()["data_dir"].grade == "note"
    settings.data_dir.chmod(0o700)
    assert look()["data_dir"].grade == "ok"


def _disks(look: Look) -> dict[str, str | None]:
    found = look()
    return {part: found[part].grade if part in found else None for part in ("disk", "store's disk")}


def test_a_full_disk_is_told_of_the_store_as_of_where_requests_are_received(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = {tmp_path / "data": 5 * MIB, tmp_path / "elsewhere": 500}
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", (tmp_path / "elsewhere").as_uri())
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "400")
    usage = shutil.disk_usage("/")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage._replace(free=free[path]))
    assert _disks(look) == {"disk": "ok", "store's disk": "ok"}
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "600")
    assert _disks(look) == {"disk": "ok", "store's disk": "wrong"}
    assert "new jobs are refused" in look()["store's disk"].sentence
    monkeypatch.setenv("LIGHTLAYERS_UPLOAD_BYTES", str(6 * MIB))
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "400")
    assert _disks(look) == {"disk": "note", "store's disk": "ok"}
    assert "large requests" in look()["disk"].sentence


def test_more_free_space_than_the_disk_has_is_told(
    look: Look, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings.data_dir.mkdir(mode=0o700)
    size = shutil.disk_usage(settings.data_dir).total
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", str(size + 1))
    found = look()["store's disk"]
    assert found.grade == "wrong"
    assert found.sentence.startswith(f"LIGHTLAYERS_FREE_BYTES is {size + 1}, and the store's disk")


def test_full_disks_are_findings_among_others(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    full = sa.exc.OperationalError("x", None, psycopg.errors.DiskFull("no space"))
    look()
    monkeypatch.setattr("service.doctor._is_missing_file", lambda _url: False)
    monkeypatch.setattr("service.doctor.migrations.check", raising(full))
    monkeypatch.setattr("service.storage.Storage.put", raising(StorageFullError("It is full.")))
    found = look()
    assert (found["database"].grade, found["database"].sentence) == (
        "wrong",
        "The disk of the database of jobs is full: make room on it.",
    )
    assert (found["store"].grade, found["store"].sentence) == ("wrong", "It is full.")
    assert found["memory"].grade == "ok"


def test_a_store_on_no_disk_of_this_machine_has_no_room_to_tell(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", str(2**60))
    monkeypatch.setattr(Storage, "free_bytes", lambda _storage: None)
    assert _disks(look) == {"disk": "ok", "store's disk": None}


def test_a_disk_that_does_not_tell_its_free_space_is_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_storage: Storage) -> int:
        raise GenericError("the disk does not tell its free space")

    monkeypatch.setattr(Storage, "free_bytes", fail)
    found = look()["store's disk"]
    assert (found.grade, "free space" in found.sentence) == ("wrong", True)


def test_memory_that_a_job_may_not_have_is_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_JOB_MEMORY_BYTES", str(2**50))
    assert look()["memory"].grade == "note"
    limits = resource.RLIM_INFINITY, 2**40
    monkeypatch.setattr("service.doctor.resource.getrlimit", lambda _what: limits)
    assert look()["memory"].grade == "wrong"


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (("max\n", None), "64.0 GiB for 1 job"),
        ((f"{3 * 2**30}\n", None), "3.0 GiB for 1 job"),
        ((None, f"{2 * 2**30}\n"), "2.0 GiB for 1 job"),
        ((None, "9223372036854771712\n"), "64.0 GiB for 1 job"),
        ((None, None), "64.0 GiB for 1 job"),
    ],
)
def test_the_memory_of_a_container_is_its_own(
    texts: tuple[str | None, str | None],
    said: str,
    look: Look,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By control groups of version 2, and of version 1."""
    limits = tuple(tmp_path / name for name in ("memory.max", "memory.limit_in_bytes"))
    for limit, text in zip(limits, texts, strict=True):
        if text is not None:
            limit.write_text(text)
    sizes = {"SC_PHYS_PAGES": 2**24, "SC_PAGE_SIZE": 2**12}
    monkeypatch.setattr("service.doctor.os.sysconf", sizes.__getitem__)
    monkeypatch.setattr("service.doctor._MEMORY_LIMITS", limits)
    assert look()["memory"].sentence.startswith(said)


def test_too_few_files_are_told(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.doctor.resource.getrlimit", lambda _what: (256, -1))
    assert look()["ulimits"].grade == "wrong"


def test_files_that_a_job_may_not_have_are_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.doctor.resource.getrlimit", lambda _what: (1024, 4096))
    monkeypatch.setenv("LIGHTLAYERS_JOB_OPEN_FILES", "4096")
    assert look()["ulimits"] == Finding("ok", "ulimits", "ulimit -n is 1024.")
    monkeypatch.setenv("LIGHTLAYERS_JOB_OPEN_FILES", "4097")
    found = look()["ulimits"]
    assert found.grade == "wrong"
    assert found.sentence.startswith("ulimit -Hn allows 4096 files, fewer than LIGHTLAYERS_JOB_")


@pytest.mark.parametrize(
    ("filled", "unwritable", "grade", "words"),
    [
        (True, None, "ok", "in /compiled/pipeline."),
        (True, Path("/compiled"), "ok", "they are compiled; /compiled cannot be written"),
        (False, None, "note", f"run `{sys.executable} -m service.compile`."),
        (False, Path("/compiled"), "wrong", "each process compiles them anew"),
    ],
)
def test_whether_kernels_are_compiled_is_told(
    filled: bool,
    unwritable: Path | None,
    grade: str,
    words: str,
    look: Look,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cache = compiling.Cache(Path("/compiled/pipeline"), unwritable)
    monkeypatch.setattr(compiling, "CACHE", cache)
    monkeypatch.setattr(compiling.Cache, "is_filled", lambda _self: filled)
    found = look()["kernels"]
    assert (found.grade, words in found.sentence) == (grade, True)


@pytest.mark.parametrize("name", ["port", "metrics_port"])
def test_a_port_of_something_else_is_told(
    name: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        monkeypatch.setenv(f"LIGHTLAYERS_{name.upper()}", str(other.getsockname()[1]))
        monkeypatch.setattr("service.doctor._asked", lambda _url: "something else")
        assert look()[name].grade == "wrong"
        ours = {"port": '{"status":"ok"}', "metrics_port": "lightlayers_database_up 1.0"}
        monkeypatch.setattr("service.doctor._asked", lambda _url: ours[name])
        assert look()[name].grade == "ok"


@pytest.mark.parametrize("host", ["[::1", "0.0.0.0:1", "300.1.1.1", "a\x7fb"])
def test_an_address_that_is_none_is_told(
    host: str, look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_HOST", host)
    monkeypatch.setenv("LIGHTLAYERS_KEYS", "loopback")
    found = look()["port"]
    assert found.grade == "wrong"
    assert f" of {host} cannot be listened on (" in found.sentence
    assert found.sentence.endswith("set another LIGHTLAYERS_PORT or LIGHTLAYERS_HOST.")


def test_a_service_of_this_machine_is_asked_without_the_proxy(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("http_proxy", "HTTP_PROXY"):
        monkeypatch.setenv(name, f"http://127.0.0.1:{free_port()}")
    answer = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n" + b'{"status":"ok"}'
    with socket.create_server(("127.0.0.1", 0)) as service:

        def serve() -> None:
            connection, _ = service.accept()
            with connection:
                connection.recv(65536)
                connection.sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        port = service.getsockname()[1]
        monkeypatch.setenv("LIGHTLAYERS_PORT", str(port))
        found = look()["port"]
    assert found == Finding("ok", "port", f"lightlayers answers at {port} of 127.0.0.1.")


def test_a_port_of_something_else_is_told_that_the_worker_of_serve_would_take(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.doctor._asked", lambda _url: "something else")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        monkeypatch.setenv("LIGHTLAYERS_METRICS_PORT", str(port - 1))
        found = look()["worker's metrics_port"]
    assert found.grade == "wrong"
    assert found.sentence.startswith(f"{port} of 127.0.0.1 cannot be listened on")
    advice = "set another LIGHTLAYERS_METRICS_PORT or LIGHTLAYERS_METRICS_HOST."
    assert found.sentence.endswith(advice)


@pytest.mark.parametrize(("below", "part"), [(0, "metrics_port"), (1, "worker's metrics_port")])
def test_one_port_for_two_is_told_before_either_is_listened_on(
    below: int, part: str, look: Look, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_METRICS_PORT", str(settings.port - below))
    found = look()
    said = f"{settings.port} is the port of the service: set another LIGHTLAYERS_METRICS_PORT."
    assert found[part] == Finding("wrong", part, said)
    assert found["port"].grade == "ok"


def test_a_store_of_another_database_is_told_with_the_way_out(look: Look, context: Context) -> None:
    assert look()["store's database"] == Finding("ok", "store's database", "it is this one.")
    context.storage.put("database-id", b"another")
    found = look()["store's database"]
    name = belonging.id_of(context.engine)
    assert (found.grade, f"write {name} into its object `database-id`" in found.sentence) == (
        "wrong",
        True,
    )
    context.storage.put("database-id", name.encode())
    assert look()["store's database"].grade == "ok"


@pytest.mark.usefixtures("context")
def test_whose_a_store_is_that_does_not_answer_is_not_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def fail(_storage: Storage) -> None:
        asked.append("check")
        raise GenericError("no answer")

    monkeypatch.setattr(Storage, "check", fail)
    assert "store's database" not in look()
    assert asked == ["check"]  # one that hangs takes a minute each time
