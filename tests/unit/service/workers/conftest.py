"""A worker without its processes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from service.settings import Settings
from service.workers import worker
from service.workers.worker import Worker


@pytest.fixture
def one(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    """A worker that lives, whose queue is the test, and that does not wait before it retries."""
    monkeypatch.setattr(worker, "_RETRY_SECONDS", 0.0)
    one = Worker(settings)
    one.upkeep._beat()
    yield one
    one._engine.dispose()
