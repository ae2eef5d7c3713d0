"""lightlayers as a customer runs it: the installed command, a real service, rendered pairs."""

from __future__ import annotations

import io
import itertools
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray

from drivers import CapturedPair, SimulatedTruth, capture_pair, open_camera, simulated_truth

COMMAND = Path(sys.executable).parent / "lightlayers"
PATIENCE_SECONDS = 120
WIDTH, HEIGHT = 360, 240

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Scene:
    """A simulated scene: its light and, as files, the photographs of it.

    dng, jpeg: (no-flash, flash), taken with the noise of a sensor. exact: the same light without
    noise, in float TIFFs without EXIF.
    """

    truth: SimulatedTruth
    dng: tuple[Path, Path]
    jpeg: tuple[Path, Path]
    exact: tuple[Path, Path]


@dataclass(frozen=True)
class Results:
    """A folder of results, and how near they come to the truth."""

    folder: Path

    @property
    def manifest(self) -> dict[str, Any]:
        """What the run wrote about itself."""
        content: dict[str, Any] = json.loads((self.folder / "manifest.json").read_bytes())
        return content

    @property
    def files(self) -> set[str]:
        """Names of what lies in the folder."""
        return {path.name for path in self.folder.iterdir()}

    def exr(self, name: str, prefix: str = "") -> Image:
        """(H, W, 3) of an EXR, the channels prefix + R, G, B."""
        return read_exr((self.folder / name).read_bytes(), prefix)

    def layers(self) -> Image:
        """(N, H, W, 3), the lamps of layers.exr in their order."""
        count = len(self.manifest["lamps"])
        return np.stack([self.exr("layers.exr", f"lamp{i + 1}.") for i in range(count)])

    def layer_snr_db(self, truth: SimulatedTruth) -> list[float]:
        """SNR of the layer of each lamp of the truth, in the assignment that fits best."""
        layers = self.layers()
        found = [
            [snr_db(layers[i], true) for i, true in zip(order, truth.layers, strict=True)]
            for order in itertools.permutations(range(len(layers)))
        ]
        return max(found, key=sum)

    def white_balance_error(self, truth: SimulatedTruth) -> float:
        """Mean angle in degrees between colours shown under the neutral light and true ones."""
        shown, true = self.exr("white_balanced.exr"), truth.white_balanced
        bright = true.sum(2) > 0.05 * true.sum(2).max()
        return float(angles(shown[bright], true[bright]).mean())

    def normal_error(self, truth: SimulatedTruth) -> float:
        """Mean angle in degrees between normals found and true ones."""
        found, true = self.exr("normals.exr"), truth.normals
        known = np.isfinite(true).all(2) & np.isfinite(found).all(2) & found.any(2)
        return float(angles(found[known], true[known]).mean())


@dataclass(frozen=True)
class Run:
    """A finished run of the command."""

    code: int
    stdout: str
    stderr: str
    results: Results


def read_exr(data: bytes, prefix: str = "") -> Image:
    """(H, W, 3), the channels prefix + R, G, B."""
    channels = OpenEXR.File(io.BytesIO(data), separate_channels=True).channels()
    planes = [channels[f"{prefix}{name}"].pixels for name in "RGB"]
    return np.stack(planes, axis=-1).astype(np.float32)


def float_tiff(values: Image) -> bytes:
    """(H, W, 3) as a float TIFF."""
    file = io.BytesIO()
    tifffile.imwrite(file, values.astype(np.float32), photometric="rgb", metadata=None)
    return file.getvalue()


def snr_db(found: NDArray[Any], true: NDArray[Any]) -> float:
    """Signal-to-noise ratio."""
    error = np.square(found - true, dtype=np.float64).sum()
    return float(10 * np.log10(np.square(true, dtype=np.float64).sum() / error))


def angles(found: NDArray[Any], true: NDArray[Any]) -> NDArray[np.float64]:
    """Angle in degrees between vectors along the last axis."""
    cosine = (found * true).sum(-1, dtype=np.float64)
    cosine /= np.linalg.norm(found.astype(np.float64), axis=-1)
    cosine /= np.linalg.norm(true.astype(np.float64), axis=-1)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def clean_environment(**settings: object) -> dict[str, str]:
    """Our environment without settings of lightlayers, but for these."""
    kept = {name: text for name, text in os.environ.items() if "LIGHTLAYERS_" not in name}
    return {**kept, **{f"LIGHTLAYERS_{name}": str(value) for name, value in settings.items()}}


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Scene]:
    """Simulate a scene, once for all tests: scene(lights, kind)."""

    @cache
    def simulate(lights: int, kind: str = "studio") -> Scene:
        address = (
            f"sim://studio?lights={lights}&width={WIDTH}&height={HEIGHT}&scene={kind}&format=both"
        )
        truth = simulated_truth(address)
        with open_camera(address) as camera:
            pair: CapturedPair = capture_pair(camera)
        folder = tmp_path_factory.mktemp(f"{kind}{lights}")
        light = truth.layers.sum(0)
        paths: dict[str, tuple[Path, Path]] = {}
        for name, suffix, contents in (
            ("dng", "dng", (pair.no_flash.files["dng"], pair.flash.files["dng"])),
            ("jpeg", "jpg", (pair.no_flash.files["jpeg"], pair.flash.files["jpeg"])),
            ("exact", "tif", (float_tiff(light), float_tiff(light + truth.flash))),
        ):
            paths[name] = (folder / f"no_flash.{suffix}", folder / f"flash.{suffix}")
            for path, content in zip(paths[name], contents, strict=True):
                path.write_bytes(content)
        return Scene(truth, **paths)

    return simulate


@pytest.fixture(scope="session")
def command(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    """Run `lightlayers separate NO_FLASH FLASH -o DIR` and what else is given."""

    def separate(pair: tuple[Path, Path], *flags: object, **settings: object) -> Run:
        folder = tmp_path_factory.mktemp("results") / "out"
        done = subprocess.run(
            [COMMAND, "separate", *pair, "-o", folder, *map(str, flags)],
            env=clean_environment(**settings),
            capture_output=True,
            text=True,
            timeout=PATIENCE_SECONDS,
            check=False,
        )
        return Run(done.returncode, done.stdout, done.stderr, Results(folder))

    return separate


@pytest.fixture(scope="session")
def separated(command: Callable[..., Run]) -> Callable[..., Results]:
    """Results of the command, which must succeed; run once for all that ask for the same."""

    @cache
    def separate(pair: tuple[Path, Path], *flags: object) -> Results:
        run = command(pair, *flags)
        assert run.code == 0, run.stderr
        return run.results

    return separate


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """`lightlayers serve` on a database and a store of its own."""
    folder = tmp_path_factory.mktemp("service")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    log = folder / "log"
    with log.open("wb") as stderr:
        process = subprocess.Popen(
            [COMMAND, "serve", "--port", str(port)],
            env=clean_environment(DATA_DIR=folder / "data", POLL_SECONDS=0.2),
            stderr=stderr,
        )
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=PATIENCE_SECONDS) as client:
        try:
            deadline = time.monotonic() + PATIENCE_SECONDS
            while not _ready(client):
                assert process.poll() is None and time.monotonic() < deadline, log.read_text()
                time.sleep(0.1)
            yield client
        finally:
            process.terminate()
            process.wait(PATIENCE_SECONDS)


def _ready(client: httpx.Client) -> bool:
    try:
        return client.get("/readyz").status_code == 200
    except httpx.TransportError:
        return False
