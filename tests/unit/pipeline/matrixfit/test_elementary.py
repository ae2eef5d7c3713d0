from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from scipy import special

from pipeline.arrays import Floats64
from pipeline.matrixfit.elementary import exp, log, ndtr


@njit()
def exps(x: Floats64) -> Floats64:
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = exp(x[i])
    return out


@njit()
def logs(x: Floats64) -> Floats64:
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = log(x[i])
    return out


@njit()
def ndtrs(x: Floats64) -> Floats64:
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = ndtr(x[i], math.exp(-0.5 * x[i] * x[i]))
    return out


def test_the_exponential_is_right() -> None:
    x = np.concatenate([np.linspace(-707.9, 709.0, 20001), np.linspace(-1, 1, 20001)])

    np.testing.assert_allclose(exps(x), np.exp(x), rtol=1e-15)
    np.testing.assert_array_equal(exps(np.array([-1e9, -709.9, -709, 0])), [0, 0, 0, 1])
    assert np.isnan(exps(np.array([np.nan]))).all()


def test_the_logarithm_is_right() -> None:
    x = np.concatenate([np.exp(np.linspace(-700, 700, 20001)), np.linspace(0.5, 2.0, 20001)])

    np.testing.assert_allclose(logs(x), np.log(x), rtol=1e-15)
    assert logs(np.ones(1))[0] == 0.0
    assert np.isnan(logs(np.array([np.nan]))).all()


@pytest.mark.parametrize(("low", "high", "rel"), [(-1, 9, 1e-14), (-37, -1, 5e-13)])
def test_the_normal_distribution_function_is_right(low: float, high: float, rel: float) -> None:
    z = np.linspace(low, high, 20001)

    np.testing.assert_allclose(ndtrs(z), special.ndtr(z), rtol=rel)
    np.testing.assert_array_equal(ndtrs(np.array([-1e6, 1e6])), [0.0, 1.0])
