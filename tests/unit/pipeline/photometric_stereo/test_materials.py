from __future__ import annotations

import numpy as np
import pytest

from pipeline.photometric_stereo.materials import Materials, find_materials, find_segments

CENTRES = np.array([[0.3, 0.4], [0.4, 0.35], [0.25, 0.45]])


def clouds(count: int = 200, spread: float = 0.002) -> np.ndarray:
    random = np.random.default_rng(0)
    return np.concatenate([c + spread * random.standard_normal((count, 2)) for c in CENTRES])


def test_clusters_are_found() -> None:
    found = find_materials(clouds(), 0.008)

    assert len(found) == 3
    for centre in CENTRES:
        assert np.linalg.norm(found.centres - centre, axis=1).min() < 0.001


def test_few_pixels_are_no_material() -> None:
    """A cluster of 14 pixels is none beside others, and one of 15 is."""
    for count, materials in ((14, 3), (15, 4)):
        stray = np.tile([[0.1, 0.8]], (count, 1))
        assert len(find_materials(np.concatenate([clouds(), stray]), 0.008)) == materials


def test_whatever_there_is_is_one_material_at_least() -> None:
    assert len(find_materials(np.array([[0.3, 0.3], [0.5, 0.2]]), 0.008)) == 1


def test_a_gradient_has_no_more_than_sixty() -> None:
    x = np.linspace(0, 1, 20_000)

    assert len(find_materials(np.stack([x, 1 - x], axis=1), 0.002)) == 60


def test_shares_add_up_and_are_those_of_the_nearest() -> None:
    materials = find_materials(clouds(), 0.008)

    which, share = materials.shares(np.concatenate([CENTRES, [[0.9, 0.05]]]))

    np.testing.assert_allclose(share.sum(axis=1), 1)
    np.testing.assert_allclose(share[:3, 0], 1, atol=1e-6)
    for row, centre in zip(which, CENTRES, strict=False):
        assert np.linalg.norm(materials.centres[row[0]] - centre) < 0.001


def test_a_pixel_between_two_materials_is_shared() -> None:
    materials = find_materials(np.repeat([[0.3, 0.4], [0.304, 0.4]], 100, axis=0), 0.003)

    which, share = materials.shares(np.array([[0.302, 0.4]]))

    assert sorted(which[0]) == [0, 1]
    np.testing.assert_allclose(share[0], 0.5, atol=0.01)


def test_the_nearest_three_count_by_their_distance() -> None:
    """As a normal distribution whose deviation is half the radius has them."""
    away = np.array([3.0, 1.0, 2.0, 4.0]) * 0.004
    materials = Materials(np.stack([0.3 + away, np.full(4, 0.4)], axis=1), 0.008)

    which, share = materials.shares(np.array([[0.3, 0.4]]))

    weights = np.exp([-1 / 2, -4 / 2, -9 / 2])
    assert which.tolist() == [[1, 2, 0]]
    np.testing.assert_allclose(share[0], weights / weights.sum())


@pytest.mark.parametrize(("side", "segments"), [(3, 0), (4, 2)])
def test_segments_hang_together_and_are_not_tiny(side: int, segments: int) -> None:
    """Two squares of one material apart: 9 pixels are too few, 16 are not."""
    mask = np.zeros((10, 20), bool)
    mask[1 : 1 + side, 1 : 1 + side] = mask[5 : 5 + side, 12 : 12 + side] = True

    found = find_segments(np.zeros(int(mask.sum()), int), mask)

    assert sorted(set(found)) == ([-1] if segments == 0 else [0, 1])
    picture = np.full(mask.shape, -2)
    picture[mask] = found
    assert segments == 0 or picture[1, 1] != picture[5, 12]


def test_neighbours_of_two_materials_are_two_segments() -> None:
    mask = np.ones((4, 8), bool)
    labels = (np.arange(8) >= 4).astype(int) + np.zeros((4, 1), int)

    found = find_segments(labels[mask], mask).reshape(4, 8)

    assert (found[:, :4] == found[0, 0]).all()
    assert (found[:, 4:] == found[0, 7]).all()
    assert found[0, 0] != found[0, 7]
