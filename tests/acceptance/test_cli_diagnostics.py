"""What tells people where a result can be trusted: confidence.tif, residual.png, the manifest."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image as PillowImage

from pipeline.arrays import Floats64

FLAGS = ("--camera", "Nikon D5100", "--no-align", "--lights", 2)
PATCH = (slice(20, 40), slice(20, 60))
"""A piece of the wall behind the things."""


@pytest.fixture(scope="module")
def two(scene: Callable[..., Any]) -> Any:
    return scene(2)


@pytest.fixture(scope="module")
def plain(two: Any, separated: Callable[..., Any]) -> Any:
    return separated(two.exact, *FLAGS)


def write_pair(folder: Path, no_flash: Any, flash: Any) -> tuple[Path, Path]:
    paths = (folder / "no_flash.tif", folder / "flash.tif")
    for path, values in zip(paths, (no_flash, flash), strict=True):
        tifffile.imwrite(path, values.astype(np.float32), photometric="rgb", metadata=None)
    return paths


def confidence(results: Any) -> Floats64:
    return np.asarray(tifffile.imread(results.folder / "confidence.tif") / 65535)


def residual(results: Any) -> Floats64:
    """Greenness 0…255 of the map, which grows with the residual; one value for each pixel."""
    with PillowImage.open(results.folder / "residual.png") as picture:
        codes = np.asarray(picture)
    return codes[1:720:3, 1:1080:3, 1].astype(np.float64)


def test_confidence_is_0_in_a_clipped_patch_and_1_elsewhere(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    light = two.truth.layers.sum(0)
    flash = light + two.truth.flash
    flash[PATCH] = 1.0

    results = separated(write_pair(tmp_path, light, flash), *FLAGS)

    found, before = confidence(results), confidence(plain)
    assert found.shape == (240, 360)
    assert (found[PATCH] == 0).all()
    beyond = np.ones(found.shape, bool)
    beyond[10:50, 10:70] = False
    assert np.median(found[beyond]) == 1
    assert np.abs(found - before)[beyond].mean() < 1e-3
    assert before[PATCH].min() > 0.99


def test_the_share_of_a_lamps_light_that_was_separated_is_told(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    """Of a picture clipped in its left half, most of it is filled in."""
    light = two.truth.layers.sum(0)
    flash = light + two.truth.flash
    flash[:, :180] = 1.0

    results = separated(write_pair(tmp_path, light, flash), *FLAGS)

    weights = confidence(results)
    for layer, lamp, whole in zip(
        results.layers(), results.manifest["lamps"], plain.manifest["lamps"], strict=True
    ):
        expected = (layer * weights[..., None]).sum() / layer.sum()
        assert lamp["separated_share"] == pytest.approx(expected, abs=0.002)
        assert lamp["separated_share"] < 0.8
        assert whole["separated_share"] > 0.9


def test_the_residual_is_high_where_light_of_no_lamp_is_and_low_elsewhere(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    """A mirror-like reflection of a green sign, in both photographs."""
    light = two.truth.layers.sum(0)
    light[PATCH] += np.array([0.0, 1.0, 0.0]) * light[PATCH].mean()
    pair = write_pair(tmp_path, light, light + two.truth.flash)

    found, before = residual(separated(pair, *FLAGS)), residual(plain)

    assert found[PATCH].min() > 200  # 20 % or more of the light
    assert before[PATCH].max() < 60  # less than 5 %
    beyond = np.ones(found.shape, bool)
    beyond[10:50, 10:70] = False
    assert np.median(found[beyond]) < 40
    assert (found[beyond] > 200).mean() < 0.02


def test_the_diagnostics_are_told_in_the_manifest(plain: Any) -> None:
    files = {file["name"]: file for file in plain.manifest["files"]}

    assert (files["confidence.tif"]["width"], files["confidence.tif"]["height"]) == (360, 240)
    assert files["confidence.tif"]["encoding"].startswith("16-bit linear")
    assert (files["residual.png"]["width"], files["residual.png"]["height"]) == (1080, 840)
    assert (files["gamma.png"]["width"], files["gamma.png"]["height"]) == (900, 1050)
