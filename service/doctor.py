"""Looks at a set-up as its processes would find it, and says what is wrong and what to do."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import resource
import shlex
import shutil
import socket
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import httpx
import sqlalchemy as sa
from obstore.exceptions import BaseError
from pydantic import ValidationError

from pipeline import compiling
from pipeline.errors import counted, reason_of
from service import belonging, migrations
from service.errors import StartError, StorageFullError
from service.object_keys import DATABASE_ID
from service.opening import NO_ROOM, WRONG_ADDRESS, open_storage
from service.problems import cause_of
from service.room import larger_than_disk
from service.rows import census, clock, database, keys
from service.sentences import sentence_of
from service.settings import Settings
from service.storage import Storage
from service.variables import PREFIX, faults

_CLOCKS_APART_SECONDS = 5  # this machine's and the database's
_OPEN_FILES = 1024  # each connection and photograph takes one
_LIBRARIES = ("lightlayers", "dbos", "fastapi", "numpy", "obstore", "opencv-python-headless")
_MEMORY_LIMITS = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)
"""Of the container, by control groups of version 2 and 1; "max" or a huge number for none."""


@dataclass(frozen=True)
class Finding:
    """What was found of one part; "note" is worth knowing and stops nothing."""

    grade: Literal["ok", "note", "wrong"]
    part: str
    sentence: str


def examine() -> Iterator[Finding]:
    """Look at everything, one finding after the other."""
    yield _versions()
    yield from _variables()
    try:
        settings = Settings()
    except ValidationError as error:
        yield Finding("wrong", "settings", sentence_of(error))
        return
    for look in (_folder, _database, _store, _disk, _memory, _files, _kernels, _ports):
        yield from look(settings)


def _versions() -> Finding:
    numbers = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES)
    return Finding("ok", "versions", f"{numbers}, Python {platform.python_version()}.")


def _variables() -> Iterator[Finding]:
    sentences = faults()
    for sentence in sentences:
        yield Finding("wrong", "variables", sentence)
    if not sentences:
        yield Finding("ok", "variables", f"every {PREFIX}… variable is a setting.")


def _folder(settings: Settings) -> Iterator[Finding]:
    folder = settings.data_dir
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        yield Finding(
            "wrong",
            "data_dir",
            f"{folder} cannot be written ({reason_of(error)}): give it to the user that runs the "
            "service, or set LIGHTLAYERS_DATA_DIR.",
        )
        return
    if folder.stat().st_mode & 0o077:
        yield Finding(
            "note",
            "data_dir",
            f"other users of this machine may look into {folder}: chmod 700 keeps photographs "
            "private.",
        )
    else:
        yield Finding("ok", "data_dir", f"{folder} can be written, by its user alone.")


def _database(settings: Settings) -> Iterator[Finding]:
    if _is_missing_file(settings.database_url):
        yield Finding("note", "database", "there is none yet; `lightlayers serve` makes it.")
        yield _keys(settings, False)
        return
    try:
        engine = database.connect(settings.database_url)
    except (sa.exc.ArgumentError, ValueError):
        yield Finding("wrong", "database", WRONG_ADDRESS)
        return
    except (sa.exc.SQLAlchemyError, OSError, ImportError) as error:
        yield _no_database(error)
        return
    try:
        yield Finding("ok", "database", f"it answers, at schema {migrations.check(engine)}.")
        yield _clock(engine)
        yield _workers(engine, settings)
        with engine.connect() as connection:
            yield _keys(settings, keys.any_usable(connection))
    except migrations.SchemaError as error:
        yield Finding("wrong", "database", str(error))
    except (sa.exc.SQLAlchemyError, OSError) as error:
        yield _no_database(error)
    finally:
        engine.dispose()


def _is_missing_file(url: str) -> bool:
    try:
        parsed = sa.make_url(url)
    except (sa.exc.ArgumentError, ValueError):
        return False
    if parsed.get_backend_name() != "sqlite":
        return False
    try:
        return parsed.database not in database.IN_MEMORY and not Path(str(parsed.database)).exists()
    except OSError:  # its folder may not be entered: opening it tells why
        return False


def _no_database(error: Exception) -> Finding:
    if database.is_full(error):
        return Finding("wrong", "database", NO_ROOM)
    return Finding(
        "wrong",
        "database",
        f"it does not answer ({cause_of(error)}): start it, or correct LIGHTLAYERS_DATABASE_URL.",
    )


def _clock(engine: sa.Engine) -> Finding:
    with engine.connect() as connection:
        apart = abs(connection.execute(sa.select(clock.now())).scalar_one() - time.time())
    if apart > _CLOCKS_APART_SECONDS:
        return Finding(
            "wrong",
            "clock",
            f"it differs by {apart:.0f} s from the database's: keep both by NTP, for S3 refuses "
            "requests of a wrong time.",
        )
    return Finding("ok", "clock", "it agrees with the database's.")


def _workers(engine: sa.Engine, settings: Settings) -> Finding:
    with engine.connect() as connection:
        living = census.living_workers(connection, settings.silence_seconds)
        waiting = census.longest_wait(connection)
    if not living:
        return Finding("wrong", "workers", "none lives: start one with `lightlayers worker`.")
    said = f"{living} live; the oldest job has waited {waiting:.0f} s for one."
    return Finding("ok", "workers", said)


def _keys(settings: Settings, usable: bool) -> Finding:
    if keys.required(settings) and not usable:
        return Finding(
            "wrong",
            "keys",
            "requests need one, and none is good, so that `lightlayers serve` does not start: make "
            "one with `lightlayers keys create NAME`, or let LIGHTLAYERS_HOST be 127.0.0.1.",
        )
    return Finding("ok", "keys", "there is one." if usable else "none is needed to start.")


def _store(settings: Settings) -> Iterator[Finding]:
    key = f"health/{uuid.uuid4().hex}"
    try:
        storage = open_storage(settings)
        storage.put(key, b"light")
        read = storage.get(key)
        storage.delete_below("health/")
    except StartError as error:
        yield Finding("wrong", "store", str(error))
        return
    except StorageFullError as error:
        yield Finding("wrong", "store", str(error))
        yield from _answering(storage, settings)
        return
    except (BaseError, OSError) as error:
        yield Finding(
            "wrong",
            "store",
            f"it answers and cannot be written ({cause_of(error)}): allow reading, writing, "
            "listing and deleting, or see what its own log says.",
        )
        return
    grade: Literal["ok", "wrong"] = "ok" if read == b"light" else "wrong"
    yield Finding(grade, "store", "what is written can be read, listed and deleted.")
    yield from _answering(storage, settings)


def _answering(storage: Storage, settings: Settings) -> Iterator[Finding]:
    """What a store tells that answers; one that hangs would keep waiting whoever asks again."""
    yield from _room(storage, settings)
    yield from _belonging(storage, settings)


def _belonging(storage: Storage, settings: Settings) -> Iterator[Finding]:
    """Whose the store is; nothing where the database does not answer, which is told already."""
    if _is_missing_file(settings.database_url):
        return
    try:
        engine = database.connect(settings.database_url)
    except (sa.exc.SQLAlchemyError, ValueError, OSError, ImportError):
        return
    try:
        migrations.check(engine)
        if belonging.standing(engine, storage) == "foreign":
            yield Finding(
                "wrong",
                "store's database",
                "the store has files of another database, or of one that is lost, so no file "
                "without a job is removed: correct LIGHTLAYERS_STORE_URL, or, where no other "
                f"service uses the store, write {belonging.id_of(engine)} into its object "
                f"`{DATABASE_ID}`, and files of jobs that are not in this database are removed.",
            )
        else:
            yield Finding("ok", "store's database", "it is this one.")
    except (migrations.SchemaError, sa.exc.SQLAlchemyError, BaseError, OSError):
        return
    finally:
        engine.dispose()


def _room(storage: Storage, settings: Settings) -> Iterator[Finding]:
    try:
        free, size = storage.free_bytes(), storage.disk_bytes()
    except BaseError as error:
        yield Finding("wrong", "store's disk", f"{cause_of(error)}: see what lies at its place.")
        return
    if free is None or size is None:  # on no disk of ours
        return
    if size < settings.free_bytes:
        yield Finding("wrong", "store's disk", larger_than_disk(settings, size))
        return
    said = f"{free / 2**30:.1f} GiB are free for photographs and results"
    if free < settings.free_bytes:
        less = "less than LIGHTLAYERS_FREE_BYTES: new jobs are refused; make room."
        yield Finding("wrong", "store's disk", f"{said}, {less}")
    else:
        yield Finding("ok", "store's disk", f"{said}.")


def _disk(settings: Settings) -> Iterator[Finding]:
    folders = (settings.data_dir, *settings.data_dir.parents)
    folder = next(path for path in folders if os.access(path, os.F_OK))
    free = shutil.disk_usage(folder).free
    said = f"{free / 2**30:.1f} GiB are free at {folder}"
    if free < settings.upload_bytes:
        less = "less than LIGHTLAYERS_UPLOAD_BYTES: large requests and their jobs fail; make room."
        yield Finding("note", "disk", f"{said}, {less}")
    else:
        yield Finding("ok", "disk", f"{said}.")


def _memory(settings: Settings) -> Iterator[Finding]:
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    needed = settings.job_memory_bytes
    if most != resource.RLIM_INFINITY and most < needed:
        yield Finding(
            "wrong",
            "memory",
            f"ulimit -v allows {most / 2**30:.1f} GiB, less than LIGHTLAYERS_JOB_MEMORY_BYTES: "
            "raise the one or lower the other.",
        )
        return
    there = _memory_bytes()
    wanted = needed * settings.worker_concurrency
    at_once = counted(settings.worker_concurrency, "job", "jobs")
    said = f"{there / 2**30:.1f} GiB for {at_once} at a time"
    if there < wanted:
        yield Finding(
            "note",
            "memory",
            f"{said}, which may take {wanted / 2**30:.1f} GiB of addresses: large photographs may "
            "be killed by the system; lower LIGHTLAYERS_JOB_MEMORY_BYTES to have them told.",
        )
    else:
        yield Finding("ok", "memory", f"{said}.")


def _memory_bytes() -> int:
    """Memory of this machine, or of the container that we are in."""
    there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    texts = [limit.read_text().strip() for limit in _MEMORY_LIMITS if limit.exists()]
    return min([there, *(int(text) for text in texts if text != "max")])


def _files(settings: Settings) -> Iterator[Finding]:
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != resource.RLIM_INFINITY and soft < _OPEN_FILES:
        yield Finding(
            "wrong", "ulimits", f"ulimit -n is {soft}, too few files: make it {_OPEN_FILES}."
        )
    elif most != resource.RLIM_INFINITY and most < settings.job_open_files:
        yield Finding(
            "wrong",
            "ulimits",
            f"ulimit -Hn allows {most} files, fewer than LIGHTLAYERS_JOB_OPEN_FILES: raise the one "
            "or lower the other.",
        )
    else:
        yield Finding("ok", "ulimits", f"ulimit -n is {soft}.")


def _kernels(_settings: Settings) -> Iterator[Finding]:
    cache, filled = compiling.CACHE, compiling.CACHE.is_filled()
    command = f"{shlex.quote(sys.executable)} -m service.compile"  # which has it, as no other may
    if filled and cache.unwritable:
        sentence = f"they are compiled; {cache.unwritable} cannot be written, so no more are kept."
    elif filled:
        sentence = f"they are compiled for this processor, in {cache.folder}."
    elif cache.unwritable:
        sentence = (
            f"none are compiled for this processor and {cache.unwritable} cannot be written, so "
            "that each process compiles them anew: give it to the user that runs the service, or "
            "set NUMBA_CACHE_DIR."
        )
    else:
        sentence = f"the first jobs will compile them for this processor: run `{command}`."
    missing: Literal["note", "wrong"] = "wrong" if cache.unwritable else "note"
    yield Finding("ok" if filled else missing, "kernels", sentence)


def _ports(settings: Settings) -> Iterator[Finding]:
    yield _port("port", settings.host, settings.port, "", _is_ours)
    ports = {
        "metrics_port": settings.metrics_port,
        "worker's metrics_port": settings.worker_metrics_port,
    }
    for part, port in ports.items():
        if port is None:
            continue
        if port == settings.port:
            said = f"{port} is the port of the service: set another {PREFIX}METRICS_PORT."
            yield Finding("wrong", part, said)
        else:
            yield _port(part, settings.metrics_host, port, "METRICS_", _is_metrics)


def _port(part: str, host: str, port: int, kind: str, ours: Callable[[str], bool]) -> Finding:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, port), family=family).close()
        return Finding("ok", part, f"{port} of {host} is free.")
    except OSError as error:
        local = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
        if ours(f"http://{f'[{local}]' if ':' in local else local}:{port}"):
            return Finding("ok", part, f"lightlayers answers at {port} of {host}.")
        return Finding(
            "wrong",
            part,
            f"{port} of {host} cannot be listened on ({reason_of(error)}): set another "
            f"{PREFIX}{kind}PORT or {PREFIX}{kind}HOST.",
        )


def _is_ours(url: str) -> bool:
    return '"status":"ok"' in _asked(f"{url}/healthz")


def _is_metrics(url: str) -> bool:
    return "lightlayers_database_up" in _asked(f"{url}/metrics")


def _asked(url: str) -> str:
    try:
        return httpx.get(url, timeout=5, trust_env=False).text  # no proxy reaches this machine
    except (httpx.HTTPError, httpx.InvalidURL):
        return ""
