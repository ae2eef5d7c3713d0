from __future__ import annotations

import numpy as np
import pytest

from tests.evaluation.baselines.woodham1980 import single_shot_normals

DIRECTIONS = np.array([[-0.6, 0.0, 0.8], [0.6, 0.0, 0.8], [0.0, 0.6, 0.8]])
COLOURS = np.array([[1.0, 0.2, 0.1], [0.4, 1.0, 0.3], [0.1, 0.3, 1.0]])


@pytest.mark.parametrize("albedo", [0.2, 1.0])
def test_a_grey_surface_is_found_exactly(albedo: float) -> None:
    normals = np.array([[[0.0, 0.0, 1.0], [0.1, 0.2, 0.97], [-0.2, 0.1, 0.97]]])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    photograph = albedo * np.einsum("kj,jc,hwc->hwk", COLOURS, DIRECTIONS, normals)

    found = single_shot_normals(photograph.astype(np.float32), COLOURS, DIRECTIONS)

    np.testing.assert_allclose(found, normals, atol=1e-5)


def test_a_black_pixel_has_no_normal() -> None:
    found = single_shot_normals(np.zeros((1, 1, 3), np.float32), COLOURS, DIRECTIONS)

    assert (found == 0).all()
