from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.colour.curves import linear_to_srgb, srgb_to_linear

KNOWN = [(0.0, 0.0), (0.04045, 0.0031308), (0.5, 0.2140411), (0.7353570, 0.5), (1.0, 1.0)]


@pytest.mark.parametrize(("code", "light"), KNOWN)
def test_known_points(code: float, light: float) -> None:
    assert srgb_to_linear(np.array([code]))[0] == pytest.approx(light, rel=1e-4)
    assert linear_to_srgb(np.array([light]))[0] == pytest.approx(code, rel=1e-4)


def test_below_black_both_go_on_as_a_line() -> None:
    assert srgb_to_linear(np.array([-0.1292]))[0] == pytest.approx(-0.01)
    assert linear_to_srgb(np.array([-0.01]))[0] == pytest.approx(-0.1292)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_one_undoes_the_other_in_the_type_given(kind: type[np.floating[Any]]) -> None:
    values = np.linspace(-0.2, 1.5, 1000, dtype=kind).reshape(10, 100)

    there = srgb_to_linear(values)

    assert there.dtype == kind
    np.testing.assert_allclose(linear_to_srgb(there), values, atol=1e-5)
