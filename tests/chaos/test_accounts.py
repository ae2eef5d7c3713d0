from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.chaos.accounts import noticed
from tests.chaos.takeovers import Takeovers


def _service(folder: Path, *lines: tuple[str, str, float]) -> Any:
    """A service whose log has (message, job, seconds since 1970), and a line that was cut short."""
    entries = [
        {"message": message, "job": job, "time": datetime.fromtimestamp(when, UTC).isoformat()}
        for message, job, when in lines
    ]
    log = folder / "log"
    log.write_text("\n".join(map(json.dumps, entries)) + '\n{"message": "taken o')
    return SimpleNamespace(hosts=[SimpleNamespace(log=log)])


def _takeovers(*lost: tuple[str, float, float]) -> Takeovers:
    """Jobs that lost their worker at a second, and had another after so many more."""
    takeovers = Takeovers(SimpleNamespace())  # type: ignore[arg-type]
    takeovers.lost_at = [(job, since) for job, since, _ in lost]
    takeovers.seconds = [took for _, _, took in lost]
    return takeovers


def test_each_job_is_back_in_the_queue_before_its_next_attempt(tmp_path: Path) -> None:
    service = _service(
        tmp_path,
        ("taken over", "a", 1012.0),
        ("taken over", "b", 1003.0),
        ("started", "c", 1001.0),
    )
    takeovers = _takeovers(("a", 1000.0, 14.0), ("b", 1001.0, 4.0), ("c", 1000.0, 2.0))
    assert noticed(service, takeovers) == pytest.approx([12.0, 2.0])


def test_a_later_takeover_is_not_taken_for_one_that_no_log_has(tmp_path: Path) -> None:
    service = _service(tmp_path, ("taken over", "a", 1040.0))
    assert noticed(service, _takeovers(("a", 1000.0, 3.0), ("a", 1036.0, 5.0))) == [4.0]
