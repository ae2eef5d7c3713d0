"""lightlayers as a customer runs it: the installed command, a real service, rendered pairs."""

from __future__ import annotations

import io
import itertools
import json
import os
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
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage

from drivers import CapturedPair, capture_pair, open_camera, simulated_truth
from drivers.truth import SimulatedTruth
from pipeline.arrays import Floats32
from tests.acceptance.forks import Forks
from tests.angles import angles
from tests.layers import layers_of, picture, planes_of
from tests.png_bombs import png_bomb
from tests.ports import free_port

COMMAND = Path(sys.executable).parent / "lightlayers"
PATIENCE_SECONDS = 240
WIDTH, HEIGHT = 360, 240

Image = Floats32


def _picture(codes: NDArray[np.uint8], kind: str = "PNG") -> bytes:
    file = io.BytesIO()
    PillowImage.fromarray(codes).save(file, kind)
    return file.getvalue()


def _noise(width: int = 96, height: int = 64, brightness: float = 1.0) -> bytes:
    rng = np.random.default_rng(width)
    return _picture((rng.uniform(20, 120, (height, width, 3)) * brightness).astype(np.uint8))


def _bad_pairs() -> dict[str, tuple[bytes, bytes, str]]:
    """Pairs that cannot be separated, by name, and what the refusal says."""
    good, other = _noise(), _noise(brightness=2)
    jpeg = _picture(np.random.default_rng(1).integers(0, 255, (64, 96, 3), dtype=np.uint8), "JPEG")
    files = {
        "text": (b"This is no photograph.\n" * 40, "is of a kind that is not read"),
        "0 bytes": (b"", "is empty"),
        "half a JPEG": (jpeg[: len(jpeg) // 2], "is a damaged or incomplete JPEG"),
        "a bomb": (png_bomb(30_000, 30_000), "has 30000 × 30000 pixels, more than the limit"),
        "a grey picture": (_picture(np.full((64, 96), 90, np.uint8)), "is grey"),
        "a black frame": (_picture(np.zeros((64, 96, 3), np.uint8)), "is black"),
    }
    pairs = {}
    for name, (content, reason) in files.items():
        sentence = "The photograph {} the flash " + reason
        pairs[f"{name} without flash"] = (content, other, sentence.format("without"))
        pairs[f"{name} with flash"] = (good, content, sentence.format("with"))
    return {
        **pairs,
        "two sizes": (good, _noise(64, 96, 2), "different sizes, 96 × 64"),
        "two identical frames": (good, good, "are identical"),
    }


BAD_PAIRS = _bad_pairs()


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Give a test that asks for bad_name every bad pair."""
    if "bad_name" in metafunc.fixturenames:
        metafunc.parametrize("bad_name", BAD_PAIRS)


@dataclass(frozen=True)
class BadPair:
    """A pair that cannot be separated; reason: what the refusal says of it."""

    files: tuple[Path, Path]
    reason: str


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

    def warnings(self) -> list[str]:
        """Codes of what the manifest warns of."""
        return [warning["code"] for warning in self.manifest["warnings"]]

    @property
    def files(self) -> set[str]:
        """Names of what lies in the folder."""
        return {path.name for path in self.folder.iterdir()}

    def exr(self, name: str, prefix: str = "") -> Image:
        """(H, W, 3) of an EXR, the channels prefix + R, G, B."""
        return picture(planes_of((self.folder / name).read_bytes()), prefix).astype(np.float32)

    def layers(self) -> Image:
        """(N, H, W, 3), the lamps of layers.exr in their order."""
        count = len(self.manifest["lamps"])
        planes = planes_of((self.folder / "layers.exr").read_bytes())
        return layers_of(planes, count).astype(np.float32)

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


def float_tiff(values: Image) -> bytes:
    """(H, W, 3) as a float TIFF."""
    file = io.BytesIO()
    tifffile.imwrite(file, values.astype(np.float32), photometric="rgb", metadata=None)
    return file.getvalue()


def snr_db(found: NDArray[Any], true: NDArray[Any]) -> float:
    """Signal-to-noise ratio."""
    error = np.square(found - true, dtype=np.float64).sum()
    return float(10 * np.log10(np.square(true, dtype=np.float64).sum() / error))


@pytest.fixture(scope="session")
def environment() -> dict[str, str]:
    """Our environment without settings of lightlayers."""
    return {name: text for name, text in os.environ.items() if "LIGHTLAYERS_" not in name}


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Scene]:
    """Simulate a scene, once for all tests: scene(lights, kind, size)."""

    @cache
    def simulate(
        lights: int, kind: str = "studio", size: tuple[int, int] = (WIDTH, HEIGHT)
    ) -> Scene:
        width, height = size
        address = (
            f"sim://studio?lights={lights}&width={width}&height={height}&scene={kind}&format=both"
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
def lightlayers(
    tmp_path_factory: pytest.TempPathFactory, environment: dict[str, str]
) -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    """Run `lightlayers` with these arguments and more environment.

    In a fork: test_the_same_pair_gives_the_same_bytes holds that it is as the command by itself.
    """
    forks = Forks(environment, tmp_path_factory.mktemp("said"))
    yield forks.run
    forks.close()


@pytest.fixture(scope="session")
def process(environment: dict[str, str]) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the same in a process of its own."""

    def run(*arguments: object, **also: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [COMMAND, *map(str, arguments)],
            env={**environment, **also},
            capture_output=True,
            text=True,
            timeout=PATIENCE_SECONDS,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def command(
    tmp_path_factory: pytest.TempPathFactory, lightlayers: Callable[..., Any]
) -> Callable[..., Run]:
    """Run `lightlayers separate NO_FLASH FLASH -o DIR` with more flags and environment."""

    def separate(
        pair: tuple[Path, Path],
        *flags: object,
        run: Callable[..., Any] = lightlayers,
        **also: str,
    ) -> Run:
        folder = tmp_path_factory.mktemp("results") / "out"
        done = run("separate", *pair, "-o", folder, *flags, **also)
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


@pytest.fixture
def bad_pair(bad_name: str, tmp_path: Path) -> BadPair:
    """The bad pair of that name, in files whose names say nothing."""
    no_flash, flash, reason = BAD_PAIRS[bad_name]
    files = (tmp_path / "one.jpg", tmp_path / "two.jpg")
    files[0].write_bytes(no_flash)
    files[1].write_bytes(flash)
    return BadPair(files, reason)


@pytest.fixture(scope="package")
def service(
    tmp_path_factory: pytest.TempPathFactory, environment: dict[str, str]
) -> Iterator[httpx.Client]:
    """`lightlayers serve` on a database and a store of its own."""
    folder = tmp_path_factory.mktemp("service")
    port = free_port()
    log = folder / "log"
    settings = {"LIGHTLAYERS_DATA_DIR": str(folder / "data"), "LIGHTLAYERS_POLL_SECONDS": "0.4"}
    with log.open("wb") as stderr:
        process = subprocess.Popen(
            [COMMAND, "serve", "--port", str(port)],
            env={**environment, **settings},
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
