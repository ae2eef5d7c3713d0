from __future__ import annotations

import numpy as np

from pipeline.encode.coded_normals import CodedNormals
from pipeline.vectors import unit


def test_normals_come_back_but_for_rounding_and_unknown_ones_as_nan() -> None:
    normals = unit(np.random.default_rng(1).normal(size=(6, 5, 3))).astype(np.float32)
    normals[0, :3] = np.eye(3)
    normals[1, :3] = -np.eye(3)
    normals[4, 2] = np.nan
    coded = CodedNormals((6, 5, 3))

    coded.add(normals[:4])
    coded.add(normals[4:])

    assert coded.shape == (6, 5, 3)
    assert coded[:].dtype == np.float32
    np.testing.assert_allclose(coded[:], normals, atol=1.6e-5)
    np.testing.assert_array_equal(coded[0:2][:, :3], [np.eye(3), -np.eye(3)])
    np.testing.assert_array_equal(np.isnan(coded[3:6]), np.isnan(normals[3:6]))


def test_what_has_not_come_is_unknown() -> None:
    assert np.isnan(CodedNormals((2, 3, 3))[:]).all()
