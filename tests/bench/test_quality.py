from __future__ import annotations

import pytest

from pipeline.options import Quality
from tests.bench import quality


def test_figures_are_medians_and_ratios_to_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seconds of the third round are out of line; noise 3 gives the middle of the three."""
    calls: list[Quality] = []

    def cpu(asked: Quality) -> float:
        calls.append(asked)
        return {"best": 10.0, "balanced": 5.0, "fast": 2.5}[asked] * (9 if len(calls) > 6 else 1)

    def layers_db(lights: int, seed: int, asked: Quality) -> float:
        return 10.0 * lights + (5 - seed) % 3 + len(asked)

    monkeypatch.setattr(quality, "layers_db", layers_db)

    found = quality.measure(cpu)

    assert calls == ["best", "balanced", "fast"] * 3
    assert found == {
        "best": {"two_db": 25.0, "three_db": 35.0, "cpu_ratio": 1.0},
        "balanced": {"two_db": 29.0, "three_db": 39.0, "cpu_ratio": 0.5},
        "fast": {"two_db": 25.0, "three_db": 35.0, "cpu_ratio": 0.25},
    }


def test_light_is_held_against_the_truth() -> None:
    snr = quality.layers_db(2, 1, "best", "width=360&height=240")

    assert 22 < snr < 32
