"""The image as compose.yaml runs it, with a database and a store on this machine.

`make image` builds the image and runs this; it takes root and buildah. There is no container
engine: each service is a process in the image's files, which it may not write, as the image's
user and without capabilities, with the commands and the variables of the compose file.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest
import yaml

import drivers
from tests.ports import free_port

_COMPOSE = Path(__file__).parents[3] / "docker" / "compose.yaml"
_IMAGE = os.environ.get("IMAGE", "lightlayers")
_SIGNED = {
    "AWS_SKIP_SIGNATURE": "false",  # this store is not open to all
    "AWS_ACCESS_KEY_ID": "test",
    "AWS_SECRET_ACCESS_KEY": "test",
}
_ENTER = """
set -eu
mount --bind "$ROOT" "$ROOT"
mount --rbind /dev "$ROOT/dev"
mount --rbind /proc "$ROOT/proc"
mount -t tmpfs tmpfs "$ROOT/tmp"
for volume in $VOLUMES; do mount --bind "$FOLDER$volume" "$ROOT$volume"; done
mount -o remount,bind,ro "$ROOT"
exec chroot "$ROOT" setpriv --reuid "${OWNER%:*}" --regid "${OWNER#*:}" --init-groups \\
    --no-new-privs --bounding-set=-all --inh-caps=-all env -i "$@"
