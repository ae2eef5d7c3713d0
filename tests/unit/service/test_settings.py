from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from service.rows import database
from service.sentences import sentence_of
from service.settings import Settings


def test_the_default_is_the_embedded_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = Settings()
    assert settings.data_dir == tmp_path / ".lightlayers"
    assert settings.database_url == f"sqlite:///{tmp_path}/.lightlayers/lightlayers.sqlite"
    assert settings.store_url == f"file://{tmp_path}/.lightlayers/store"
    assert (settings.host, settings.port) == ("127.0.0.1", 8000)


def test_database_and_store_follow_the_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", "/srv/light layers")
    settings = Settings()
    assert settings.database_url == "sqlite:////srv/light layers/lightlayers.sqlite"
    assert settings.store_url == "file:///srv/light%20layers/store"


@pytest.mark.parametrize("name", ["what?", "a%41b", "%2F", "a#b", "a@b:c", "ü +&=", "\udcff"])
def test_the_database_is_in_its_folder_whatever_that_is_called(name: str, tmp_path: Path) -> None:
    folder = tmp_path / name
    engine = database.connect(Settings(data_dir=folder).database_url)
    engine.connect().close()
    engine.dispose()
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (folder / "lightlayers.sqlite").is_file()


def test_the_environment_sets_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", "postgresql://db/lightlayers")
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", "s3://bucket/prefix")
    monkeypatch.setenv("LIGHTLAYERS_PORT", "9000")
    settings = Settings()
    assert settings.database_url == "postgresql://db/lightlayers"
    assert settings.store_url == "s3://bucket/prefix"
    assert settings.port == 9000


