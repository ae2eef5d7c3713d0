"""What an operator may set, read from the environment: LIGHTLAYERS_<NAME>."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo
from pydantic_settings import BaseSettings, SettingsConfigDict

from service.addresses import parse_networks

MIB = 1024 * 1024
_MOST = 2**62  # that the database and the system take, of bytes and files
_SHORTEST = 0.01
"""Of what takes seconds: a worker that looks more often does nothing else."""
_CAMERAS = "sim:// ptp+usb:// gphoto2://usb"
_MOST_TRIES = 20  # at the delivery to a webhook


def _store_in(data: dict[str, Any]) -> str:
    folder: Path = data["data_dir"]
    return (folder / "store").as_uri()


def _database_in(data: dict[str, Any]) -> str:
    folder: Path = data["data_dir"]
    path = str(folder / "lightlayers.sqlite")
    # The two that a URL reads as something else; sqlalchemy's own quoting takes UTF-8 alone.
    return f"sqlite:///{path.replace('%', '%25').replace('?', '%3F')}"


def _check_given(value: Any) -> Any:
    if isinstance(value, str) and not value.strip():
        raise ValueError("it is empty: name one, or leave the variable out")
    return value


def _check_host(host: str) -> str:
    _check_given(host)  # which would be every network
    try:
        host.encode("idna")  # as the system's look-up does, whose error is no OSError
    except UnicodeError as error:
        raise ValueError(f"{host!r} is neither an address nor a name of this machine") from error
    return host


def _check_networks(text: str) -> str:
    parse_networks(text)
    return text


def _check_origins(text: str) -> str:
    for origin in text.split():
        if not re.fullmatch(r"https?://[a-z0-9.-]+(:[0-9]{1,5})?", origin):
            raise ValueError(f"{origin!r} is no origin: write one like https://app.example")
    return text


def _check_cameras(text: str) -> str:
    if text == _CAMERAS:
        return text
    from drivers import SCHEMES  # only here: a separation loads no driver

    for part in text.split():
        scheme, _, rest = part.partition(":")
        if scheme not in SCHEMES or "://" in rest:
            known = ", ".join(f"{name}://" for name in SCHEMES)
            raise ValueError(
                f"{part!r} is no beginning of a camera's address: write some that start with "
                f"{known}, separated by spaces"
            )
    return text


def _check_switch(text: str | None) -> str | None:
    if text is not None:
        from drivers import check_flash_order  # only here: a separation loads no driver

        check_flash_order(text)
    return text


def _at_least(least: float, why: str) -> AfterValidator:
    """Refuse less, with which the service would start and not work; why: what would not."""

    def check(value: float) -> float:
        if value < least:
            raise ValueError(
                f"{value:g} is too little, {why}: write {least} or more, or leave the variable out"
            )
        return value

    return AfterValidator(check)


def _check_silence(seconds: float, info: ValidationInfo) -> float:
    heartbeat = info.data.get("heartbeat_seconds", 0.0)
    if seconds < 2 * heartbeat:
        raise ValueError(
            f"{seconds:g} s is less than two heartbeats, so that jobs were taken from workers that "
            f"live: write {2 * heartbeat:g} or more, or lower LIGHTLAYERS_HEARTBEAT_SECONDS"
        )
    return seconds


class Settings(BaseSettings):
    """Settings of API and worker processes; every process of one service needs the same ones.

    Only ports differ, where processes share a host. The defaults are the embedded service: SQLite
    and a folder, both under data_dir. An S3 store takes its endpoint and credentials from the usual
    AWS_… variables.
    """

    model_config = SettingsConfigDict(env_prefix="LIGHTLAYERS_", frozen=True)

    data_dir: Annotated[Path, BeforeValidator(_check_given), AfterValidator(Path.absolute)] = Field(
        default=Path(".lightlayers"),
        validate_default=True,
        description="Folder of the embedded database and store and of running jobs.",
    )
    calibrations_dir: Annotated[Path | None, BeforeValidator(_check_given)] = Field(
        default=None,
        description="Folder in which the command line keeps calibrations of a set-up; default: "
        "one of the user's own.",
    )
    database_url: Annotated[str, BeforeValidator(_check_given)] = Field(
        default_factory=_database_in,
        description="sqlite:///… or postgresql://… of jobs and queue.",
    )
    store_url: Annotated[str, BeforeValidator(_check_given)] = Field(
        default_factory=_store_in, description="file:///… or s3://bucket/prefix of photographs."
    )
    store_presign: bool = Field(
        default=False,
        description="Answer for a result in S3 with a redirect to a URL that is good for five "
        "minutes, in place of its bytes; clients must reach AWS_ENDPOINT_URL.",
    )
    host: Annotated[str, AfterValidator(_check_host)] = Field(
        default="127.0.0.1", description="Address the API listens on."
    )
    port: int = Field(default=8000, ge=0, le=65535, description="Port of the API; 0 takes any.")
    keys: Literal["loopback", "required"] = Field(
        default="loopback",
        description="Who needs a key: with `required` every request; with `loopback` none does "
        "where the service listens on loopback alone and no key was ever made. Set `required` "
        "behind a reverse proxy, whose requests all come from loopback.",
    )
    origins: Annotated[str, AfterValidator(_check_origins)] = Field(
        default="",
        description="Web pages of other sites that may ask (CORS), like https://app.example; "
        "separated by spaces.",
    )
    requests: int = Field(
        default=400,
        gt=0,
        le=_MOST,
        description="Requests answered at a time (concurrent requests); more are refused with 503.",
    )
    pause_seconds: Annotated[
        float, _at_least(1, "for a network may hold a connection up for as long")
    ] = Field(
        default=30,
        le=86400,
        description="Longest pause within a request or an answer before the connection is given "
        "up (idle timeout), in seconds: 1 at least.",
    )
    metrics_host: Annotated[str, AfterValidator(_check_host)] = Field(
        default="127.0.0.1", description="Address that Prometheus metrics are served on."
    )
    metrics_port: int | None = Field(
        default=None,
        ge=1,
        le=65534,
        description="Port of Prometheus metrics, of API and worker; the worker that `serve` starts "
        "takes the next one. Each further process on a host needs one of its own. None without it.",
    )
    cameras: Annotated[str, AfterValidator(_check_cameras)] = Field(
        default=_CAMERAS,
        description="Cameras that jobs may name, by address or by its beginning up to :, / or ?, "
        "separated by spaces. Those on the network must be here, like ptp+ip://192.168.1.20, or "
        "who sends jobs could have the service knock at any door.",
    )
    flash_switch: Annotated[str | None, AfterValidator(_check_switch)] = Field(
        default=None,
        description="What switches a flash that its camera cannot: a command, which no shell sees, "
        "or an http(s) URL, which is fetched; {state} in it becomes on or off.",
    )
    flash_settle_seconds: float = Field(
        default=1, ge=0, le=60, description="How long such a flash takes to obey, in seconds."
    )
    operator_seconds: Annotated[float, _at_least(1, "for nobody switches a flash in it")] = Field(
        default=300,
        le=86400,
        description="How long a job waits for its operator to switch the flash, in seconds: 1 at "
        "least.",
    )
    upload_bytes: Annotated[int, _at_least(MIB, "for no photograph fits in it")] = Field(
        default=512 * MIB,
        le=_MOST,
        description="Largest accepted request, and largest upload, in bytes: 1 MiB at least.",
    )
    upload_seconds: Annotated[
        float, _at_least(60, "for uploads would be gone before a job names them")
    ] = Field(
        default=86400,
        le=31536000,
        description="How long an upload that no job has used is kept after its last byte came, in "
        "seconds: 60 at least.",
    )
    queued_jobs: int = Field(
        default=4000,
        gt=0,
        le=_MOST,
        description="Jobs that may wait in all; more are refused with 429.",
    )
    queued_jobs_per_key: int = Field(
        default=1000,
        gt=0,
        le=_MOST,
        description="Jobs of one key that may wait; more are refused with 429.",
    )
    free_bytes: int = Field(
        default=1024 * MIB,
        ge=0,
        le=_MOST,
        description="Space that new jobs leave free on the disk of a local store, in bytes; with "
        "less they are refused with 507.",
    )
    worker_concurrency: int = Field(
        default=1,
        ge=1,
        le=1000,
        description="Jobs a worker runs at a time; they share the processors.",
    )
    job_memory_bytes: int = Field(
        default=8192 * MIB,
        ge=1024 * MIB,  # small pairs take 0.75 to 1, libraries included: with less, all fail
        le=_MOST,
        description="Address space of one job's process, in bytes.",
    )
    job_open_files: int = Field(
        default=256,
        ge=16,
        le=_MOST,
        description="Files that one job's process may have open at a time.",
    )
    job_output_bytes: Annotated[
        int, _at_least(MIB, "for the results of no photograph fit in it")
    ] = Field(
        default=16384 * MIB,
        le=_MOST,
        description="What one job may write: all of its photographs and results, in bytes: 1 MiB "
        "at least.",
    )
    job_seconds: Annotated[float, _at_least(1, "for no job ends in it")] = Field(
        default=900, le=86400, description="Longest run of one job, in seconds: 1 at least."
    )
    patience_seconds: float = Field(
        default=300,
        ge=0,
        le=86400,
        description="How long a job waits for a store that is away, a disk that is full, a machine "
        "that is out of processes or a worker as new as the service that took it, and tries again, "
        "before it fails (retry limit), in seconds.",
    )
    poll_seconds: float = Field(
        default=0.5,
        ge=_SHORTEST,
        le=86400,
        description="How often a worker looks for a job, in seconds; on PostgreSQL, for one of a "
        "camera that is on no host's USB, no more than once a second.",
    )
    heartbeat_seconds: Annotated[
        float, _at_least(0.1, "for the database would have nothing else to do")
    ] = Field(
        default=3,
        le=86400,
        description="How often a worker says that it lives, in seconds: 0.1 at least.",
    )
    drain_seconds: float = Field(
        default=0,
        ge=0,
        le=86400,
        description="How long an API that was told to stop goes on, with /readyz answering 503, so "
        "that balancers notice before the port closes, in seconds.",
    )
    stop_seconds: float = Field(
        default=30,
        ge=_SHORTEST,
        le=86400,
        description="How long requests may still take once the port is closed, in seconds.",
    )
    silence_seconds: Annotated[
        float,
        _at_least(1, "for workers that live are silent for as long"),
        AfterValidator(_check_silence),
    ] = Field(
        default=15,
        le=86400,
        description="Silence after which others take a worker's jobs over (heartbeat timeout), in "
        "seconds: two heartbeats and 1 at least.",
    )
    webhook_private: Annotated[str, AfterValidator(_check_networks)] = Field(
        default="false",
        description="Private networks that webhooks may be in, like 10.0.0.0/8,fd00::/8; true for "
        "all of them.",
    )
    webhook_https: bool = Field(default=False, description="Refuse webhooks without https.")
    webhook_seconds: Annotated[float, _at_least(1, "for few servers answer in it")] = Field(
        default=15,
        le=86400,
        description="What an attempt at delivery may take in all, in seconds: 1 at least.",
    )
    webhook_retry_seconds: float = Field(
        default=5,
        ge=_SHORTEST,
        le=86400,
        description="Wait after the first attempt at delivery that failed; each further one is 2.5 "
        "times as long.",
    )
    webhook_tries: int = Field(
        default=12,
        ge=1,
        le=_MOST_TRIES,
        description="Attempts at a delivery to a webhook; 12 last about a day.",
    )
    retention_days: float | None = Field(
        default=None,
        ge=0.001,
        le=36500,
        description="How long jobs that have ended are kept with their photographs and results; "
        "without it, until they are deleted, as calibrations are that are kept for a set-up. The "
        "time is set when a job ends: a later change is for jobs that end after it, and for those "
        "that were to be kept until they are deleted.",
    )
    sweep_seconds: int = Field(
        default=60,
        ge=1,
        le=60,
        description="How often the workers remove what is kept no longer, in seconds.",
    )

    @property
    def retention_seconds(self) -> float | None:
        """How long jobs that have ended are kept; None for as long as nobody deletes them."""
        return None if self.retention_days is None else self.retention_days * 86400

    @property
    def worker_metrics_port(self) -> int | None:
        """Port of the metrics of the worker that `serve` starts; None where there are none."""
        return None if self.metrics_port is None else self.metrics_port + 1