"""


class Image(NamedTuple):
    """The files of the image, and what its configuration says."""

    root: Path
    config: dict[str, Any]


class Stack:
    """The services of the compose file, without containers."""

    def __init__(self, image: Image, folder: Path, replaced: dict[str, str]) -> None:
        self._image = image
        self._folder = folder
        self._replaced = replaced
        self._processes: list[subprocess.Popen[bytes]] = []
        self.services = yaml.safe_load(_COMPOSE.read_text())["services"]

    def start(self, name: str, number: int, **also: str) -> subprocess.Popen[bytes]:
        """Run a service: command and variables of the compose file, `also` on top."""
        service = self.services[name]
        entry = service.get("entrypoint", self._image.config["Entrypoint"])
        return self._run(name, number, [*entry, *service["command"]], also)

    def say(self, name: str, *command: str) -> str:
        """Run another command of the program as a service, to its end; what it prints."""
        words = [*self._image.config["Entrypoint"], *command]
        process = self._run(name, 0, words, {}, subprocess.PIPE)
        said, _ = process.communicate(timeout=120)
        assert process.returncode == 0
        return said.decode().strip()

    def check(self, name: str, number: int) -> int:
        """Run the health check of a service; its exit code."""
        _, *command = self.services[name]["healthcheck"]["test"]
        return self._run(name, number, command, {}).wait(120)

    def _run(
        self,
        name: str,
        number: int,
        command: list[str],
        also: dict[str, str],
        stdout: int | None = None,
    ) -> subprocess.Popen[bytes]:
        service = self.services[name]
        assert service["read_only"] and service["cap_drop"] == ["ALL"]
        folder = self._volumes(f"{name}{number}")
        pairs = [pair.split("=", 1) for pair in self._image.config["Env"]]
        given = {key: str(value) for key, value in service.get("environment", {}).items()}
        variables = {**dict(pairs), **given, **_SIGNED, **also}
        words = [*[f"{key}={value}" for key, value in variables.items()], *command]
        process = subprocess.Popen(
            ["unshare", "--mount", "sh", "-c", _ENTER, "sh", *map(self._replace, words)],
            env={
                **os.environ,
                "ROOT": str(self._image.root),
                "FOLDER": str(folder),
                "VOLUMES": " ".join(self._image.config["Volumes"]),
                "OWNER": self._image.config["User"],
            },
            stdout=stdout,
        )
        self._processes.append(process)
        return process

    def _volumes(self, name: str) -> Path:
        """A folder for each volume, which begins with what the image has there."""
        folder = self._folder / name
        for volume in self._image.config["Volumes"]:
            if not (folder / volume[1:]).exists():
                (folder / volume[1:]).parent.mkdir(parents=True, exist_ok=True)
                source = self._image.root / volume[1:]
                subprocess.run(["cp", "-a", source, folder / volume[1:]], check=True)
        return folder

    def _replace(self, word: str) -> str:
        for old, new in self._replaced.items():
            word = word.replace(old, new)
        return word

    def close(self) -> None:
        """End what still runs."""
        for process in self._processes:
            if process.poll() is None:
                process.kill()
            process.wait()


@pytest.fixture(scope="module")
def image() -> Iterator[Image]:
    def buildah(*words: str) -> str:
        return subprocess.run(
            ["buildah", *words], check=True, stdout=subprocess.PIPE, text=True
        ).stdout.strip()

    container = buildah("from", "--pull-never", _IMAGE)
    root = Path(buildah("mount", container))
    yield Image(root, json.loads(buildah("inspect", container))["OCIv1"]["config"])
    buildah("rm", container)


@pytest.fixture
def ports() -> list[int]:
    """Free ports."""
    return [free_port() for _ in range(4)]


@pytest.fixture
def stack(
    image: Image, tmp_path: Path, ports: list[int], postgresql: str, s3: dict[str, str]
) -> Iterator[Stack]:
    replaced = {
        "${POSTGRES_PASSWORD:?set one}": "secret",
        "@database/": f"@{postgresql.partition('@')[2].partition('/')[0]}/",
        "http://store:8333": s3["AWS_ENDPOINT_URL"],
        "127.0.0.1:8000": f"127.0.0.1:{ports[0]}",  # other services of this machine have these
        "127.0.0.1:9100": f"127.0.0.1:{ports[2]}",
    }
    for parent in [tmp_path, *tmp_path.parents[:3]]:
        parent.chmod(parent.stat().st_mode | 0o055)  # the last one may be /tmp, with more bits
    stack = Stack(image, tmp_path, replaced)
    yield stack
    stack.close()


@pytest.mark.timeout(900)
def test_the_image_runs_jobs_as_the_compose_file_says(
    stack: Stack, image: Image, ports: list[int]
) -> None:
    assert image.config["User"] == "10001:10001"
    url, pair = f"http://127.0.0.1:{ports[0]}", _pair()
    assert stack.start("bucket", 1).wait(120) == 0
    assert stack.start("migrate", 1).wait(120) == 0
    # It listens on every network, so it does not start without a key.
    key = stack.say("api", "keys", "create", "phone", "--scopes", "submit,read,capture")
    api = stack.start(
        "api", 1, LIGHTLAYERS_PORT=str(ports[0]), LIGHTLAYERS_METRICS_PORT=str(ports[1])
    )
    assert stack.services["worker"]["deploy"]["replicas"] == 2
    workers = [
        stack.start("worker", number, LIGHTLAYERS_METRICS_PORT=str(ports[number + 1]))
        for number in (1, 2)
    ]
    bearing = {"authorization": f"Bearer {key}"}
    with httpx.Client(base_url=url, timeout=60, headers=bearing) as http:
        _await_that("the service is ready", lambda: _is_ready(http, api))
        assert httpx.get(f"{url}/jobs").status_code == 401
        assert [stack.check("api", 1), stack.check("worker", 1)] == [0, 0]
        metrics = httpx.get(f"http://127.0.0.1:{ports[1]}/metrics").text
        assert "lightlayers_workers 2.0" in metrics
        camera = {"capture": {"camera": "sim://studio?lights=2&width=300&height=200"}}
        files = {"no_flash": pair.no_flash.best, "flash": pair.flash.best}
        made = [
            (http.post("/jobs", json=camera), 2),  # for its pair, and for the rest
            (http.post("/jobs", files=files), 1),
        ]
        for answer, starts in made:
            assert answer.status_code == 202, answer.text
            end = _await_that("the job ends", partial(_ended, http, answer.json()))
            assert end["state"] == "succeeded", end
            file = end["files"][0]
            assert len(http.get(file["href"]).content) == file["size"]
            assert end["attempt"] == starts
        # A rolling restart: the worker that stops puts its job back, and another does it.
        job = http.post("/jobs", json=camera).json()
        workers[0].send_signal(signal.SIGTERM)
        assert workers[0].wait(15) == 0
        assert _await_that("the job ends", partial(_ended, http, job))["state"] == "succeeded"
    for process in (workers[1], api):
        process.send_signal(signal.SIGTERM)
        assert process.wait(45) == 0


def _pair() -> drivers.CapturedPair:
    with drivers.open_camera("sim://studio?lights=2&width=300&height=200") as camera:
        return drivers.capture_pair(camera)


def _await_that(what: str, happened: Callable[[], Any]) -> Any:
    """Wait until a function gives something true; what it gave."""
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline:
        if value := happened():
            return value
        time.sleep(0.1)
    pytest.fail(f"waited in vain until {what}")


def _is_ready(http: httpx.Client, api: subprocess.Popen[bytes]) -> bool:
    assert api.poll() is None
    try:
        return http.get("/readyz").status_code == 200
    except httpx.TransportError:
        return False


def _ended(http: httpx.Client, job: dict[str, Any]) -> dict[str, Any] | None:
    now: dict[str, Any] = http.get(job["links"]["self"]).raise_for_status().json()
    return now if now["state"] in ("succeeded", "failed", "canceled") else None
