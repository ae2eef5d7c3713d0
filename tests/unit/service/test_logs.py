from __future__ import annotations

import json
import logging
from collections.abc import Iterator

import pytest

from service import logs


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    root, ours = logging.getLogger(), logging.getLogger("service")
    handlers, level, own = root.handlers[:], root.level, ours.level
    yield
    root.handlers[:] = handlers
    root.setLevel(level)
    ours.setLevel(own)


def test_a_line_is_one_object_with_the_job(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure()
    logging.getLogger("service.workers.attempt").info(
        "failed: %s", "why", extra={"job": "7", "other": 1}
    )
    line = json.loads(capsys.readouterr().err)
    assert line.pop("time").endswith("+00:00")
    assert line == {
        "level": "info",
        "logger": "service.workers.attempt",
        "message": "failed: why",
        "job": "7",
    }


def test_a_traceback_stays_on_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure()
    try:
        raise ValueError("broken")
    except ValueError:
        logging.getLogger("service").exception("failed")
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "ValueError: broken" in json.loads(lines[0])["traceback"]


def test_what_broke_a_request_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure()
    library = logging.getLogger("uvicorn.error")
    try:
        raise ValueError("broken")
    except ValueError:
        library.exception("Exception in ASGI application\n")
        library.exception("something else")
    (line,) = capsys.readouterr().err.splitlines()
    assert json.loads(line)["message"] == "something else"


def test_libraries_speak_from_warnings_on(capsys: pytest.CaptureFixture[str]) -> None:
    logs.configure()
    logging.getLogger("uvicorn").info("chatter")
    logging.getLogger("uvicorn").warning("trouble")
    assert [json.loads(line)["message"] for line in capsys.readouterr().err.splitlines()] == [
        "trouble"
    ]
