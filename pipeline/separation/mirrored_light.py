"""Light of two lamps as surfaces give it back: matt, and mirrored.

Matt light has the surface's colour, mirrored light the lamp's (Shafer 1985, the dichromatic model).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pipeline.arrays import Floats64
from pipeline.compiling import inlined
from pipeline.images.frames import Colour, Numbers, numbers_of
from pipeline.lamps.lamps import Lamps
from pipeline.light.shares import dot, doubles
from pipeline.separation.proportions import colour_of, light_of, scaled, times

KINDS = 3
"""What is mirrored: the first lamp, the second, the flash."""

MODEL = 0.017
"""Relative: what matrices leave over of matt light."""

SHADING = 0.5
"""Relative: how far shares change about a place."""

TINY = np.float32(1e-12)
"""Light that is as good as none."""


class TwoLamps(NamedTuple):
    """What two lamps give, as compiled loops take it: matt light as in Lamps, and mirrored light.

    matrices: (3, 3) of each lamp, row by row. where, terms: Deviations.numbers. weights: (3,) of
    the channels. colours: (3,) of each lamp, as a mirror shows it.
    """

    matrices: tuple[Numbers, ...]
    where: Numbers
    terms: tuple[Numbers, ...]
    weights: Numbers
    colours: tuple[Numbers, ...]


def light_of_two(lamps: Lamps, colours: Floats64) -> TwoLamps:
    """Two lamps as loops take them; colours: (2, 3) of mirrored light, as in Highlights."""
    where, terms = lamps.deviations.numbers()
    return TwoLamps(
        tuple(numbers_of(matrix) for matrix in lamps.matrices),
        where,
        terms,
        numbers_of(lamps.channel_weights),
        tuple(numbers_of(one) for one in colours),
    )


@inlined
def matt_light(lamps: TwoLamps, f: Colour, s0: Any, s1: Any) -> tuple[Colour, Colour]:
    """What each lamp gives of its share matt where the flash gives f."""
    q = colour_of(lamps.where, f)
    first = light_of(lamps.matrices[0], lamps.terms[0], f, q)
    second = light_of(lamps.matrices[1], lamps.terms[1], f, q)
    return scaled(first, s0), scaled(second, s1)


@inlined
def explain(
    seen: Colour, first: Colour, second: Colour, mirrored: Colour, weights: Numbers
) -> tuple[Any, Any]:
    """Factors a, b ≥ 0 with which a · (first + second) + b · mirrored is nearest to what is seen.

    Least squares, each channel weighed. a is held near 1, the more firmly the less matt light there
    is beside a strong highlight, which then tells little of it.
    """
    matt = first[0] + second[0], first[1] + second[1], first[2] + second[2]
    seen, matt = doubles(times(seen, weights)), doubles(times(matt, weights))
    mirrored = doubles(times(mirrored, weights))
    once = (MODEL / SHADING) ** 2 * max(squared(seen), TINY)
    s0, s1 = dot(matt, seen) + once, dot(mirrored, seen)
    g00, g01, g11 = squared(matt) + once, dot(matt, mirrored), squared(mirrored)
    a, b = g11 * s0 - g01 * s1, g00 * s1 - g01 * s0
    if not b > 0:
        return s0 / g00, 0.0
    if a < 0:
        return 0.0, s1 / g11
    scale = g00 * g11 - g01 * g01
    return a / scale, b / scale


@inlined
def mirrored_light(colours: tuple[Numbers, ...], kind: int, s0: Any, s1: Any) -> Colour:
    """Light of a lamp as it is mirrored; of the flash, what its part pretends that lamps give."""
    p, q = _single(colours[0]), _single(colours[1])
    if kind == 0:
        return p
    if kind == 1:
        return q
    return -(s0 * p[0] + s1 * q[0]), -(s0 * p[1] + s1 * q[1]), -(s0 * p[2] + s1 * q[2])


@inlined
def _single(a: Numbers) -> Colour:
    return np.float32(a[0]), np.float32(a[1]), np.float32(a[2])


@inlined
def squared(a: Colour) -> Any:
    """Square of a colour's length."""
    return dot(a, a)
