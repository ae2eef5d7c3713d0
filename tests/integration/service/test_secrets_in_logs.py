"""What a service writes down while it is used, well and badly."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Protocol

import httpx

import drivers

SECRET = "whsec_" + "C2FVsBQIhrscChlQIMV+b5sSYspob7oD"
NAME = "Anna Beispiel am Strand.jpg"


class _Service(Protocol):
    http: httpx.Client
    log: Path
    url: str
    environment: dict[str, str]

    def await_end(self, job: dict[str, Any]) -> dict[str, Any]: ...

    def kill(self) -> None: ...


def test_the_log_has_traces_and_no_secrets(
    keyed_service: tuple[_Service, str], small_pair: drivers.CapturedPair, tmp_path: Path
) -> None:
    service, key = keyed_service
    handling = {"webhook": {"url": "https://hooks.invalid/told?token=hush", "secret": SECRET}}
    good = {"no_flash": (NAME, small_pair.no_flash.best), "flash": (NAME, small_pair.flash.best)}
    bad = {"no_flash": (NAME, b"\xff\xd8\xff" + NAME.encode()), "flash": (NAME, b"II*\0")}
    data = {"handling": json.dumps(handling), "options": '{"lights": 2}'}
    trace = "0af7651916cd43dd8448eb211c80319c"
    told = {"traceparent": f"00-{trace}-b7ad6b7169203331-01"}
    assert service.http.post("/jobs", files=bad, data=data).status_code == 422
    made = service.http.post("/jobs", files=good, data=data, headers=told).json()
    assert service.http.get("/jobs", headers={"authorization": key}).status_code == 401
    assert service.http.get(f"/jobs/{key}").status_code == 404
    assert service.await_end(made)["state"] == "succeeded"
    refused = subprocess.run(
        [sys.executable, "-m", "service.cli", "submit", "a", "b", "-o", str(tmp_path / "out")],
        env={**service.environment, "LIGHTLAYERS_KEY": key[:-1]},
        capture_output=True,
    )
    assert refused.returncode == 2 and key[:-1] not in refused.stderr.decode()
    service.kill()
    log = service.log.read_text()
    lines = [json.loads(line) for line in log.splitlines()]
    ended = [line for line in lines if line.get("job") == made["id"]]
    assert ended and {line["trace_id"] for line in ended} == {trace}
    for secret in (key, key[14:], SECRET, "hush", "Beispiel", "Bearer", "GET /", "JFIF"):
        assert secret not in log
