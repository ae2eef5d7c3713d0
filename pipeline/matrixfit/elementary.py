"""Exponential, logarithm and normal tail that compile to vector code where libm's do not.

They are inlined into loops over arrays, and right to some parts in 10¹⁵.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from pipeline.arrays import Floats64
from pipeline.compiling import inlined

_LOG2_HIGH, _LOG2_LOW = 0.6931471803691238, 1.9082149292705877e-10  # ln 2 in two parts
_ROUNDER = 1.5 * 2.0**52  # x + this has round(x) in its lowest bits
_LEAST_POWER = -708.0  # of e, for a result that is not denormal
_EXPONENT_BIAS = np.int64(1023)
_MANTISSA = np.int64(2**52 - 1)
_ONE = np.int64(1023 << 52)  # bits of 1.0
_WHOLE = np.int64(1075 << 52)  # bits of 2⁵², to which whole numbers can be added as bits
_TAIL_SCALE = 5.0
_FAR, _FRACTION_TERMS = 2.0, 100

_EXP = tuple(1.0 / math.factorial(k) for k in range(13))
_LOG = tuple(2.0 / (2 * k + 1) for k in range(11))


def _scaled_erfc(x: float) -> float:
    """erfc(x) exp(x²) for x ≥ 0, by Laplace's continued fraction where it converges soon."""
    if x < _FAR:
        return math.erfc(x) * math.exp(x * x)
    fraction = x
    for k in range(_FRACTION_TERMS, 0, -1):
        fraction = x + 0.5 * k / fraction
    return 1.0 / (math.sqrt(math.pi) * fraction)


def _tail(y: Floats64) -> Floats64:
    """Q(t) exp(t²/2) (t + s) / s at y = (t − s) / (t + s), −1…1, with the normal tail Q."""
    share = (1.0 - y) / 2.0
    away = _TAIL_SCALE * (1.0 / share - 1.0) / math.sqrt(2.0)
    return np.array([_scaled_erfc(x) for x in away]) / (2.0 * share)


_TAIL = tuple(Chebyshev.interpolate(_tail, 20).convert(kind=Polynomial).coef.tolist())


@inlined
def _horner(coefficients: tuple[float, ...], x: float) -> float:
    total = coefficients[-1]
    for k in range(len(coefficients) - 2, -1, -1):
        total = total * x + coefficients[k]
    return total


@inlined
def _polynomial(coefficients: tuple[float, ...], x: float) -> float:
    """Even and odd powers apart, so that neither waits for the other."""
    return _horner(coefficients[::2], x * x) + x * _horner(coefficients[1::2], x * x)


@inlined
def exp(x: float) -> float:
    """e^x up to x = 709; 0 instead of a denormal result."""
    shifted = x * 1.4426950408889634 + _ROUNDER
    whole = shifted - _ROUNDER
    r = (x - whole * _LOG2_HIGH) - whole * _LOG2_LOW
    power = np.int64((np.float64(shifted).view(np.int64) + _EXPONENT_BIAS) << 52).view(np.float64)
    return 0.0 if x < _LEAST_POWER else _polynomial(_EXP, r) * power


@inlined
def log(x: float) -> float:
    """ln x of a positive number that is not denormal."""
    bits = np.float64(x).view(np.int64)
    m = np.int64((bits & _MANTISSA) | _ONE).view(np.float64)
    e = np.int64((bits >> 52) | _WHOLE).view(np.float64) - (2.0**52 + 1023.0)
    high = m > 1.4142135623730951
    m = 0.5 * m if high else m
    e = e + 1.0 if high else e
    f = (m - 1.0) / (m + 1.0)
    found = e * _LOG2_HIGH + (f * _polynomial(_LOG, f * f) + e * _LOG2_LOW)
    return found if x < math.inf else x


@inlined
def ndtr(z: float, bell: float) -> float:
    """Normal distribution function, of which exp(-z²/2) is known."""
    size = abs(z)
    share = _TAIL_SCALE / (size + _TAIL_SCALE)
    tail = bell * share * _polynomial(_TAIL, 1.0 - 2.0 * share)
    return 1.0 - tail if z > 0.0 else tail
