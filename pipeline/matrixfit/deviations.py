"""How lamps deviate from their matrices on surfaces of some colour, told by neighbours.

No matrix takes the flash part exactly to the light of a lamp: what is left over depends on the
surface. Neighbouring pixels of different colours lie in the same light, so their shares must be
the same; where they are not, the matrices are wrong for these colours. Places that show one lamp
alone tell what is wrong for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.frames import Numbers
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import Evidence
from pipeline.pair.reduced import ReducedPair

TERMS = 10
"""Monomials of two variables up to the third degree."""

FARTHEST = 3.0
"""Standard deviations of chromaticity that polynomials follow; cubics run away beyond the data."""

_MIN_SPREAD = 1e-6
_NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))
_UNLIKE, _SURELY = 0.015, 10.0  # chromaticity and deviations; neighbours of one colour tell nothing
# times the offset of a flash part that was laid on: beside edges it shows the other side's colours
_CLEAR, _SURELY_CLEAR = 17.0, 3.0
_PAIRS, _SINGLES, _ALONE = 8000, 6000, 300.0
_FEWEST_PAIRS = 500
_WEIGHT = 0.05  # of one datum: neighbours repeat each other
_UNEVEN, _OFF = 0.1, 0.033  # relative shares and chromaticities; what is further apart has a reason
_DEVIATION, _OF_MATRIX = 0.01, 0.001  # relative, of higher terms and of those that a matrix has
_MATRIX_TERMS = [0, 1, 4]  # constant and linear ones
_NEGATIVE = 0.02  # of all shares
_ALIKE = 0.02  # relative singular value below which shares are not told apart
_CHUNK = 2000


@dataclass(frozen=True)
class Deviations:
    """Cubic polynomials of a surface's chromaticity under the flash, for each lamp and channel.

    A lamp's light is z · (T I_flash + s · p(q)), s the sum of I_flash's channels, and q its red and
    green chromaticity less `centre` (2,), by `spread` (2,), at most 3 either way. terms: (N, 3, 10)
    of 1, q₁, q₁², q₁³, q₂, q₁q₂, q₁²q₂, q₂², q₁q₂², q₂³.
    """

    centre: Floats64
    spread: Floats64
    terms: Floats64

    def numbers(self) -> tuple[Numbers, tuple[Numbers, ...]]:
        """Centre and 1 ÷ spread, and each lamp's 30 terms, as compiled loops take them."""
        where = (*self.centre.tolist(), *(1.0 / self.spread).tolist())
        return where, tuple(tuple(one.ravel().tolist()) for one in self.terms)


def no_deviations(lamps: int) -> Deviations:
    """Matrices as they are."""
    return Deviations(np.zeros(2), np.ones(2), np.zeros((lamps, 3, TERMS)))


def monomials(q: Floats64) -> Floats64:
    """Return (..., 10) of the variables (..., 2), which are kept within 3 either way."""
    a, b = np.clip(q[..., 0], -FARTHEST, FARTHEST), np.clip(q[..., 1], -FARTHEST, FARTHEST)
    one = np.ones_like(a)
    return np.stack([one, a, a * a, a**3, b, a * b, a * a * b, b * b, a * b * b, b**3], axis=-1)


def find_deviations(
    reduced: ReducedPair, evidence: Evidence, matrices: Floats64, channel_weights: Floats64
) -> Deviations:
    """Fit the deviations of two or three lamps (N, 3, 3) by one robust step of Gauss and Newton.

    What is made small: differences of the shares of neighbours of unlike colours; of two lamps
    what no mixture of them gives; and how far differences across the edges of shadows lie from the
    lamp that they show. Each is weighed by Geman and McClure's function, so that edges of shadows
    and of things do not count, and deviations are held small. channel_weights: (3,), as of Lamps.
    Where hardly any neighbours differ in colour there are no deviations, nor where no shadow has an
    edge, since neighbours do not tell what all surfaces have in common.
    """
    count = len(matrices)
    unlike = _unlike_neighbours(reduced)
    if count < 2 or not evidence.has_edges or len(unlike) < _FEWEST_PAIRS:
        return no_deviations(count)
    flash = reduced.flash[reduced.usable].astype(np.float64)
    chromaticity = flash[:, :2] / flash.sum(axis=1, keepdims=True)
    centre, spread = chromaticity.mean(axis=0), chromaticity.std(axis=0) + _MIN_SPREAD
    none_yet = Deviations(centre, spread, np.zeros((count, 3, TERMS)))

    first, second = _spaced(unlike, _PAIRS).T
    single = _spaced(np.arange(len(flash)), _SINGLES)
    some, places = np.unique(np.concatenate([first, second, single]), return_inverse=True)
    pixels = _Pixels(reduced, some, matrices, channel_weights, none_yet)
    of_pairs, of_singles = len(first), 2 * len(first)
    normal = _Normal(count)
    _add_neighbours(normal, pixels, places[:of_pairs], places[of_pairs:of_singles])
    if count < 3:
        _add_off_plane(normal, pixels, places[of_singles:])
    _add_alone(normal, evidence.differences, matrices, none_yet)
    return Deviations(centre, spread, normal.solved(pixels.size, pixels.powers))


