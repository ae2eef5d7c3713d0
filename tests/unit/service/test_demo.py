from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import numpy as np
import OpenEXR
import pytest

from service import demo
from service.sending.failures import ServiceAwayError


def test_snr_is_the_ratio_of_energies_without_rescaling() -> None:
    truth = np.full((4, 5, 3), 0.5, np.float32)
    assert demo.layer_snr(truth * 1.1, truth) == pytest.approx(20.0, abs=1e-4)
    assert demo.layer_snr(truth * 0.0, truth) == pytest.approx(0.0)
    assert demo.layer_snr(truth, truth) == np.inf


def test_snr_counts_all_channels_together() -> None:
    truth = np.zeros((1, 1, 3), np.float32)
    truth[..., 0] = 3.0
    layer = truth + np.array([0.0, 0.3, 0.0], np.float32)
    assert demo.layer_snr(layer, truth) == pytest.approx(20.0, abs=1e-4)


def _layers(*colours: tuple[float, float, float]) -> demo.Layers:
    return np.stack([np.full((2, 2, 3), colour, np.float32) for colour in colours])


def test_layers_are_matched_by_the_best_order() -> None:
    truth = _layers((1, 0, 0), (0, 1, 0), (0, 0, 1))
    found = _layers((0, 0, 0.9), (0.9, 0, 0), (0, 0.9, 0))
    pairs = demo.match_layers(found, truth)
    assert [(a, b) for a, b, _ in pairs] == [(0, 2), (1, 0), (2, 1)]
    assert [snr for _, _, snr in pairs] == pytest.approx([20.0] * 3, abs=1e-4)


@pytest.mark.parametrize(
    ("found", "truth", "expected"),
    [
        ([(0, 0.9, 0)], [(1, 0, 0), (0, 1, 0)], [(0, 1)]),
        ([(0, 0, 1), (0.9, 0, 0), (0, 0.9, 0)], [(0, 1, 0), (1, 0, 0)], [(1, 1), (2, 0)]),
    ],
)
def test_another_number_of_lamps_is_matched_as_far_as_it_goes(
    found: list[tuple[float, float, float]],
    truth: list[tuple[float, float, float]],
    expected: list[tuple[int, int]],
) -> None:
    pairs = demo.match_layers(_layers(*found), _layers(*truth))
    assert [(a, b) for a, b, _ in pairs] == expected


def test_layers_are_read_by_lamp_and_channel(tmp_path: Path) -> None:
    values = np.arange(2 * 4 * 5 * 3, dtype=np.float32).reshape(2, 4, 5, 3)
    channels = {
        f"lamp{lamp + 1}.{colour}": np.ascontiguousarray(values[lamp, ..., index])
        for lamp in range(2)
        for index, colour in enumerate("RGB")
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(tmp_path / "layers.exr"))
    np.testing.assert_array_equal(demo.read_layers(tmp_path / "layers.exr", 2), values)


def test_the_service_stops_with_the_demo_whatever_happens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    # The demo's jobs are its own, whatever the machine's service is set to.
    monkeypatch.setenv("LIGHTLAYERS_DATABASE_URL", "postgresql://nowhere/at_all")
    with pytest.raises(KeyError), demo.running_service() as url:
        assert httpx.get(f"{url}/readyz", timeout=60).json() == {"status": "ok"}
        raise KeyError
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"{url}/readyz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("mean", "code"), [(25.0, 0), (24.9, 1), (float("nan"), 1)])
def test_layers_worse_than_they_should_be_fail(
    mean: float, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "run", lambda _camera, _folder: mean)
    assert demo.main() == code
    assert ("25 dB they should" in capsys.readouterr().err) == bool(code)


def test_a_service_that_does_not_start_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def no_service() -> Iterator[str]:
        raise ServiceAwayError("The service did not start.")
        yield ""

    monkeypatch.setattr(demo, "running_service", no_service)
    assert demo.main() == 1
    assert capsys.readouterr().err == "The service did not start.\n"
