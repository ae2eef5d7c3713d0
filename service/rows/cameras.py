"""The cameras of a service: who holds each, who waits for it, and what it last told.

The row of a camera is locked by whoever begins to use it, so that one job or look has it at a time,
whichever host it runs on. ptp+usb:// and gphoto2:// are whichever camera is on USB, and a port of
gphoto2:// may be that of any serial number: what may be one body is used by one at a time.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

import drivers
from service.rows import attempts, heartbeats, jobs, queues
from service.rows.clock import now
from service.rows.database import may_be_id
from service.rows.tables import cameras
from service.rows.tables import jobs as rows

_UNUSED_SECONDS = 86400.0  # after which a camera that nobody looks for is forgotten
_USB = "ptp+usb://"
_GPHOTO = "gphoto2://"
_EXTERNAL = "external"
_SWITCH_LOCK = 0x11648  # any number but that of migrations


@dataclass(frozen=True)
class Camera:
    """One camera, with who has it and how many wait. Columns: service.rows.tables."""

    id: str
    address: str
    make: str
    model: str
    serial: str
    battery_percent: int | None
    free_bytes: int | None
    answered: bool
    holder: jobs.Job | None
    waiting: int


def id_of(address: str) -> str:
    """Give the id of the camera at an address, however that is spelt.

    Raises drivers.BadAddressError, drivers.CameraNotFoundError.
    """
    return hashlib.sha256(drivers.canonical_address(address).encode()).hexdigest()[:16]


def add(connection: sa.Connection, address: str) -> str:
    """Have a row for the camera at an address, and lock it for this transaction; its id."""
    camera = id_of(address)
    _lock(connection, camera, address)
    return camera


def address_of(connection: sa.Connection, camera: str) -> str | None:
    """Find the address of the camera of this id, which may be any text."""
    if not may_be_id(camera):
        return None
    found = sa.select(cameras.c.address).where(cameras.c.id == camera)
    return connection.execute(found).scalar()


def find_all(connection: sa.Connection, addresses: Collection[str]) -> list[Camera]:
    """Cameras at these addresses that were ever looked for, and all that jobs hold or wait for.

    It takes four statements, however many cameras there are.
    """
    held, waiting = _held(connection), _waiting(connection)
    holders = {job.id: job for job in jobs.find_all(connection, held.values())}
    known = {row.id: row for row in connection.execute(sa.select(cameras))}
    places = {camera: row.address for camera, row in known.items()}
    names = Camera.__dataclass_fields__.keys() - {"holder", "waiting"}
    found = []
    for camera in known.keys() & {*held, *waiting, *map(id_of, addresses)}:
        same = _same_among(places, camera)
        by = next((held[one] for one in same if one in held), "")
        found.append(
            Camera(
                **{name: getattr(known[camera], name) for name in names},
                holder=holders.get(by),
                waiting=sum(waiting.get(one, 0) for one in same),
            )
        )
    return sorted(found, key=lambda one: one.address)


def looked_ago(connection: sa.Connection, camera: str) -> float:
    """Seconds since somebody looked at a camera; infinite for one that nobody has asked for."""
    found = sa.select(now() - cameras.c.looked).where(cameras.c.id == camera)
    ago = connection.execute(found).scalar()
    return math.inf if ago is None else ago


def holder(connection: sa.Connection, camera: str) -> jobs.Job | None:
    """Find the job that has the camera take its pair now."""
    held = _held(connection)
    job_id = next((held[one] for one in _same(connection, camera) if one in held), None)
    return jobs.find(connection, job_id) if job_id else None


def count_waiting(connection: sa.Connection, camera: str) -> int:
    """How many jobs wait for the camera."""
    waiting = _waiting(connection)
    return sum(waiting.get(one, 0) for one in _same(connection, camera))


def _held(connection: sa.Connection) -> dict[str, str]:
    """Ids of the jobs that have cameras take their pairs, by those of the cameras."""
    found = connection.execute(sa.select(rows.c.camera, rows.c.id).where(queues.HOLDS_CAMERA))
    return dict(found.all())


def _waiting(connection: sa.Connection) -> dict[str, int]:
    """How many jobs wait for cameras, by the ids of these."""
    query = sa.select(rows.c.camera, sa.func.count()).where(queues.WAITS_FOR_CAMERA)
    found = connection.execute(query.group_by(rows.c.camera))
    return dict(found.all())


def claim(connection: sa.Connection, job_id: str, worker: str) -> jobs.Job | None:
    """Start the next capture of a job, as attempts.claim does, once nobody else uses its camera.

    Nor the operator's switch, which is one for all cameras, where the job's flash is on it. A job
    that has its pair already is claimed from a dead worker alone, to be passed on.
    """
    job = jobs.find(connection, job_id)
    if job is None or job.camera is None or job.capture is None:
        return None
    _lock(connection, job.camera, job.capture["camera"])
    other = holder(connection, job.camera)
    if _is_taken(connection, job.camera) or (other and other.id != job_id):
        return None
    if job.capture.get("flash") == _EXTERNAL:
        if connection.dialect.name != "sqlite":  # which the row of the camera locks whole
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_SWITCH_LOCK)))
        if is_switch_in_use(connection, job_id):
            return None
    job = jobs.find(connection, job_id)  # as it is now that others wait
    if job is None or is_past_capture(job):
        return None
    return attempts.claim(connection, job_id, worker, queues.CAPTURE)


def is_switch_in_use(connection: sa.Connection, besides: str) -> bool:
    """Whether a job besides this has a pair taken with the flash on the operator's switch."""
    switches = rows.c.capture["flash"].as_string() == _EXTERNAL
    others = sa.and_(queues.HOLDS_CAMERA, rows.c.id != besides, switches)
    return connection.execute(sa.select(rows.c.id).where(others)).first() is not None