def _unlike_neighbours(reduced: ReducedPair) -> NDArray[np.int64]:
    """Neighbours (n, 2) of unlike colours, numbered among the usable pixels.

    Side by side; where the flash part may be misplaced, so far apart that edges lie between them.
    """
    height, width = reduced.usable.shape
    number = np.cumsum(reduced.usable).reshape(height, width) - 1
    total = reduced.flash.sum(axis=2, keepdims=True)
    total = np.where(total > 0, total, 1.0)
    colour = reduced.flash / total
    noise = np.sqrt(reduced.flash_variance.sum(axis=2)) / total[..., 0]
    step = max(1, round(_CLEAR * reduced.offset))
    surely = _SURELY if step == 1 else _SURELY_CLEAR
    found = [np.zeros((0, 2), np.int64)]
    for down, right in step * np.array(_NEIGHBOURS):
        if down >= height or abs(right) >= width:
            continue
        one = slice(0, height - down), slice(max(0, -right), width - max(0, right))
        other = slice(down, height), slice(max(0, right), width - max(0, -right))
        apart = np.abs(colour[one] - colour[other]).max(axis=2) > (
            _UNLIKE + surely * np.hypot(noise[one], noise[other])
        )
        apart &= reduced.usable[one] & reduced.usable[other]
        found.append(np.stack([number[one][apart], number[other][apart]], axis=1))
    return np.concatenate(found)


