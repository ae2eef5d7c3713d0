"""The compiled passes against second differences as OpenCV filters them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.pair.second_differences import (
    BLOCK,
    block_squares,
    block_variances,
    relative_squares,
    squares_within,
    unshared_squares,
)

Image = Floats32
SIZES = [(64, 80), (67, 45), (8, 8), (32, 33)]


def drawn(height: int, width: int) -> Image:
    return np.random.default_rng(height).normal(0.3, 0.1, (height, width, 3)).astype(np.float32)


def differences_by_opencv(image: Image) -> Floats64:
    kernel = np.outer([1, -2, 1], [1, -2, 1]) / 6.0
    return np.asarray(
        cv2.filter2D(image.astype(np.float64), -1, kernel, borderType=cv2.BORDER_REFLECT_101)
    )


def squares_by_opencv(image: Image) -> Floats64:
    return np.asarray(np.square(differences_by_opencv(image)))


def blocks_of(image: Floats) -> Floats:
    """(rows, columns, 8, 8, 3)."""
    rows, columns = image.shape[0] // BLOCK, image.shape[1] // BLOCK
    whole = image[: rows * BLOCK, : columns * BLOCK]
    return np.asarray(whole.reshape(rows, BLOCK, columns, BLOCK, 3).swapaxes(1, 2))


@pytest.mark.parametrize("size", SIZES)
def test_squares_of_blocks(size: tuple[int, int]) -> None:
    image = drawn(*size)
    inner = blocks_of(squares_by_opencv(image))[:, :, 1:-1]
    pixels = blocks_of(image)

    means, squares = block_squares(image)

    count = inner.shape[0] * inner.shape[1]
    np.testing.assert_allclose(squares, inner.reshape(count, 48, 3).transpose(2, 0, 1), atol=1e-6)
    np.testing.assert_allclose(means, pixels.reshape(count, 64, 3).mean(axis=1).T, rtol=1e-5)


def differences_by_block(image: Image) -> Floats64:
    """(n, 48, 3)."""
    return np.asarray(blocks_of(differences_by_opencv(image))[:, :, 1:-1].reshape(-1, 48, 3))


@pytest.mark.parametrize("size", SIZES)
def test_squares_of_what_another_picture_does_not_explain(size: tuple[int, int]) -> None:
    image, other = drawn(*size), drawn(size[0] + 1, size[1])[: size[0]]
    expected = []
    for line, known in zip(differences_by_block(image), differences_by_block(other), strict=True):
        slopes = np.linalg.lstsq(known, line, rcond=None)[0]
        expected.append(np.square(line - known @ slopes) / 0.8)

    squares = unshared_squares(image, other)

    np.testing.assert_allclose(squares, np.array(expected).transpose(2, 0, 1), atol=1e-5)


def test_as_much_of_white_noise_is_left_as_there_was() -> None:
    one, other = drawn(512, 512), drawn(513, 512)[:512]

    left = unshared_squares(one, other).mean() / block_squares(one)[1].mean()

    assert left == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("other", [0.0, 0.5])
def test_even_pictures_explain_nothing(other: float) -> None:
    image = drawn(32, 32)

    left = unshared_squares(image, np.full_like(image, other))

    np.testing.assert_allclose(left, block_squares(image)[1] / 0.8, rtol=1e-4)


@pytest.mark.parametrize("size", SIZES)
def test_variances_of_blocks(size: tuple[int, int]) -> None:
    image = drawn(*size)
    inner = blocks_of(squares_by_opencv(image))[:, :, 1:-1]

    means, variances = block_variances(image)

    np.testing.assert_allclose(variances, inner.mean(axis=(2, 3)), rtol=1e-4)
    np.testing.assert_allclose(means, blocks_of(image).mean(axis=(2, 3)), rtol=1e-5)


def test_squares_over_the_noise_of_pixels_inside() -> None:
    image = drawn(40, 50)
    image[20, 20] = -0.1  # has the noise of black
    inside = np.random.default_rng(1).random((40, 50)) < 0.3
    inside[[0, -1]] = False
    inside[20, 20] = True
    gain, floor = np.array([1e-3, 2e-3, 3e-3]), np.array([1e-5, 2e-5, 3e-5])

    found = relative_squares(image, inside, gain, floor)

    expected = squares_by_opencv(image) / (gain * np.maximum(image, 0) + floor)
    np.testing.assert_allclose(found, expected[inside].T, rtol=1e-3, atol=1e-6)
    assert relative_squares(image, np.zeros_like(inside), gain, floor).shape == (3, 0)


def test_what_is_below_the_limit_is_counted_and_summed() -> None:
    squares = np.random.default_rng(1).random((70, 48), dtype=np.float32)
    limit = np.linspace(0, 1.1, 70, dtype=np.float32)
    squares[5, 7] = limit[5]
    below = squares < limit[:, None]

    counts, totals = squares_within(squares, limit)

    np.testing.assert_array_equal(counts, below.sum(axis=1))
    np.testing.assert_allclose(totals, np.where(below, squares, 0).sum(axis=1), rtol=1e-5)
