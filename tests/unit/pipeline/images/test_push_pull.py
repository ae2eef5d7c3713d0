from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.images.push_pull import push_pull


def picture(height: int, width: int) -> Floats32:
    rng = np.random.default_rng(6)
    return rng.uniform(0.2, 0.8, (height, width, 2)).astype(np.float32)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (13, 21), (64, 48)])
def test_what_is_known_is_left_alone(size: tuple[int, int]) -> None:
    values = picture(*size)
    weight = (np.random.default_rng(1).uniform(size=size) > 0.6).astype(np.float32)
    weight[0, 0] = 1.0

    found = push_pull(values, weight)

    assert found.shape == values.shape
    np.testing.assert_array_equal(found[weight == 1], values[weight == 1])


@pytest.mark.parametrize("size", [(2, 2), (13, 21), (64, 48)])
def test_gaps_lie_between_what_is_known(size: tuple[int, int]) -> None:
    values = picture(*size)
    weight = (np.random.default_rng(1).uniform(size=size) > 0.8).astype(np.float32)
    weight[0, 0] = 1.0
    values[weight == 0] = 99.0

    found = push_pull(values, weight)

    known = values[weight == 1]
    assert (found >= known.min(axis=0) - 1e-5).all()
    assert (found <= known.max(axis=0) + 1e-5).all()


def test_a_gap_in_an_even_picture_disappears() -> None:
    weight = np.ones((40, 60), np.float32)
    weight[5:35, 7:50] = 0
    values = weight[..., None] * np.array([0.25, 0.75], np.float32)

    np.testing.assert_allclose(push_pull(values, weight), np.tile([0.25, 0.75], (40, 60, 1)), 1e-5)


def test_a_gap_between_two_sides_takes_from_the_nearer_one() -> None:
    values = np.zeros((32, 64, 1), np.float32)
    values[:, 48:] = 1.0
    weight = np.zeros((32, 64), np.float32)
    weight[:, :16] = weight[:, 48:] = 1.0

    found = push_pull(values, weight)[16, :, 0]

    assert found[18] < 0.25
    assert found[45] > 0.75
    assert np.diff(found[16:48]).min() > -0.05


def test_one_known_pixel_speaks_for_its_neighbours() -> None:
    values, weight = np.zeros((32, 32, 1), np.float32), np.zeros((32, 32), np.float32)
    weight[:, :4] = weight[16, 16] = 1.0
    values[16, 16] = 1.0

    assert push_pull(values, weight)[15:18, 15:18].min() > 0.4


def test_half_known_pixels_are_blended() -> None:
    values = np.full((16, 16, 1), 0.2, np.float32)
    values[8, 8] = 1.0
    weight = np.ones((16, 16), np.float32)
    weight[8, 8] = 0.5

    assert 0.55 < push_pull(values, weight)[8, 8, 0] < 0.75


def test_where_nothing_is_known_all_is_black() -> None:
    found = push_pull(picture(9, 5), np.zeros((9, 5), np.float32))

    np.testing.assert_array_equal(found, np.zeros((9, 5, 2)))
