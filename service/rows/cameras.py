"""The cameras of a service: who holds each, who waits for it, and what it last told.

The row of a camera is locked by whoever begins to use it, so that one job or look has it at a time,
whichever host it runs on. ptp+usb:// and gphoto2:// are whichever camera is on USB, and a port of
gphoto2:// may be that of any serial number: what may be one body is used by one at a time.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

import drivers
from service.rows import attempts, heartbeats, jobs, queues
from service.rows.clock import now
from service.rows.database import may_be_id
from service.rows.states import HELD, State
from service.rows.tables import cameras
from service.rows.tables import jobs as rows

_UNUSED_SECONDS = 86400.0  # after which a camera that nobody looks for is forgotten
_USB = "ptp+usb://"
_GPHOTO = "gphoto2://"
_EXTERNAL = "external"
_SWITCH_LOCK = 0x11648  # any number but that of migrations


@dataclass(frozen=True)
class Camera:
    """One camera; seconds_ago: since it was last looked at. Columns: service.rows.tables."""

    id: str
    address: str
    make: str
    model: str
    serial: str
    battery_percent: int | None
    free_bytes: int | None
    answered: bool
    seconds_ago: float
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
    """Cameras at these addresses that were ever looked for, and all that jobs hold or wait for."""
    used = sa.select(rows.c.camera).where(rows.c.camera.is_not(None), _lacks_pair())
    busy = connection.execute(used.distinct()).scalars().all()
    ids = {*busy, *map(id_of, addresses)}
    return _seen(connection, cameras.c.id.in_(ids))


def find(connection: sa.Connection, camera: str) -> Camera | None:
    """Find the camera of this id."""
    return next(iter(_seen(connection, cameras.c.id == camera)), None)


def _seen(connection: sa.Connection, which: sa.ColumnElement[bool]) -> list[Camera]:
    query = sa.select(cameras, (now() - cameras.c.looked).label("seconds_ago")).where(which)
    found = connection.execute(query.order_by(cameras.c.address))
    return [_camera(connection, row._mapping) for row in found]


def _camera(connection: sa.Connection, row: Mapping[Any, Any]) -> Camera:
    names = Camera.__dataclass_fields__.keys() - {"holder", "waiting"}
    return Camera(
        **{name: row[name] for name in names},
        holder=holder(connection, row["id"]),
        waiting=count_waiting(connection, row["id"]),
    )


def _lacks_pair() -> sa.ColumnElement[bool]:
    """Whether a job goes on whose pair no camera has taken yet."""
    # By the states that it may have: an index finds these, and none finds what is not ended.
    return sa.and_(rows.c.state.in_((State.QUEUED, *HELD)), rows.c.inputs.is_(None))


def holder(connection: sa.Connection, camera: str) -> jobs.Job | None:
    """Find the job that has the camera take its pair now."""
    has_it = sa.or_(*map(queues.is_held_from_queue, _same(connection, camera)))
    job_id = connection.execute(sa.select(rows.c.id).where(has_it)).scalar()
    return jobs.find(connection, job_id) if job_id else None


def count_waiting(connection: sa.Connection, camera: str) -> int:
    """How many jobs wait for the camera."""
    waits = sa.or_(*map(queues.waits_in_queue, _same(connection, camera)))
    return connection.execute(sa.select(sa.func.count()).where(waits)).scalar_one()


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
    takes = sa.and_(rows.c.state.in_(HELD), rows.c.stage == queues.CAPTURE, rows.c.id != besides)
    switches = rows.c.capture["flash"].as_string() == _EXTERNAL
    return connection.execute(sa.select(rows.c.id).where(takes, switches)).first() is not None


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


def _same(connection: sa.Connection, camera: str) -> list[str]:
    """Ids under which this camera may be in use."""
    address = address_of(connection, camera) or ""
    if not _is_on_usb(address):
        return [camera]
    known = sa.select(cameras.c.id, cameras.c.address)
    others = [row.id for row in connection.execute(known) if _may_be_one(address, row.address)]
    return [camera, *others]


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
