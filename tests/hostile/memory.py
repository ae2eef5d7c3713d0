"""What the API's processes hold while large photographs come: python -m tests.hostile.memory.

Prints a table: the most that the API held (resident, all of it), its fork server, and the process
that reads the headers, which shares most of its pages with the fork server: what is its own.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np
import tifffile
from PIL import Image

from tests.hostile.target import Target

_LOOK_SECONDS = 0.002
_PIECE_BYTES = 16 * 1024 * 1024
_TUS = {"Tus-Resumable": "1.0.0"}


def main() -> None:
    """Measure uploads of several sizes, in one request and in pieces."""
    with tempfile.TemporaryDirectory(prefix="memory-") as name:
        folder = Path(name)
        target = Target(folder)
        try:
            for row in _rows(target, folder):
                sys.stdout.write(f"| {' | '.join(row)} |\n")
                sys.stdout.flush()
        finally:
            target.close()


def _rows(target: Target, folder: Path) -> Iterator[list[str]]:
    yield ["upload", "sent as", "API, MiB", "fork server, MiB", "header check's own, MiB"]
    yield ["---", "---", "---:", "---:", "---:"]
    held = target.peaks()
    yield ["none", "", f"{held['api']:.0f}", f"{held['fork server']:.0f}", ""]
    with httpx.Client(base_url=f"http://127.0.0.1:{target.port}", timeout=600) as http:
        for what, pair in (
            ("a pair of 12 MP JPEGs", _jpegs(folder / "jpegs")),
            ("a pair of TIFFs, 100 MB", _tiffs(folder / "100", 100e6)),
            ("a pair of TIFFs, 450 MB", _tiffs(folder / "450", 450e6)),
        ):
            for way, send in (("multipart", _send_form), ("tus", _send_pieces)):
                target.forget_peaks()
                with _watch_child(target) as child:
                    answer = send(http, pair)
                answer.raise_for_status()
                held = target.peaks()
                http.delete(answer.headers["location"]).raise_for_status()
                figures = [held["api"], held["fork server"], max(child)]
                yield [what, way, *(f"{figure:.0f}" for figure in figures)]


def _jpegs(folder: Path) -> tuple[Path, Path]:
    noise = np.random.default_rng(1).integers(0, 100, (3000, 4000, 3), np.uint8)
    return _write(folder, lambda path, bright: Image.fromarray(noise + bright).save(path, "JPEG"))


def _tiffs(folder: Path, size: float) -> tuple[Path, Path]:
    rows = int(size / 2 / (6000 * 3 * 2))
    noise = np.random.default_rng(1).integers(0, 60_000, (rows, 6000, 3), np.uint16)
    return _write(
        folder, lambda path, bright: tifffile.imwrite(path, noise + bright, photometric="rgb")
    )


def _write(folder: Path, write: Callable[[Path, int], object]) -> tuple[Path, Path]:
    folder.mkdir()
    paths = folder / "no_flash", folder / "flash"
    for path in paths:
        write(path, 100 * (path.name == "flash"))
    return paths


def _send_form(http: httpx.Client, pair: tuple[Path, Path]) -> httpx.Response:
    with pair[0].open("rb") as before, pair[1].open("rb") as after:
        return http.post("/jobs", files={"no_flash": before, "flash": after})


def _send_pieces(http: httpx.Client, pair: tuple[Path, Path]) -> httpx.Response:
    ids = {}
    for path in pair:
        headers = {**_TUS, "Upload-Length": str(path.stat().st_size)}
        place = http.post("/uploads", headers=headers).raise_for_status().headers["location"]
        ids[path.name] = place.rpartition("/")[2]
        headers = {**_TUS, "Content-Type": "application/offset+octet-stream"}
        with path.open("rb") as file:
            while True:
                headers["Upload-Offset"] = str(file.tell())
                if not (piece := file.read(_PIECE_BYTES)):
                    break
                http.patch(place, content=piece, headers=headers).raise_for_status()
    return http.post("/jobs", json={"uploads": ids})


@contextlib.contextmanager
def _watch_child(target: Target) -> Iterator[list[float]]:
    """Note what the process that reads the headers holds of its own, as long as the block."""
    found = [0.0]
    done = threading.Event()

    def watch() -> None:
        while not done.wait(_LOOK_SECONDS):
            found.append(target.checking())

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield found
    finally:
        done.set()
        thread.join()


if __name__ == "__main__":
    main()
