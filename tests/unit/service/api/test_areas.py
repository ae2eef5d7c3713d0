from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from pipeline.encode.exr import write_exr
from service.api.context import Context
from service.storage.folder import FolderStorage
from tests.unit.service.asking import post_capture, problem_of

Finish = Callable[[str, dict[str, bytes]], None]
LAYERS = np.random.default_rng(2).random((2, 20, 30, 3), dtype=np.float32)


@pytest.fixture
def area(http: httpx.Client, finish: Finish, tmp_path: Path) -> str:
    """Path of the areas of a job of 30 x 20 pixels and two lamps."""
    path = tmp_path / "layers.exr"
    write_exr(path, {"lamp1": LAYERS[0], "lamp2": LAYERS[1], "RGB": LAYERS.sum(0)})
    job = post_capture(http)["id"]
    finish(job, {"layers.exr": path.read_bytes()})
    return f"/jobs/{job}/area"


def test_an_area_has_every_lamp_in_16_bits(http: httpx.Client, area: str) -> None:
    answer = http.get(area, params={"left": 4, "top": 3, "width": 10, "height": 6})
    assert answer.headers["content-length"] == str(2 * 3 * 10 * 6 * 2)
    assert answer.headers["cache-control"] == "no-store"
    found = np.frombuffer(answer.content, "<f2").reshape(2, 3, 6, 10)
    wanted = np.moveaxis(LAYERS[:, 3:9, 4:14], -1, 1).astype(np.float16)
    np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"left": 21, "top": 0, "width": 10, "height": 1}, "30 x 20"),
        ({"left": 0, "top": 20, "width": 1, "height": 1}, "30 x 20"),
        ({"left": 0, "top": 0, "width": 0, "height": 1}, "width"),
        ({"left": -1, "top": 0, "width": 1, "height": 1}, "left"),
        ({"left": 0, "top": 0, "width": 1}, "height"),
        ({"left": 0, "top": 0, "width": 10**30, "height": 1}, "30 x 20"),
    ],
)
def test_an_area_that_is_none_is_refused(
    http: httpx.Client, area: str, asked: dict[str, int], words: str
) -> None:
    answer = http.get(area, params=asked)
    assert answer.status_code == 422
    assert words in str(problem_of(answer))


def test_a_job_without_layers_has_no_areas(http: httpx.Client, finish: Finish) -> None:
    job = post_capture(http)["id"]
    asked = {"left": 0, "top": 0, "width": 1, "height": 1}
    assert http.get(f"/jobs/{job}/area", params=asked).status_code == 409
    finish(job, {"lamp1.jpg": b"no layers"})
    assert http.get(f"/jobs/{job}/area", params=asked).status_code == 404
    assert http.get("/jobs/none/area", params=asked).status_code == 404


def test_an_area_too_large_is_refused(
    http: httpx.Client, area: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.api.areas.MOST_PIXELS", 100)
    answer = http.get(area, params={"left": 0, "top": 0, "width": 11, "height": 10})
    assert problem_of(answer) == (
        422,
        "invalid-option",
        "An area has 100 pixels at most: ask for several.",
    )


@pytest.mark.parametrize("reads", [0, 1])
def test_an_area_of_layers_that_are_deleted_meanwhile_is_gone(
    reads: int, http: httpx.Client, area: str, context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream, left = FolderStorage.stream, [None] * reads

    def deleting(storage: FolderStorage, key: str, start: int, end: int) -> Iterator[bytes]:
        if not left:
            context.storage.delete(key)
        else:
            left.pop()
        return stream(storage, key, start, end)

    monkeypatch.setattr(FolderStorage, "stream", deleting)
    answer = http.get(area, params={"left": 0, "top": 0, "width": 1, "height": 1})
    assert problem_of(answer) == (410, "gone", "The job is being deleted; its results are gone.")
