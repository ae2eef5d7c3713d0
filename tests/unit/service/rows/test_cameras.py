"""Who holds a camera, who waits for it, and what it last told."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
import sqlalchemy as sa

import drivers
from service.rows import attempts, cameras, heartbeats, jobs, queues, tables, waiting
from service.rows.states import State
from tests.plans import plans

ADDRESS = "ptp+ip://192.168.1.20"
OTHER = "ptp+ip://192.168.1.21"
INFO = drivers.CameraInfo(ADDRESS, "Make", "Model", "7", 80, 10**9)


@pytest.fixture
def camera(engine: sa.Engine) -> str:
    with engine.begin() as connection:
        return cameras.add(connection, ADDRESS)


def _add(engine: sa.Engine, job_id: str, address: str = ADDRESS, **more: Any) -> None:
    row = {"id": job_id, "options": {}, "trace_id": "1" * 32, "request_hash": ""}
    with engine.begin() as connection:
        camera = cameras.add(connection, address)
        capture = {"camera": address}
        jobs.add(connection, row | {"camera": camera, "capture": capture} | more)


def _claim(engine: sa.Engine, job_id: str, worker: str = "w1") -> jobs.Job | None:
    with engine.begin() as connection:
        heartbeats.beat(connection, worker)
        return cameras.claim(connection, job_id, worker)


def _look(engine: sa.Engine, camera: str) -> cameras.Camera:
    with engine.connect() as connection:
        address = cameras.address_of(connection, camera)
        assert address is not None
        found = cameras.find_all(connection, [address])
    return next(one for one in found if one.id == camera)


@pytest.mark.parametrize(
    ("one", "same"),
    [
        ("ptp+ip://studio", "ptp+ip://studio:15740"),
        ("ptp+ip://studio", "ptp+ip://STUDIO/"),
        ("ptp+ip://[::1]", "ptp+ip://[::1]:15740"),
        ("sim://studio", "sim://studio/"),
        ("ptp+usb://123", "ptp+usb://123/"),
    ],
)
def test_a_camera_has_one_id_however_its_address_is_spelt(one: str, same: str) -> None:
    assert cameras.id_of(one) == cameras.id_of(same)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("ptp+ip://studio", "ptp+ip://studio:15741"),
        ("sim://studio", "sim://studio?lights=3"),
        ("ptp+usb://1", "gphoto2://usb:1"),
    ],
)
def test_other_cameras_have_other_ids(one: str, other: str) -> None:
    assert cameras.id_of(one) != cameras.id_of(other)


@pytest.mark.parametrize("address", ["", "studio", "ptp+ip://", "sim://studio?lights=9", "x://y"])
def test_what_is_no_address_has_no_id(address: str) -> None:
    with pytest.raises(drivers.DriverError):
        cameras.id_of(address)


def test_a_camera_that_was_never_looked_at_is_known_all_the_same(
    engine: sa.Engine, camera: str
) -> None:
    found = _look(engine, camera)
    assert (found.address, found.answered, found.holder, found.waiting) == (ADDRESS, False, None, 0)
    with engine.begin() as connection:
        assert cameras.add(connection, ADDRESS) == camera
        assert cameras.address_of(connection, camera) == ADDRESS
        assert cameras.address_of(connection, "another") is None
        assert cameras.looked_ago(connection, camera) > 10**9
        assert math.isinf(cameras.looked_ago(connection, "another"))


def test_what_a_camera_tells_is_kept_when_it_is_away(engine: sa.Engine, camera: str) -> None:
    with engine.begin() as connection:
        cameras.note(connection, camera, INFO)
    found = _look(engine, camera)
    assert (found.make, found.model, found.serial, found.battery_percent, found.free_bytes) == (
        "Make", "Model", "7", 80, 10**9,
    )  # fmt: skip
    assert found.answered
    with engine.connect() as connection:
        assert 0 <= cameras.looked_ago(connection, camera) < 60
    with engine.begin() as connection:
        cameras.note(connection, camera, None, answered=False)
    found = _look(engine, camera)
    assert (found.model, found.battery_percent, found.answered) == ("Model", 80, False)


def test_what_a_camera_tells_is_cut_to_what_every_database_keeps(
    engine: sa.Engine, camera: str
) -> None:
    with engine.begin() as connection:
        cameras.note(connection, camera, replace(INFO, model="M" * 256))
    assert _look(engine, camera).model == "M" * 255


def test_one_job_at_a_time_has_a_camera(engine: sa.Engine, camera: str) -> None:
    _add(engine, "a")
    _add(engine, "b")
    assert _look(engine, camera).waiting == 2
    held = _claim(engine, "a")
    assert held and (held.state, held.stage, held.attempt) == (State.RUNNING, queues.CAPTURE, 1)
    assert _claim(engine, "b", "w2") is None
    found = _look(engine, camera)
    assert found.holder == held and found.waiting == 1
    with engine.begin() as connection:
        assert attempts.set_inputs(connection, held, {}, 1, {"iso": 100})
        assert cameras.holder(connection, camera) == jobs.find(connection, "a")
        assert attempts.release(connection, held)
    assert _look(engine, camera).holder is None
    other = _claim(engine, "b", "w2")
    assert other and other.id == "b"


def test_jobs_of_two_cameras_do_not_wait_for_each_other(engine: sa.Engine) -> None:
    _add(engine, "a")
    _add(engine, "b", OTHER)
    assert _claim(engine, "a")
    assert _claim(engine, "b", "w2")


def test_jobs_of_two_cameras_wait_for_the_one_switch_of_their_flash(engine: sa.Engine) -> None:
    _add(engine, "a", capture={"camera": ADDRESS, "flash": "external"})
    _add(engine, "b", OTHER, capture={"camera": OTHER, "flash": "external"})
    _add(engine, "c", "ptp+ip://192.168.1.22")
    held = _claim(engine, "a")
    assert held and _claim(engine, "b", "w2") is None
    assert _claim(engine, "c", "w2")  # whose flash the camera switches
    with engine.begin() as connection:
        assert attempts.set_inputs(connection, held, {}, 1, {})
        assert attempts.release(connection, held)
        assert attempts.claim(connection, "a", "w1")  # to separate the pair, which needs no flash
    other = _claim(engine, "b", "w2")
    assert other and other.id == "b"


def test_a_job_that_lost_its_worker_keeps_the_switch_until_it_is_taken_over(
    engine: sa.Engine,
) -> None:
    _add(engine, "a", capture={"camera": ADDRESS, "flash": "external"})
    assert _claim(engine, "a")
    with engine.begin() as connection:
        heartbeats.leave(connection, "w1")
    again = _claim(engine, "a", "w2")
    assert again and again.attempt == 2


def test_a_job_that_separates_does_not_hold_its_camera(engine: sa.Engine, camera: str) -> None:
    _add(engine, "a", inputs={"flash": {}})
    with engine.begin() as connection:
        assert attempts.claim(connection, "a", "w1")
    found = _look(engine, camera)
    assert (found.holder, found.waiting) == (None, 0)
    assert _claim(engine, "a", "w2") is None


def test_a_job_that_waits_for_its_operator_holds_its_camera(engine: sa.Engine, camera: str) -> None:
    _add(engine, "a")
    held = _claim(engine, "a")
    assert held
    with engine.begin() as connection:
        attempts.ask_operator(connection, held, "Switch the flash off.", 60)
    holder = _look(engine, camera).holder
    assert holder and (holder.id, holder.state) == ("a", State.WAITING_FOR_OPERATOR)


def test_a_dead_workers_camera_goes_with_its_job(engine: sa.Engine) -> None:
    _add(engine, "a")
    _add(engine, "b")
    assert _claim(engine, "a")
    with engine.begin() as connection:
        heartbeats.leave(connection, "w1")
    assert _claim(engine, "b", "w2") is None  # not before the takeover
    again = _claim(engine, "a", "w2")
    assert again and (again.attempt, again.lost) == (2, 1)
    with engine.begin() as connection:
        attempts.fail(connection, again, {})
    assert _claim(engine, "b", "w2")


def test_a_pair_that_a_dead_worker_has_kept_is_only_passed_on(engine: sa.Engine) -> None:
    _add(engine, "a")
    held = _claim(engine, "a")
    assert held
    with engine.begin() as connection:
        attempts.set_inputs(connection, held, {"flash": {}}, 1, {})
        heartbeats.leave(connection, "w1")
    again = _claim(engine, "a", "w2")
    assert again and again.captures and not cameras.is_past_capture(again)
    with engine.begin() as connection:
        attempts.release(connection, again)
        passed_on = jobs.find(connection, "a")
    assert passed_on and cameras.is_past_capture(passed_on)
    assert _claim(engine, "a", "w2") is None


def test_a_look_and_a_job_never_have_a_camera_at_once(engine: sa.Engine, camera: str) -> None:
    _add(engine, "a")
    with engine.begin() as connection:
        until = cameras.take(connection, camera, 60)
        assert until and not cameras.take(connection, camera, 60)
    assert _claim(engine, "a") is None
    with engine.begin() as connection:
        cameras.give_back(connection, camera, until, INFO, answered=True)
    assert _claim(engine, "a")
    with engine.begin() as connection:
        assert not cameras.take(connection, camera, 60)


def test_a_look_that_died_does_not_keep_the_camera_for_ever(engine: sa.Engine, camera: str) -> None:
    with engine.begin() as connection:
        assert cameras.take(connection, camera, -1)
        assert cameras.take(connection, camera, 60)


def test_a_look_that_took_too_long_takes_the_camera_from_nobody_else(
    engine: sa.Engine, camera: str
) -> None:
    _add(engine, "a")
    with engine.begin() as connection:
        late = cameras.take(connection, camera, -1)
        assert late and cameras.take(connection, camera, 60)
    with engine.begin() as connection:
        cameras.give_back(connection, camera, late, INFO, answered=True)
    assert _claim(engine, "a") is None
    assert _look(engine, camera).answered


USB = "ptp+usb://"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (USB, f"{USB}1"),
        (f"{USB}1", USB),
        (f"{USB}/", USB),
        (USB, "gphoto2://"),
        ("gphoto2://", f"{USB}1"),
        ("gphoto2://usb:001,004", "gphoto2://"),
        ("gphoto2://usb:001,004", f"{USB}1"),
        (USB, "gphoto2://usb:001,004"),
    ],
)
def test_whichever_camera_is_on_usb_is_used_by_one_at_a_time(
    one: str, other: str, engine: sa.Engine
) -> None:
    with engine.begin() as connection:
        looked_at = cameras.add(connection, one)
        until = cameras.take(connection, looked_at, 60)
        assert until
    _add(engine, "a", other)
    assert _claim(engine, "a") is None
    with engine.begin() as connection:
        cameras.give_back(connection, looked_at, until, None, answered=False)
    _add(engine, "b", one)
    found = _look(engine, looked_at)
    assert (found.holder, found.waiting) == (None, 2)
    held = _claim(engine, "a")
    assert held and _claim(engine, "b") is None
    found = _look(engine, looked_at)
    assert (found.holder, found.waiting) == (held, 1)
    with engine.begin() as connection:
        assert not cameras.take(connection, cameras.add(connection, one), 60)
        heartbeats.leave(connection, "w1")
    assert _claim(engine, "b", "w2") is None
    assert _claim(engine, "a", "w2")  # by whom it is taken over


def test_cameras_on_usb_that_are_known_apart_are_used_at_once(engine: sa.Engine) -> None:
    _add(engine, "a", f"{USB}1")
    _add(engine, "b", f"{USB}2")
    _add(engine, "c", USB)
    assert _claim(engine, "a") and _claim(engine, "b")
    assert _claim(engine, "c") is None
    with engine.begin() as connection:
        assert cameras.take(connection, cameras.add(connection, f"{USB}3"), 60)
        assert cameras.take(connection, cameras.add(connection, "gphoto2://ptpip:host"), 60)


def test_ports_of_usb_are_used_at_once(engine: sa.Engine) -> None:
    _add(engine, "a", "gphoto2://usb:001,004")
    _add(engine, "b", "gphoto2://usb:001,005")
    _add(engine, "c", f"{USB}1")
    assert _claim(engine, "a") and _claim(engine, "b")
    assert _claim(engine, "c") is None


def _see(engine: sa.Engine, address: str, host: str | None, answered: bool = True) -> str:
    """Have an API on a host look at a camera; its id."""
    with engine.begin() as connection:
        camera = cameras.add(connection, address)
        cameras.give_back(connection, camera, 0.0, INFO if answered else None, answered, host)
    return camera


def _work_on(engine: sa.Engine, *hosts: str) -> None:
    """Have a worker live on each of these hosts, and no other."""
    with engine.begin() as connection:
        connection.execute(sa.delete(tables.workers))
        for host in hosts:
            heartbeats.beat(connection, f"{host}-123-0a1b2c3d")


def _host(engine: sa.Engine, address: str) -> str | None:
    with engine.begin() as connection:
        return cameras.host_of(connection, cameras.add(connection, address))


def test_a_camera_on_usb_is_left_to_workers_of_the_host_that_saw_it(engine: sa.Engine) -> None:
    _work_on(engine, "studio", "studio-b")
    assert _host(engine, f"{USB}1") is None
    _see(engine, f"{USB}1", "studio")
    _see(engine, f"{USB}2", "studio-b")
    _see(engine, ADDRESS, "studio")
    hosts = [_host(engine, address) for address in (f"{USB}1", f"{USB}2", f"{USB}3", ADDRESS)]
    assert hosts == ["studio", "studio-b", None, None]
    assert _host(engine, USB) == _host(engine, "gphoto2://") == "studio-b"  # seen last
    _see(engine, f"{USB}2", "studio")  # it was carried there
    assert _host(engine, f"{USB}2") == "studio"


def test_a_worker_that_starts_anew_is_waited_for(engine: sa.Engine) -> None:
    _work_on(engine, "studio")
    _see(engine, f"{USB}1", "studio")
    _work_on(engine, "other")
    _see(engine, f"{USB}1", "studio")
    _see(engine, f"{USB}1", "elsewhere", answered=False)
    _see(engine, f"{USB}1", None)
    assert _host(engine, f"{USB}1") == "studio"


def test_where_no_worker_has_been_any_may_try(engine: sa.Engine) -> None:
    _work_on(engine, "studio")
    _see(engine, f"{USB}1", "container-of-the-api")
    assert _host(engine, f"{USB}1") is None
    _see(engine, f"{USB}1", "studio")
    _see(engine, f"{USB}1", "container-of-the-api")
    assert _host(engine, f"{USB}1") is None


def test_a_camera_may_hang_on_another_host_unless_this_one_has_seen_it(engine: sa.Engine) -> None:
    _work_on(engine, "studio", "other")
    seen = _see(engine, f"{USB}1", "studio")
    with engine.begin() as connection:
        unseen = cameras.add(connection, f"{USB}2")
        network = cameras.add(connection, "ptp+ip://192.168.1.20")
        found = [
            cameras.may_be_elsewhere(connection, camera, host)
            for camera, host in ((seen, "studio"), (seen, "other"), (unseen, "studio"))
        ]
        assert found == [False, True, True]
        assert not cameras.may_be_elsewhere(connection, network, "studio")


def test_a_camera_on_usb_is_listed_alone(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        cameras.add(connection, f"{USB}1")
        assert [one.address for one in cameras.find_all(connection, [f"{USB}1"])] == [f"{USB}1"]


def test_cameras_are_listed_by_address_and_where_jobs_use_them(
    engine: sa.Engine, camera: str
) -> None:
    with engine.begin() as connection:
        cameras.add(connection, "sim://studio")  # that nobody asks for any more
    _add(engine, "a", OTHER)
    _add(engine, "b", "sim://studio?lights=3", state=State.FAILED)
    _add(engine, "c", "sim://studio?lights=2", inputs={"flash": {}})  # which has its pair
    with engine.connect() as connection:
        found = cameras.find_all(connection, [f"{ADDRESS}:15740"])
    assert [(one.address, one.waiting) for one in found] == [(ADDRESS, 0), (OTHER, 1)]
    assert found[0].id == camera


def test_places_in_the_queue_are_those_of_the_jobs_own_queue(engine: sa.Engine) -> None:
    _add(engine, "a")
    _add(engine, "b")
    _add(engine, "c", OTHER)
    _add(engine, "d", inputs={"flash": {}})
    with engine.connect() as connection:
        shown = [job for job in (jobs.find(connection, one) for one in "abcd") if job]
        assert waiting.positions(connection, shown) == {"a": 1, "b": 2, "c": 1, "d": 1}


def test_cameras_are_found_by_few_looks_and_none_at_jobs_that_have_ended(
    engine: sa.Engine,
) -> None:
    for number in range(5):
        _add(engine, f"{number}", f"{USB}{number}")
    assert _claim(engine, "0")
    with engine.connect() as connection, plans(engine) as found:
        assert len(cameras.find_all(connection, [])) == 5
    assert len(found) == 4
    held, waiting, *_ = found
    assert "(state=?" in held and "(state=?" in waiting  # by whichever index has the states first


def test_cameras_that_nobody_uses_are_forgotten(engine: sa.Engine) -> None:
    _add(engine, "a", OTHER)
    with engine.begin() as connection:
        cameras.add(connection, ADDRESS)
        cameras.add(connection, "sim://studio")
        cameras.note(connection, cameras.id_of("sim://studio"), INFO)
        first = cameras.add(connection, "sim://studio?lights=2")
        assert cameras.take(connection, first, 60)  # a look that goes on
        cameras.forget_unused(connection)
        left = connection.execute(sa.select(tables.cameras.c.address)).scalars().all()
    assert sorted(left) == [OTHER, "sim://studio", "sim://studio?lights=2"]
