"""What --quality loses and saves: light against the truth of the simulated camera, and CPU."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import get_args

import drivers
from pipeline.options import Options, Quality
from pipeline.process import separate_files
from pipeline.progress import Progress
from tests.evaluation.scoring import joint_snr, valid_pixels
from tests.layers import layers_of, planes_of

QUALITIES: tuple[Quality, ...] = get_args(Quality)
_SEEDS = (1, 2, 3)
_SIZE = "width=1200&height=800"
_ROUNDS = 3


def measure(cpu: Callable[[Quality], float]) -> dict[str, dict[str, float]]:
    """By quality: dB of the layers of two and of three lamps, medians over noise; CPU over best's.

    cpu: runs a job in a quality and returns its CPU seconds.
    """
    seconds: dict[Quality, list[float]] = {quality: [] for quality in QUALITIES}
    for _ in range(_ROUNDS):
        for quality in QUALITIES:
            seconds[quality].append(cpu(quality))
    best = median(seconds["best"])
    return {
        quality: {
            "two_db": median(layers_db(2, seed, quality) for seed in _SEEDS),
            "three_db": median(layers_db(3, seed, quality) for seed in _SEEDS),
            "cpu_ratio": median(seconds[quality]) / best,
        }
        for quality in QUALITIES
    }


def layers_db(lights: int, seed: int, quality: Quality, size: str = _SIZE) -> float:
    """Joint signal-to-noise ratio in dB of a simulated RAW pair's layers."""
    address = f"sim://studio?lights={lights}&seed={seed}&{size}"
    with drivers.open_camera(address) as camera:
        pair = drivers.capture_pair(camera)
    truth = drivers.simulated_truth(address)
    options = Options.model_validate(
        {"lights": lights, "quality": quality, "outputs": ["layers.exr"]}
    )
    with tempfile.TemporaryDirectory() as folder:
        separate_files(pair.no_flash.best, pair.flash.best, options, Path(folder), Progress())
        layers = layers_of(planes_of((Path(folder) / "layers.exr").read_bytes()), lights)
    snr, _ = joint_snr(truth.layers, layers, valid_pixels(truth.layers, truth.flash, 1.0))
    return snr
