from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

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


def test_the_environment_sets_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", "postgresql://db/lightlayers")
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", "s3://bucket/prefix")
    monkeypatch.setenv("LIGHTLAYERS_PORT", "9000")
    settings = Settings()
    assert settings.database_url == "postgresql://db/lightlayers"
    assert settings.store_url == "s3://bucket/prefix"
    assert settings.port == 9000


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("PORT", "70000"),
        ("PORT", "http"),
        ("WORKER_CONCURRENCY", "0"),
        ("JOB_SECONDS", "-1"),
        ("FREE_BYTES", "-1"),
        ("QUEUED_JOBS", "0"),
    ],
)
def test_a_setting_out_of_range_is_refused(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(f"LIGHTLAYERS_{name}", value)
    with pytest.raises(ValidationError, match=name.lower()):
        Settings()


def test_every_setting_says_what_it_is() -> None:
    for name, field in Settings.model_fields.items():
        assert field.description and field.description.endswith("."), name
