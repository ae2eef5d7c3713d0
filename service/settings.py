"""What an operator may set, read from the environment: LIGHTLAYERS_<NAME>."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field
from pydantic_settings import BaseSettings, SettingsConfigDict

MIB = 1024 * 1024


def _store_in(data: dict[str, Any]) -> str:
    folder: Path = data["data_dir"]
    return (folder / "store").as_uri()


def _database_in(data: dict[str, Any]) -> str:
    folder: Path = data["data_dir"]
    return f"sqlite:///{folder / 'lightlayers.sqlite'}"


class Settings(BaseSettings):
    """Settings of API and worker processes; every process of one service needs the same ones.

    The defaults are the embedded service: SQLite and a folder, both under data_dir. An S3 store
    takes its endpoint and credentials from the usual AWS_… variables.
    """

    model_config = SettingsConfigDict(env_prefix="LIGHTLAYERS_", frozen=True)

    data_dir: Annotated[Path, AfterValidator(Path.absolute)] = Field(
        default=Path(".lightlayers"),
        validate_default=True,
        description="Folder of the embedded database and store and of running jobs.",
    )
    database_url: str = Field(
        default_factory=_database_in,
        description="sqlite:///… or postgresql://… of jobs and queue.",
    )
    store_url: str = Field(
        default_factory=_store_in, description="file:///… or s3://bucket/prefix of photographs."
    )
    host: str = Field(default="127.0.0.1", description="Address the API listens on.")
    port: int = Field(default=8000, ge=0, le=65535, description="Port of the API; 0 takes any.")
    upload_bytes: int = Field(
        default=512 * MIB, gt=0, description="Largest accepted request, in bytes."
    )
    queued_jobs: int = Field(
        default=4000, gt=0, description="Jobs that may wait in all; more are refused with 429."
    )
    queued_jobs_per_key: int = Field(
        default=1000, gt=0, description="Jobs of one key that may wait; more are refused with 429."
    )
    free_bytes: int = Field(
        default=1024 * MIB,
        ge=0,
        description="Space that new jobs leave free on the disk of a local store, in bytes; with "
        "less they are refused with 507.",
    )
    worker_concurrency: int = Field(
        default=1, ge=1, description="Jobs a worker runs at a time; they share the processors."
    )
    job_memory_bytes: int = Field(
        default=8192 * MIB, gt=0, description="Address space of one job's process, in bytes."
    )
    job_open_files: int = Field(
        default=256, ge=16, description="Files that one job's process may have open at a time."
    )
    job_output_bytes: int = Field(
        default=16384 * MIB,
        gt=0,
        description="What one job may write: all of its photographs and results, in bytes.",
    )
    job_seconds: float = Field(default=900, gt=0, description="Longest run of one job, in seconds.")
    patience_seconds: float = Field(
        default=300,
        ge=0,
        description="How long a job waits for a store that is away or a disk that is full before "
        "it fails.",
    )
    poll_seconds: float = Field(
        default=0.5, gt=0, description="How often a worker looks for a job, in seconds."
    )
    heartbeat_seconds: float = Field(
        default=3, gt=0, description="How often a worker says that it lives, in seconds."
    )
    silence_seconds: float = Field(
        default=15, gt=0, description="Silence after which others take a worker's jobs over."
    )
    retention_days: float | None = Field(
        default=None,
        gt=0,
        le=36500,
        description="How long jobs that have ended are kept with their photographs and results; "
        "without it, until they are deleted.",
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
