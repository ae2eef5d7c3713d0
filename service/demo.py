"""The demo: python -m service.demo.

Starts the service on a database and a store of its own, has the simulated camera take a pair,
puts the results into demo/ and compares the layers with the light that the camera simulated.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from rich.console import Console
from rich.table import Table
from scipy.optimize import linear_sum_assignment

import drivers
from pipeline.arrays import Floats32
from pipeline.errors import InputError
from pipeline.options import Options
from pipeline.result_names import LAYERS, MANIFEST, lamp_name, layer_channels
from service.cli.display import print_results, stage_bar
from service.cli.results_folder import new_results
from service.sending.client import Client
from service.sending.failures import RefusedError, ServiceAwayError
from service.workers import processes

CAMERA = "sim://studio?lights=2&width=1200&height=800"
FOLDER = Path("demo")
LEAST_SNR_DB = 25.0
"""Mean signal-to-noise ratio of the layers below which the demo fails."""

_START_SECONDS = 120.0  # of a machine that is busy with other things, too
_STOP_SECONDS = 15.0

Layers = Floats32

console = Console(highlight=False)


def main() -> int:
    """Run the demo; the exit code."""
    try:
        mean = run(CAMERA, FOLDER)
    except (ServiceAwayError, RefusedError, InputError, drivers.DriverError) as error:
        print(error, file=sys.stderr)  # noqa: T201  the demo talks to people
        return 1
    except KeyboardInterrupt:
        return 130
    if not mean >= LEAST_SNR_DB:
        print(  # noqa: T201
            f"The layers reach {mean:.1f} dB, less than the {LEAST_SNR_DB:g} dB they should.",
            file=sys.stderr,
        )
        return 1
    return 0


def run(camera: str, folder: Path) -> float:
    """Separate a pair of the camera into the folder; the mean SNR of the layers in dB.

    Raises ServiceAwayError, RefusedError, pipeline.errors.InputError, drivers.DriverError.
    """
    with running_service() as url, Client(url) as client, new_results(folder) as results:
        console.print(f"The service runs at {url}.")
        console.print(f"The camera {camera} takes a pair.", soft_wrap=True)
        job = client.submit_capture(camera, Options())
        with stage_bar(lines=True) as report:
            job = client.wait(job, report)
        client.download(job, results)
    manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_bytes())
    print_results(manifest, folder, as_json=False)
    truth = drivers.simulated_truth(camera)
    found = read_layers(folder / LAYERS, len(manifest["lamps"]))
    pairs = match_layers(found, truth.layers)
    console.print(_comparison(pairs, truth.lamps))
    mean = float(np.mean([snr for _, _, snr in pairs]))
    console.print(f"Mean SNR of the layers against the simulated light: {mean:.1f} dB")
    return mean


@contextlib.contextmanager
def running_service() -> Iterator[str]:
    """Run the service with a worker on a fresh embedded database and store; gives its URL.

    Its log goes to stderr when it fails. Raises ServiceAwayError when it does not start.
    """
    with tempfile.TemporaryDirectory(prefix="lightlayers-demo-") as folder:
        log = Path(folder) / "service.log"
        port = _free_port()
        url = f"http://127.0.0.1:{port}"
        environment = {
            name: value for name, value in os.environ.items() if not name.startswith("LIGHTLAYERS_")
        }
        environment["LIGHTLAYERS_DATA_DIR"] = folder
        with log.open("wb") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-m", "service.cli", "serve", "--port", str(port)],
                env=environment,
                stdin=subprocess.DEVNULL,
                stderr=stderr,
                start_new_session=True,  # Ctrl-C is for the demo, which then stops the service
            )
        try:
            _await_start(url, process)
            yield url
        except ServiceAwayError:
            sys.stderr.write(log.read_text())
            raise
        finally:
            processes.end(process, _STOP_SECONDS)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port: int = server.getsockname()[1]
    return port


def _await_start(url: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + _START_SECONDS
    with Client(url) as client:
        while process.poll() is None and time.monotonic() < deadline:
            with contextlib.suppress(ServiceAwayError):
                client.check_ready()
                return
            time.sleep(0.1)
    raise ServiceAwayError("The service did not start; its log above says why.")


def read_layers(path: Path, lamps: int) -> Layers:
    """Layers of layers.exr: float32 (N, H, W, 3), linear camera RGB."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        planes = np.stack([channels[name].pixels for name in layer_channels(lamps)])
    by_lamp = planes.reshape(lamps, 3, *planes.shape[1:])
    return np.moveaxis(by_lamp, 1, -1).astype(np.float32)


def match_layers(found: Layers, truth: Layers) -> list[tuple[int, int, float]]:
    """Pair layers (N, H, W, 3) and true layers (M, H, W, 3) so that their mean SNR is highest.

    Gives (index found, index true, SNR in dB) for min(N, M) pairs, ordered by the index found.
    """
    table = [[layer_snr(layer, true) for true in truth] for layer in found]
    rows, columns = linear_sum_assignment(np.clip(table, -999, 999), maximize=True)  # none is ∞
    return [(int(i), int(j), table[i][j]) for i, j in zip(rows, columns, strict=True)]


def layer_snr(layer: Floats32, truth: Floats32) -> float:
    """10·log₁₀(Σ truth² / Σ (layer − truth)²) in dB over all pixels and channels, not rescaled."""
    signal = np.sum(np.square(truth, dtype=np.float64))
    noise = np.sum(np.square(np.subtract(layer, truth, dtype=np.float64)))
    with np.errstate(divide="ignore"):
        return float(10 * np.log10(signal / noise))


def _comparison(pairs: list[tuple[int, int, float]], lamps: tuple[str, ...]) -> Table:
    table = Table("layer", "simulated lamp", "SNR")
    for found, true, snr in pairs:
        table.add_row(lamp_name(found), lamps[true], f"{snr:.1f} dB")
    return table


if __name__ == "__main__":
    sys.exit(main())