def _spaced(items: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """At most so many of the items (n, ...), evenly spaced."""
    if len(items) <= count:
        return items
    return items[np.arange(count) * len(items) // count]


class _Pixels:
    """Some pixels by the sum of their flash: what lamps give there, and their shares.

    responses: (n, 3, N) and light: (n, 3), each channel weighed. inverse: (n, N, 3), light to
    shares. shares: (n, N); noise: (n,), variance of their sum. left: (n, 3), the light that shares
    leave; left_noise: (n,), its variance. weights: (3,) of the channels. powers: (n, 10). size:
    (N,), mean sum of the channels that lamps give, not weighed.
    """

    def __init__(
        self,
        reduced: ReducedPair,
        some: NDArray[np.int64],
        matrices: Floats64,
        weights: Floats64,
        where: Deviations,
    ) -> None:
        """some: (n,) of the usable pixels. where: centre and spread of chromaticities."""
        flash, light, flash_variance, variance = (
            image[reduced.usable][some].astype(np.float64)
            for image in (
                reduced.flash,
                reduced.no_flash,
                reduced.flash_variance,
                reduced.no_flash_variance,
            )
        )
        total = flash.sum(axis=1, keepdims=True)
        flash, light = flash / total, light / total
        variance += np.square(light) * flash_variance.sum(axis=1, keepdims=True)
        variance *= np.square(weights / total)
        predicted = np.maximum(np.einsum("jkl,nl->nkj", matrices, flash), 0.0)
        self.size = predicted.sum(axis=1).mean(axis=0)
        self.responses = predicted * weights[:, None]
        gram = self.responses.transpose(0, 2, 1) @ self.responses
        least = (_ALIKE**2) * np.trace(gram, axis1=1, axis2=2)
        gram += (least + 1e-30)[:, None, None] * np.eye(len(matrices))
        self.inverse = np.linalg.solve(gram, self.responses.transpose(0, 2, 1))
        self.light = light * weights
        self.shares = np.einsum("njk,nk->nj", self.inverse, self.light)
        self.left = self.light - np.einsum("nkj,nj->nk", self.responses, self.shares)
        self.noise = np.einsum("njk,nk->n", np.square(self.inverse), variance)
        self.left_noise = variance.sum(axis=1)
        self.weights = weights
        self.powers = monomials((flash[:, :2] - where.centre) / where.spread)

    def change(self, by_light: Floats64, chosen: NDArray[np.int64]) -> Floats64:
        """What deviations change of something linear in light: (n, m, N · 3 · 10).

        by_light: (n, m, 3), how it changes with the light that no share takes yet.
        """
        shares, powers = np.maximum(self.shares[chosen], 0.0), self.powers[chosen]
        changed = np.einsum("nak,nj,nm->najkm", -by_light * self.weights, shares, powers)
        return np.asarray(changed.reshape(*by_light.shape[:2], -1))


class _Normal:
    """Normal equations in the terms of all lamps, laid out as (N, 3, 10)."""

    def __init__(self, lamps: int) -> None:
        self._shape = (lamps, 3, TERMS)
        size = lamps * 3 * TERMS
        self._square, self._right = np.zeros((size, size)), np.zeros(size)

    def add(
        self, change: Floats64, value: Floats64, squared: Floats64 | float, weight: Floats64
    ) -> None:
        """Add residuals (n, m) with their derivatives (n, m, size), robustly.

        squared: (n,), of the length beyond which they count less. weight: (n,).
        """
        robust = (1.0 + np.square(value).sum(axis=1) / squared) ** -2
        root = np.sqrt(robust * weight / squared)
        rows = (change * root[:, None, None]).reshape(-1, change.shape[2])
        self._square += rows.T @ rows
        self._right += rows.T @ (value * root[:, None]).ravel()

    def solved(self, size: Floats64, powers: Floats64) -> Floats64:
        """Terms (N, 3, 10); size: (N,) of the lamps' light, by which deviations are relative."""
        allowed = np.full(TERMS, _DEVIATION)
        allowed[_MATRIX_TERMS] = _OF_MATRIX
        allowed = allowed / np.sqrt((powers**2).mean(axis=0))
        prior = 1.0 / np.square(size[:, None, None] * allowed) * np.ones(self._shape)
        square = self._square + np.diag(prior.ravel())
        return np.asarray(-np.linalg.solve(square, self._right).reshape(self._shape))


def _add_neighbours(
    normal: _Normal, pixels: _Pixels, first: NDArray[np.int64], second: NDArray[np.int64]
) -> None:
    """Shares of neighbours are the same."""
    for start in range(0, len(first), _CHUNK):
        a, b = first[start : start + _CHUNK], second[start : start + _CHUNK]
        mean = 0.5 * np.maximum(pixels.shares[[a, b]].sum(axis=2), 1e-6).sum(axis=0)[:, None]
        apart = (pixels.shares[a] - pixels.shares[b]) / mean
        change = pixels.change(pixels.inverse[a] / mean[..., None], a)
        change -= pixels.change(pixels.inverse[b] / mean[..., None], b)
        lit = np.minimum(pixels.shares[a], pixels.shares[b]) > -_NEGATIVE * mean
        noise = (pixels.noise[a] + pixels.noise[b]) / np.square(mean[:, 0])
        normal.add(change, apart, _UNEVEN**2 + noise, _WEIGHT * lit.all(axis=1))


def _add_off_plane(normal: _Normal, pixels: _Pixels, chosen: NDArray[np.int64]) -> None:
    """Two lamps mix to all light that there is."""
    for start in range(0, len(chosen), _CHUNK):
        some = chosen[start : start + _CHUNK]
        light = pixels.light[some].sum(axis=1)
        off = np.eye(3) - pixels.responses[some] @ pixels.inverse[some]
        change = pixels.change(off / light[:, None, None], some)
        weight = np.full(len(some), _WEIGHT)
        noise = pixels.left_noise[some] / np.square(light)
        normal.add(change, pixels.left[some] / light[:, None], _OFF**2 + noise, weight)


def _add_alone(
    normal: _Normal, shown: Chromaticities, matrices: Floats64, where: Deviations
) -> None:
    """Differences across edges of shadows have the chromaticity of the lamp that is nearest."""
    lamps = len(matrices)
    u = shown.light
    powers = monomials((shown.x[:, :2] - where.centre) / where.spread)
    light = np.maximum(np.einsum("jkl,nl->jnk", matrices, shown.x), 1e-9)
    whole = light.sum(axis=2)
    off = light / whole[..., None] - u
    nearest = np.linalg.norm(off, axis=2).argmin(axis=0)
    each = np.arange(len(shown))
    by_light = (np.eye(3) - u[:, :, None]) / whole[nearest, each][:, None, None]
    change = np.zeros((len(shown), 3, lamps, 3, TERMS))
    change[each, :, nearest] = np.einsum("nak,nm->nakm", by_light, powers)
    weight = np.full(len(shown), _ALONE / len(shown))
    off_nearest = off[nearest, each]
    squared = _OFF**2 + shown.variance
    normal.add(change.reshape(len(shown), 3, -1), off_nearest, squared, weight)
