from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

import drivers
from service.workers import sandbox
from tests.bench import tasks


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("pair")
    with drivers.open_camera("sim://studio?lights=2&width=96&height=64&format=jpeg") as camera:
        pair = drivers.capture_pair(camera)
    paths = folder / "no_flash", folder / "flash"
    for path, shot in zip(paths, (pair.no_flash, pair.flash), strict=True):
        path.write_bytes(shot.best)
    return paths


def test_every_figure_of_a_start_is_measured(files: tuple[Path, Path]) -> None:
    found = tasks.start(files, tasks=3)

    assert set(found) == {
        "first_byte_s",
        "worst_first_byte_s",
        "cpu_s",
        "bare_wall_s",
        "bare_cpu_s",
    }
    assert 0 < found["first_byte_s"] <= found["worst_first_byte_s"]
    assert found["bare_cpu_s"] > 0


def test_two_at_once_are_compared_with_one_after_the_other(
    files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One after the other takes 10 s and 8 s of CPU, both at once 6 s and 12 s."""
    moments, used, ran = iter([0.0, 10.0, 20.0, 26.0]), iter([1.0, 9.0, 20.0, 32.0]), []
    monkeypatch.setattr(tasks, "time", SimpleNamespace(monotonic=lambda: next(moments)))
    monkeypatch.setattr(tasks, "_cpu_of_ended", lambda: next(used))
    monkeypatch.setattr(
        sandbox, "fork_server", lambda *_, **__: SimpleNamespace(close=lambda: None)
    )
    monkeypatch.setattr(sandbox, "run", lambda task, *_: ran.append(task.kind))

    assert tasks.two_at_once(files, {"lights": 2}) == {"speedup": 10 / 6, "cpu_ratio": 1.5}
    assert ran == 2 * ["check", "separate", "separate"]
