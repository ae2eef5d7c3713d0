from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from pipeline.arrays import Floats, Floats64
from pipeline.light.shares import shares
from tests.definitions import pixels


def reference(no_flash: Floats64, predictions: Floats64) -> Floats64:
    """Shares (N, n) by scipy, pixel by pixel."""
    return np.array(
        [nnls(predictions[:, p].T, no_flash[p])[0] for p in range(len(no_flash))], dtype=np.float64
    ).T


def left_over(z: Floats, no_flash: Floats64, predictions: Floats64) -> Floats64:
    """Distance (n,) of the mixture from the photograph."""
    return np.asarray(np.linalg.norm((z[..., None] * predictions).sum(axis=0) - no_flash, axis=-1))


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("negative", [0.0, 0.4], ids=["positive", "with negative values"])
def test_shares_are_those_of_non_negative_least_squares(count: int, negative: float) -> None:
    rng = np.random.default_rng(count)
    predictions = rng.uniform(-negative, 1, (count, 400, 3))
    no_flash = rng.uniform(-negative, 1, (400, 3))

    found = shares(no_flash.astype(np.float32), predictions.astype(np.float32))

    expected = reference(no_flash, predictions)
    assert found.dtype == np.float32
    assert (found >= 0).all()
    sound = np.linalg.svd(predictions.transpose(1, 0, 2), compute_uv=False)[:, -1] > 0.01
    assert sound.sum() > 350
    np.testing.assert_allclose(found[:, sound], expected[:, sound], atol=1e-4)
    np.testing.assert_allclose(
        left_over(found, no_flash, predictions),
        left_over(expected, no_flash, predictions),
        atol=1e-4,
    )


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_mixture_gives_back_its_shares(count: int) -> None:
    rng = np.random.default_rng(7)
    predictions = np.eye(3)[:count, None, :] + rng.uniform(0, 0.3, (count, 50, 3))
    z = rng.uniform(0, 2, (count, 50)) * rng.integers(0, 2, (count, 50))
    no_flash = (z[..., None] * predictions).sum(axis=0)

    found = shares(no_flash.astype(np.float32), predictions.astype(np.float32))

    np.testing.assert_allclose(found, z, atol=1e-5)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e3])
def test_shares_do_not_depend_on_the_brightness_of_the_flash(scale: float) -> None:
    predictions = np.array([[[0.6, 0.3, 0.1]], [[0.2, 0.5, 0.4]]])
    no_flash = (predictions * np.array([0.5, 0.25])[:, None, None]).sum(axis=0)

    found = shares((no_flash * scale).astype(np.float32), (predictions * scale).astype(np.float32))

    np.testing.assert_allclose(found[:, 0], [0.5, 0.25], rtol=1e-4)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("scale", [10.0**-power for power in range(6, 45, 2)])
def test_shares_of_next_to_nothing_are_finite(count: int, scale: float) -> None:
    """What interpolation leaves of black, whose squares single precision hardly holds."""
    rng = np.random.default_rng(count)
    predictions = (scale * rng.uniform(0, 1, (count, 400, 3))).astype(np.float32)
    for light in (np.zeros((400, 3), np.float32), predictions[0], 1e-3 * predictions[-1]):
        found = shares(light, predictions)

        assert np.isfinite(found).all()
        assert (found >= 0).all()
        assert found.max() <= 1.01


@pytest.mark.parametrize("apart", [0.3, 0.03, 0.01])
def test_lamps_that_look_alike_at_a_pixel_are_told_apart(apart: float) -> None:
    predictions = np.tile(np.array([0.4, 0.5, 0.3]), (3, 1, 1)) + apart * np.eye(3)[:, None]
    z = np.array([0.2, 0.5, 0.3])
    no_flash = (z[:, None, None] * predictions).sum(axis=0)

    found = shares(no_flash.astype(np.float32), predictions.astype(np.float32))

    np.testing.assert_allclose(found[:, 0], z, atol=1e-6 / apart)


@pytest.mark.parametrize("count", [2, 3])
def test_equal_lamps_explain_the_photograph_together(count: int) -> None:
    predictions = np.tile(np.array([0.2, 0.5, 0.3], dtype=np.float32), (count, 4, 1))
    no_flash = np.float32(0.8) * predictions[0]

    found = shares(no_flash, predictions)

    np.testing.assert_allclose(found.sum(axis=0), 0.8, rtol=1e-5)


def test_the_third_of_three_coplanar_lamps_is_not_needed() -> None:
    first, second = np.array([0.7, 0.2, 0.1]), np.array([0.1, 0.3, 0.6])
    predictions = np.stack([first, second, (first + second) / 2])[:, None, :]
    no_flash = (0.4 * first + 0.3 * second)[None]

    found = shares(no_flash.astype(np.float32), predictions.astype(np.float32))

    assert left_over(found, no_flash, predictions) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_without_flash_light_nothing_is_shared(count: int) -> None:
    found = shares(np.full((5, 3), 0.4, np.float32), np.zeros((count, 5, 3), np.float32))

    assert not found.any()


@pytest.mark.parametrize("lit", [0, 1])
def test_a_lamp_without_light_in_a_pixel_has_no_share_there(lit: int) -> None:
    predictions = np.zeros((2, 1, 3), np.float32)
    predictions[lit] = 0.5, 0.4, 0.3

    found = shares(predictions[lit] * np.float32(0.5), predictions)

    np.testing.assert_allclose(found[lit], 0.5, rtol=1e-6)
    assert found[1 - lit] == 0


@pytest.mark.parametrize("value", [0.0, -0.3])
def test_black_and_negative_pixels_hold_no_lamp(value: float) -> None:
    predictions = np.array([[[0.5, 0.4, 0.3]], [[0.1, 0.2, 0.3]]], dtype=np.float32)

    found = shares(np.full((1, 3), value, np.float32), predictions)

    assert not found.any()


def test_pictures_keep_their_shape() -> None:
    predictions = np.full((3, 6, 5, 3), 0.5, np.float32)

    assert shares(np.zeros((6, 5, 3), np.float32), predictions).shape == (3, 6, 5)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("alike", [0.0, 0.9, 0.9999])
def test_shares_are_what_they_are_defined_to_be(count: int, alike: float) -> None:
    """Any values, among them negative light, channels without any, and lamps that are alike.

    Lamps that differ by a factor alone explain a pixel as well one as the other.
    """
    rng = np.random.default_rng(7)
    no_flash = rng.normal(0.3, 0.4, (4000, 3)).astype(np.float32)
    apart = np.maximum(rng.normal(0.3, 0.4, (count, 4000, 3)), 0)
    predictions = (alike * apart[:1] + (1 - alike) * apart).astype(np.float32)

    found = shares(no_flash, predictions)

    defined = pixels.shares(no_flash, predictions)
    mixed, expected = ((z[..., None] * predictions).sum(axis=0) for z in (found, defined))
    np.testing.assert_allclose(mixed, expected, atol=2e-4)
    if alike < 0.99:
        if count != 2:
            np.testing.assert_allclose(found, defined, rtol=1e-4, atol=1e-5)
            return
        told = np.linalg.matrix_rank(np.moveaxis(predictions, 0, 1)) == count
        found, defined = found[:, told], defined[:, told]
        np.testing.assert_allclose(found, defined, rtol=1e-4, atol=5e-5)
        assert np.isclose(found, defined, rtol=1e-4, atol=1e-5).mean() > 0.999
        assert told.mean() > 0.7
