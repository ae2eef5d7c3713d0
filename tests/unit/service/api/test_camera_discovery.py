"""What the API makes of the process that asks a camera, where that ends without an answer."""

from __future__ import annotations

import contextlib
import errno
import tempfile
from collections.abc import Iterator

import httpx
import pytest

import drivers
from service.api.camera_discovery import CameraDiscovery
from service.api.context import Context
from service.errors import AttemptError, CrashError, KilledError, NoProcessError, TimeLimitError
from service.rows import cameras
from service.settings import Settings
from service.workers import sandbox
from tests.unit.service.asking import problem_of
from tests.unit.service.at_first import raising
from tests.unit.service.studio import PATH, SIM, with_cameras


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return with_cameras(settings)


@pytest.fixture
def discovery(context: Context) -> Iterator[CameraDiscovery]:
    made = CameraDiscovery(context.engine, context.settings, context.fork_server)
    with contextlib.closing(made):
        yield made


@pytest.mark.parametrize(
    ("death", "kind"),
    [
        (TimeLimitError("It took long."), drivers.CameraTimeoutError),
        (CrashError("It crashed."), drivers.DriverError),
        (KilledError("It was killed."), drivers.DriverError),
    ],
)
def test_a_camera_is_said_to_be_silent_only_where_time_is_up(
    death: AttemptError,
    kind: type[drivers.DriverError],
    discovery: CameraDiscovery,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sandbox, "run", raising(death))
    with pytest.raises(drivers.DriverError) as caught:
        discovery.adjust(SIM, {}, "1" * 32)
    assert (type(caught.value), str(caught.value)) == (kind, str(death))


def test_a_process_that_somebody_ends_is_asked_for_again(
    discovery: CameraDiscovery, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "run", raising(ChildProcessError()))
    with pytest.raises(drivers.DriverError, match=r"was ended: try again\.$"):
        discovery.adjust(SIM, {}, "1" * 32)


def test_a_camera_is_free_again_after_its_process_has_died(
    discovery: CameraDiscovery, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sandbox, "run", raising(CrashError("It crashed.")))
    with pytest.raises(drivers.DriverError):
        discovery.adjust(SIM, {}, "1" * 32)
    with context.engine.begin() as connection:
        camera = cameras.add(connection, SIM)
        assert cameras.take(connection, camera, 1.0) is not None


@pytest.mark.parametrize(
    ("place", "error", "told"),
    [
        ("run", CrashError("It crashed."), (503, "camera-failed", "It crashed.")),
        (
            "run",
            NoProcessError(),
            (503, "no-process", str(NoProcessError())),
        ),
        (
            "mkdtemp",
            OSError(errno.ENOSPC, "No space left on device"),
            (
                507,
                "storage-full",
                "The disk that takes photographs in is full; send this one again later.",
            ),
        ),
    ],
)
def test_a_request_for_settings_is_told_what_its_process_met(
    place: str,
    error: Exception,
    told: tuple[int, str, str],
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sandbox if place == "run" else tempfile, place, raising(error))
    answer = http.get(f"{PATH}/settings")
    assert problem_of(answer) == told
    described = http.get("/openapi.json").json()["paths"]["/cameras/{camera_id}/settings"]
    assert all(str(told[0]) in described[method]["responses"] for method in ("get", "patch"))
