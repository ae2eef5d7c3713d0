"""What the client does while a service may have one job waiting, and has it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import httpx
import pytest

from pipeline.options import Options
from service.api.problems import RETRY_SECONDS
from service.cli import run
from service.sending.client import Client, Job
from service.sending.failures import ServiceAwayError
from service.settings import Settings

Png = Callable[..., bytes]


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"queued_jobs": 1})


@pytest.fixture
def waiting(client: Client) -> Job:
    return client.submit_capture("sim://studio", Options())


def test_a_busy_service_is_tried_again_when_it_says(
    client: Client,
    png: Png,
    http: httpx.Client,
    waiting: Job,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pauses = []

    def sleep(seconds: float) -> None:
        pauses.append(seconds)
        http.post(waiting["links"]["cancel"]).raise_for_status()

    monkeypatch.setattr(
        "service.sending.client.time", SimpleNamespace(monotonic=lambda: 0.0, sleep=sleep)
    )
    job = client.submit_pair(png(64, 48), png(64, 48, True), Options())
    assert (job["state"], pauses) == ("queued", [RETRY_SECONDS])


@pytest.mark.usefixtures("waiting")
def test_a_service_that_stays_busy_is_given_up_in_the_end(
    client: Client, png: Png, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []

    def sleep(seconds: float) -> None:
        pauses.append(seconds)
        assert len(pauses) < 50

    clock = SimpleNamespace(monotonic=lambda: sum(pauses), sleep=sleep)
    monkeypatch.setattr("service.sending.client.time", clock)
    with pytest.raises(ServiceAwayError, match="waits already; send this one again later"):
        client.submit_pair(png(64, 48), png(64, 48, True), Options())
    assert pauses == [10] * 4 + [15] * 17  # one more would be beyond 300 s


@pytest.mark.usefixtures("waiting")
def test_a_busy_service_that_is_given_up_is_no_bad_input(
    pair: list[str],
    tmp_path: Path,
    http: httpx.Client,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("service.sending.client._PATIENCE_SECONDS", RETRY_SECONDS - 1.0)
    assert run(["submit", *pair, "-o", str(tmp_path / "out"), "--url", str(http.base_url)]) == 1
    assert "waits already; send this one again later" in capsys.readouterr().err
