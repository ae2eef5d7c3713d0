from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.projection import from_plane, rotate_to_pole, to_plane
from pipeline.vectors import unit
from tests.unit.pipeline.hui2018.known_lights import COOL, WARM


@pytest.mark.parametrize("center", [WARM, [0.0, 1, 0], [0, 0, 2], [0.0, -3, 0.1], [-1.0, 0, 0]])
def test_the_center_goes_to_the_pole_by_a_rotation(center: Floats64) -> None:
    rotation = rotate_to_pole(np.asarray(center))

    np.testing.assert_allclose(rotation @ unit(np.asarray(center)), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize("center", [WARM, COOL, np.array([0.0, 1.0, 0.0]), np.array([0, 0.0, 2])])
def test_from_plane_inverts_to_plane(center: Floats64) -> None:
    rng = np.random.default_rng(4)
    gammas = unit(unit(center) + rng.normal(0, 0.2, (100, 3)))

    points, rotation = to_plane(gammas, center)

    assert points.shape == (100, 2)
    np.testing.assert_allclose(from_plane(points, rotation), gammas, atol=1e-12)


def test_the_projection_is_gnomonic() -> None:
    """30° from the pole is tan 30° from the middle, whatever the length of the vector."""
    tilted = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, np.sqrt(3)], [0.0, -2.0, 2.0]])

    points, _ = to_plane(tilted, np.array([0.0, 0.0, 1.0]))

    lengths = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(lengths, [0, 1 / np.sqrt(3), 1], atol=1e-12)
    assert points[1] @ points[2] == pytest.approx(0)  # at right angles, as the vectors' azimuths


def test_mixtures_of_two_lights_lie_on_a_line() -> None:
    t = np.linspace(0, 1, 9)[:, None]

    points, _ = to_plane(unit((1 - t) * WARM + t * COOL), unit(WARM + COOL))

    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    assert spread[1] < 1e-12 < spread[0]


def test_points_behind_the_pole_are_not_projected() -> None:
    points, _ = to_plane(np.array([WARM, -WARM, [0.65, -0.7, 0.0]]), WARM)

    np.testing.assert_allclose(points, [[0, 0]], atol=1e-12)


def test_nothing_gives_nothing() -> None:
    points, _ = to_plane(np.empty((0, 3)), WARM)

    assert points.shape == (0, 2)
    assert from_plane(points, np.eye(3)).shape == (0, 3)