def test_jobs_are_kept_for_ever_unless_the_operator_says_how_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert Settings().retention_seconds is None
    monkeypatch.setenv("LIGHTLAYERS_RETENTION_DAYS", "0.5")
    assert Settings().retention_seconds == 43200


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PORT", "70000"),
        ("PORT", "http"),
        ("WORKER_CONCURRENCY", "0"),
        ("WORKER_CONCURRENCY", str(2**63)),  # more than the queue's table takes
        ("JOB_SECONDS", "-1"),
        ("FREE_BYTES", "-1"),
        ("JOB_MEMORY_BYTES", str(2**30 - 1)),  # less than any job takes
        ("QUEUED_JOBS", "0"),
        ("QUEUED_JOBS_PER_KEY", "0"),
        ("RETENTION_DAYS", "0"),
        ("RETENTION_DAYS", "inf"),
        ("SWEEP_SECONDS", "61"),
        *((name, host) for name in ("HOST", "METRICS_HOST") for host in ("a..b", "x" * 64)),
        *(
            (name.upper(), value)
            for name, field in Settings.model_fields.items()
            if field.annotation is float
            for value in ("inf", "nan", "1e300")
        ),
        *(
            (name.upper(), "1e-320")  # which is no time at all
            for name, field in Settings.model_fields.items()
            if field.annotation is float
            and name not in ("flash_settle_seconds", "patience_seconds", "drain_seconds")
        ),
        ("RETENTION_DAYS", "1e-320"),
        *((name, str(2**63)) for name in ("REQUESTS", "QUEUED_JOBS", "FREE_BYTES")),
        *(
            (name, str(2**63))
            for name in ("UPLOAD_BYTES", "JOB_MEMORY_BYTES", "JOB_OUTPUT_BYTES", "JOB_OPEN_FILES")
        ),
    ],
)
def test_a_setting_out_of_range_is_refused(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", value)
    with pytest.raises(ValidationError, match=name.lower()):
        Settings()


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("UPLOAD_BYTES", "1", "for no photograph fits in it: write 1048576 or more"),
        ("JOB_OUTPUT_BYTES", "1", "for the results of no photograph fit in it: write 1048576 or"),
        ("JOB_SECONDS", "0.9", "for no job ends in it: write 1 or more"),
        ("PAUSE_SECONDS", "0.9", "write 1 or more"),
        ("OPERATOR_SECONDS", "0.9", "write 1 or more"),
        ("WEBHOOK_SECONDS", "0.9", "write 1 or more"),
        ("UPLOAD_SECONDS", "59", "write 60 or more"),
        ("HEARTBEAT_SECONDS", "0.09", "write 0.1 or more"),
        ("SILENCE_SECONDS", "0.9", "write 1 or more"),
    ],
)
def test_what_could_not_work_is_refused_with_what_can(
    name: str, value: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_HEARTBEAT_SECONDS", "0.1")
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", value)
    with pytest.raises(ValidationError) as caught:
        Settings()
    sentence = sentence_of(caught.value)
    assert sentence.startswith(f"{name.lower()}: {value} is too little, ")
    assert told in sentence
    assert sentence.endswith(", or leave the variable out.")


_PLACES = ("DATA_DIR", "CALIBRATIONS_DIR", "DATABASE_URL", "STORE_URL", "HOST", "METRICS_HOST")


@pytest.mark.parametrize("value", ["", " "])
@pytest.mark.parametrize("name", _PLACES)
def test_a_place_that_is_empty_is_none(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", value)
    with pytest.raises(ValidationError) as caught:
        Settings()
    told = f"{name.lower()}: it is empty: name one, or leave the variable out."
    assert sentence_of(caught.value) == told


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("POLL_SECONDS", 0.01),
        ("PATIENCE_SECONDS", 0),
        ("DRAIN_SECONDS", 0),
        ("RETENTION_DAYS", 0.001),
        ("QUEUED_JOBS", 1),
        ("QUEUED_JOBS_PER_KEY", 1),
        ("REQUESTS", 1),
        ("UPLOAD_BYTES", 2**20),
        ("JOB_MEMORY_BYTES", 2**30),
        ("JOB_OUTPUT_BYTES", 2**20),
        ("JOB_SECONDS", 1),
        ("WORKER_CONCURRENCY", 1),
        ("FREE_BYTES", 0),
        ("SWEEP_SECONDS", 1),
        ("SWEEP_SECONDS", 60),
        ("PORT", 65535),
    ],
)
def test_a_setting_may_be_as_small_or_large_as_its_bound(
    name: str, value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", str(value))
    assert getattr(Settings(), name.lower()) == value


@pytest.mark.parametrize(
    ("heartbeat", "silence", "needed"),
    [("7.6", None, "15.2"), ("20", "20", "40"), ("3", "5.9", "6"), (None, "1", "6")],
)
def test_a_worker_that_lives_is_heard_before_the_silence_is_over(
    heartbeat: str | None, silence: str | None, needed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if heartbeat:
        monkeypatch.setenv("LIGHTLAYERS_HEARTBEAT_SECONDS", heartbeat)
    if silence:
        monkeypatch.setenv("LIGHTLAYERS_SILENCE_SECONDS", silence)
    with pytest.raises(ValidationError) as caught:
        Settings()
    assert sentence_of(caught.value) == (
        f"silence_seconds: {silence or 15} s is less than two heartbeats, so that jobs were taken "
        f"from workers that live: write {needed} or more, or lower LIGHTLAYERS_HEARTBEAT_SECONDS."
    )
    monkeypatch.setenv("LIGHTLAYERS_SILENCE_SECONDS", needed)
    assert Settings().silence_seconds == float(needed)


def test_every_setting_says_what_it_is() -> None:
    for name, field in Settings.model_fields.items():
        assert field.description and field.description.endswith("."), name


@pytest.mark.parametrize(
    ("order", "fault"),
    [
        ("relay on", r"write \{state\} where on or off is to stand"),
        ("http://relay/?on", r"write \{state\}"),
        ("relay '{state}", r"the command cannot be read \(no closing quotation\)"),
    ],
)
def test_an_order_for_a_flash_must_say_what_is_wanted(order: str, fault: str) -> None:
    with pytest.raises(ValidationError, match=fault):
        Settings(flash_switch=order)


def test_a_flash_has_no_switch_unless_its_operator_names_one() -> None:
    assert Settings().flash_switch is None
    assert Settings(flash_switch="relay '{state}'").flash_switch == "relay '{state}'"


@pytest.mark.parametrize(
    ("cameras", "strange"),
    [
        ("sim://,ptp+usb://", "sim://,ptp+usb://"),
        ("sim:// ptpip://192.168.1.20", "ptpip://192.168.1.20"),
        ("192.168.1.20", "192.168.1.20"),
    ],
)
def test_what_no_camera_s_address_begins_with_is_refused(cameras: str, strange: str) -> None:
    with pytest.raises(ValidationError) as refused:
        Settings(cameras=cameras)
    assert sentence_of(refused.value) == (
        f"cameras: {strange!r} is no beginning of a camera's address: write some that start with "
        "sim://, ptp+usb://, ptp+ip://, gphoto2://, separated by spaces."
    )


@pytest.mark.parametrize(
    "cameras",
    ["", "sim", "gphoto2://usb:001,004 ptp+ip://[fe80::1]:15740", "sim://studio?lights=3"],
)
def test_beginnings_of_addresses_of_every_kind_are_taken(cameras: str) -> None:
    assert Settings(cameras=cameras).cameras == cameras
