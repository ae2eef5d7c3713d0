"""A set-up to be looked at."""

from __future__ import annotations

from pathlib import Path

import pytest

from service.api.context import Context
from service.doctor import examine
from service.rows import heartbeats
from service.settings import MIB, Settings
from tests.ports import free_port
from tests.unit.service.findings import Look


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
