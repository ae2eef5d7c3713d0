from __future__ import annotations

import io
from functools import cache

import numpy as np
import pytest
import tifffile

from pipeline.arrays import Floats64
from pipeline.images.frames import Image, Matrix
from pipeline.spectra.lights import find_light
from tests.evaluation.ceilings import best_matrices, dealt_out, regressed_matrices, tuned_matrices
from tests.evaluation.experiments import BASES
from tests.evaluation.methods import METHODS
from tests.evaluation.scoring import joint_snr, valid_pixels
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import sensitivities

CAMERA = "Nikon D5100"


def matrices() -> Matrix:
    """Two lamps that mix channels, as no diagonal and no basis of three lights has them."""
    return np.array(
        [
            [[1.5, 0.3, 0.0], [0.1, 0.8, 0.1], [0.0, 0.2, 0.4]],
            [[0.5, 0.1, 0.2], [0.2, 1.0, 0.0], [0.0, 0.0, 1.3]],
        ]
    )


@cache
def exact() -> Shot:
    """A pair for which two 3×3 matrices are the whole truth: coloured tiles, soft lights."""
    random = np.random.default_rng(4)
    flash = np.repeat(np.repeat(random.uniform(0.1, 0.4, (6, 8, 3)), 16, axis=0), 16, axis=1)
    across = np.linspace(-0.4, 1.4, 128).clip(0, 1)[None, :]
    down = np.linspace(0.2, 0.5, 96)[:, None]
    strengths = (across * down, (1 - across) * (0.7 - down))
    truth = np.stack(
        [z[..., None] * (flash @ t.T) for z, t in zip(strengths, matrices(), strict=True)]
    ).astype(np.float32)
    photograph, light = truth.sum(axis=0), flash.astype(np.float32)
    lamps = np.stack([find_light(name) for name in ("A", "FL2")])
    return Shot(
        files=(tiff(photograph), tiff(photograph + light)),
        options={"camera": CAMERA, "align": False, "exposure_ratio": 1.0},
        lights=2,
        truth=truth,
        flash_part=light,
        valid=valid_pixels(truth, light, 2.0),
        lamp_spectra=lamps,
        flash_spectrum=find_light("xenon"),
        sensitivities=sensitivities(CAMERA),
        axes=np.eye(3),
        coefficients=None,
    )


def tiff(image: Image) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, image, photometric="rgb", metadata=None)
    return file.getvalue()


@cache
def snr(method: str) -> float:
    shot = exact()
    return joint_snr(shot.truth, METHODS[method](shot).layers, shot.valid)[0]


def test_best_matrices_are_found_where_matrices_are_the_truth() -> None:
    shot = exact()

    found = best_matrices(shot.truth, shot.flash_part, shot.photograph, *shot.filtered, shot.valid)

    for one, true in zip(found, matrices(), strict=True):
        scaled = one * (true * one).sum() / (one * one).sum()
        np.testing.assert_allclose(scaled, true, atol=0.02)
    assert snr("best_3x3") > 35


@pytest.mark.parametrize("method", [m for m in METHODS if m not in ("best_3x3", "tuned_3x3")])
def test_no_method_is_above_the_ceiling_on_an_exact_pair(method: str) -> None:
    assert snr(method) <= snr("best_3x3")


def test_tuning_improves_the_score() -> None:
    shot = exact()
    known = (shot.truth, shot.photograph, *shot.filtered, shot.valid)
    wrong = matrices() + np.array([0.0, 0.1])[:, None, None]

    tuned = tuned_matrices(*known, start=wrong)

    before, after = (
        joint_snr(shot.truth, dealt_out(shot.photograph, *shot.filtered, t), shot.valid)[0]
        for t in (wrong, tuned)
    )
    assert after > before + 10
    exact_db = 120.0  # beyond is rounding
    assert snr("tuned_3x3") >= min(snr("best_3x3"), exact_db) - 0.1


def test_equal_split_is_below_what_separates() -> None:
    values = exact().truth[:, exact().valid].astype(np.float64)
    half = values.sum(axis=0) / 2
    expected = 10 * np.log10(np.square(values).sum() / np.square(values - half).sum())

    assert snr("equal") == pytest.approx(expected, abs=1e-3)
    assert snr("equal") < snr("best")


@pytest.mark.parametrize(
    "method", ["equal", "von_kries", "paper_shared", "best", "known", "best_3x3", "tuned_3x3"]
)
def test_layers_that_are_dealt_out_add_up_to_the_photograph(method: str) -> None:
    shot = exact()

    total = METHODS[method](shot).layers.sum(axis=0)

    np.testing.assert_allclose(total, shot.photograph, rtol=2**-10, atol=1e-4)


@pytest.mark.parametrize("method", ["paper", *BASES])
def test_published_layers_are_not_made_to_add_up(method: str) -> None:
    shot = exact()

    total = METHODS[method](shot).layers.sum(axis=0)

    assert np.abs(total - shot.photograph).max() > 1e-3


def test_the_product_says_what_it_found() -> None:
    answer = METHODS["best"](exact())

    assert answer.coefficients is not None
    assert answer.coefficients.shape == (2, 3)
    assert answer.confidence == 1.0


def test_a_lamp_like_the_flash_has_the_unit_matrix() -> None:
    s, flash = sensitivities(CAMERA), find_light("xenon")

    found = regressed_matrices(s, flash, np.stack([flash, 3 * flash]))

    np.testing.assert_allclose(found, [np.eye(3), 3 * np.eye(3)], atol=1e-9)


def test_shares_are_dealt_out_per_channel() -> None:
    flash = np.ones((1, 2, 3), np.float32)
    lamps: Floats64 = np.stack([np.diag([1.0, 0.5, 0.0]), np.diag([0.0, 0.5, 1.0])])
    photograph = np.array([[[2.0, 2.0, 2.0], [0.8, 0.4, 0.0]]], np.float32)

    layers = dealt_out(photograph, photograph, flash, lamps)

    np.testing.assert_allclose(layers[0, 0], [[2.0, 1.0, 0.0], [0.8, 0.4, 0.0]], atol=1e-6)
    np.testing.assert_allclose(layers[1, 0], [[0.0, 1.0, 2.0], [0.0, 0.0, 0.0]], atol=1e-6)