def is_past_capture(job: jobs.Job) -> bool:
    """Whether nothing is left to do for the camera's part of a job."""
    return job.ended or (job.inputs is not None and not job.captures)


def take(connection: sa.Connection, camera: str, seconds: float) -> float | None:
    """Have the camera for oneself for so long at most, without a job; until when, if it was free.

    camera: as add() gave it in this transaction.
    """
    if _is_taken(connection, camera) or holder(connection, camera):
        return None
    until = sa.update(cameras).where(cameras.c.id == camera).values(taken_until=now() + seconds)
    return float(connection.execute(until.returning(cameras.c.taken_until)).scalar_one())


def give_back(
    connection: sa.Connection,
    camera: str,
    until: float,
    info: drivers.CameraInfo | None,
    answered: bool,
    host: str | None = None,
) -> None:
    """End take(), which gave `until`, unless somebody else has taken the camera since.

    info: what the camera told of itself; answered: whether it answered at all. host: where that
    was, as service.workers.host names it.
    """
    own = sa.and_(cameras.c.id == camera, cameras.c.taken_until == until)
    connection.execute(sa.update(cameras).where(own).values(taken_until=0.0))
    note(connection, camera, info, answered)
    if answered and host is not None and _is_on_usb(address_of(connection, camera) or ""):
        _note_host(connection, camera, host)


def _note_host(connection: sa.Connection, camera: str, host: str) -> None:
    """Write on whose USB a camera is; None where no worker ever was there, so that any may try."""
    this = sa.update(cameras).where(cameras.c.id == camera)
    if heartbeats.live_on(connection, host):
        connection.execute(this.values(host=host))
    else:  # a worker of this host that starts anew is waited for
        connection.execute(this.where(cameras.c.host != host).values(host=None))


def host_of(connection: sa.Connection, camera: str) -> str | None:
    """Find the host whose workers alone can use a camera; None where any worker may.

    Whichever camera is on USB is the one that was looked at last.
    """
    address = address_of(connection, camera) or ""
    ids = _same(connection, camera) if _is_any_on_usb(address) else [camera]
    noted = sa.and_(cameras.c.id.in_(ids), cameras.c.host.is_not(None))
    query = sa.select(cameras.c.host).where(noted).order_by(cameras.c.looked.desc()).limit(1)
    return connection.execute(query).scalar()


def may_be_elsewhere(connection: sa.Connection, camera: str, host: str) -> bool:
    """Whether a camera that was not found on a host's USB may hang on that of another host."""
    on_usb = _is_on_usb(address_of(connection, camera) or "")
    return on_usb and host_of(connection, camera) != host


def note(
    connection: sa.Connection, camera: str, info: drivers.CameraInfo | None, answered: bool = True
) -> None:
    """Write what a camera told of itself, or that it does not answer."""
    values: dict[str, Any] = {"answered": answered, "looked": now()}
    if info:
        values |= {name: getattr(info, name)[:255] for name in ("make", "model", "serial")}
        values |= {"battery_percent": info.battery_percent, "free_bytes": info.free_bytes}
    connection.execute(sa.update(cameras).where(cameras.c.id == camera).values(values))


def forget_unused(connection: sa.Connection) -> None:
    """Delete the rows of cameras that nobody has asked for in a day, and no job is of."""
    of_jobs = sa.exists().where(rows.c.camera == cameras.c.id)
    old = cameras.c.looked < now() - _UNUSED_SECONDS
    unused = sa.and_(old, cameras.c.taken_until < now(), ~of_jobs)
    connection.execute(sa.delete(cameras).where(unused))


def _lock(connection: sa.Connection, camera: str, address: str) -> None:
    """Have a row for a camera, and lock it for this transaction, and with it all that are _same."""
    if _is_on_usb(address) and address != _USB:
        _lock(connection, id_of(_USB), _USB)  # that all of them lock first
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    new: Any = insert(cameras).values(id=camera, address=address)
    # A write, because SQLite knows no other lock.
    same = {"address": cameras.c.address}
    connection.execute(new.on_conflict_do_update(index_elements=[cameras.c.id], set_=same))


def _same(connection: sa.Connection, camera: str) -> set[str]:
    """Ids under which this camera may be in use."""
    places = connection.execute(sa.select(cameras.c.id, cameras.c.address))
    return _same_among(dict(places.all()), camera)


def _same_among(addresses: Mapping[str, str], camera: str) -> set[str]:
    """Do what _same does; addresses: of all cameras, by their ids."""
    address = addresses.get(camera, "")
    others = addresses.items() if _is_on_usb(address) else ()
    return {camera, *(other for other, place in others if _may_be_one(address, place))}


def _is_on_usb(address: str) -> bool:
    return address.startswith((_USB, f"{_GPHOTO}usb")) or _is_any_on_usb(address)


def _is_any_on_usb(address: str) -> bool:
    """Whether an address means whichever camera is on USB."""
    return address.rstrip("/") in (_USB.rstrip("/"), _GPHOTO.rstrip("/"))


def _may_be_one(one: str, other: str) -> bool:
    """Whether two addresses, the first of which is on USB, may be of one body."""
    if not _is_on_usb(other):
        return False
    (driver, place), (other_driver, other_place) = (
        each.rstrip("/").split(":", 1) for each in (one, other)
    )
    # serial numbers tell bodies apart, and ports do, but a port tells no serial number
    return driver != other_driver or not place or not other_place or place == other_place


def _is_taken(connection: sa.Connection, camera: str) -> bool:
    this = cameras.c.id.in_(_same(connection, camera))
    taken = sa.select(cameras.c.id).where(this, cameras.c.taken_until > now())
    return connection.execute(taken).first() is not None
