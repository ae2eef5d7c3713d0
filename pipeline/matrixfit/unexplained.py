"""What lamps leave unexplained, told without their likelihood.

The likelihood prefers narrow triangles, also where they are wrong. These signs do not: light that
no mixture of the lamps gives, differences across shadow edges that show none of them, and pixels
outside their triangle.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.compiling import exact, spliced
from pipeline.images.frames import Colour, Image, Mask
from pipeline.images.quantiles import weighted_quantile
from pipeline.light.shares import shares, shares_of_three, shares_of_two
from pipeline.matrixfit.chromaticities import Chromaticities
from pipeline.matrixfit.evidence import Evidence
from pipeline.pair.reduced import ReducedPair
from pipeline.vectors import cross_2d

_QUANTILE = 0.9
_OFF, _OUTSIDE = 0.03, 0.005  # chromaticity, beyond two standard deviations
_ON_LINE = 0.015  # the same, without noise
_TERMINATOR = 0.2  # of an edge: it is wide, and found again in every direction
_BESIDE, _ALIKE = 0.01, 1e-3  # of the light; sine between lamps whose plane is not told
_MUCH_LEFT, _MUCH_OFF, _MUCH_OUTSIDE = 0.01, 0.4, 0.1


def unexplained(reduced: ReducedPair, evidence: Evidence, matrices: Floats64) -> float:
    """How much lamps (N, 3, 3) leave unexplained, all signs together; of three, 1 is much."""
    signs = left_over(reduced, matrices) / _MUCH_LEFT
    signs += share_off(evidence.differences, matrices) / _MUCH_OFF
    if len(matrices) < 3:
        return signs
    return signs + share_outside(evidence.pixels, matrices) / _MUCH_OUTSIDE


def left_over(reduced: ReducedPair, matrices: Floats64) -> float:
    """Relative light that lamps (N, 3, 3) leave unexplained: a quantile, less the noise's own.

    That is the photograph's, or what the lamps make of a weak flash part's, if it is more.
    """
    left, light, own, mixed = _left_of_pixels(reduced, matrices)
    # each lamp follows the noise of one of three channels
    variance = np.maximum(own, np.float32((3 - len(matrices)) / 3) * mixed)
    relative = [one / light for one in (np.sqrt(variance), left)]
    noise, whole = (weighted_quantile(one, light, _QUANTILE) for one in relative)
    return float(np.sqrt(max(whole**2 - noise**2, 0.0)))


def mean_left_over(reduced: ReducedPair, matrices: Floats64) -> float:
    """Share of all light that lamps (N, 3, 3) leave unexplained, noise included."""
    left, light, *_ = _left_of_pixels(reduced, matrices)
    return float(left.sum(dtype=np.float64) / light.sum(dtype=np.float64))


def share_beside(reduced: ReducedPair, matrices: Floats64) -> float:
    """Share of the light that is surely no mixture of two lamps (2, 3, 3).

    It is that of pixels whose light lies more than a hundredth of itself, and three standard
    deviations, beside the plane of all mixtures on their surface. It needs no edges of shadows.
    """
    usable = reduced.usable
    no_flash, flash = reduced.no_flash[usable], reduced.flash[usable]
    weights = (1.0 / no_flash.mean(axis=0)).astype(np.float32)
    seen, weighed = no_flash * weights, weights[:, None] * matrices.astype(np.float32)
    one, other = predicted = np.maximum(flash @ weighed.transpose(0, 2, 1), 0.0)
    normal = np.cross(one, other)
    length = np.linalg.norm(normal, axis=1)
    alike = length <= _ALIKE * np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    normal /= np.maximum(length, 1e-30)[:, None]
    by_flash = sum(
        share[:, None] * (normal @ lamp)
        for share, lamp in zip(shares(seen, predicted), weighed, strict=True)
    )
    variance = _total(np.square(normal * weights) * reduced.no_flash_variance[usable])
    variance += _total(np.square(by_flash) * reduced.flash_variance[usable])
    variance -= 2 * _total(normal * weights * by_flash * reduced.covariance[usable])
    beside = np.abs(_total(normal * seen))
    surely = beside > np.maximum(_BESIDE * np.linalg.norm(seen, axis=1), 3.0 * np.sqrt(variance))
    light = _total(no_flash)
    return float(light[surely & ~alike].sum(dtype=np.float64) / light.sum(dtype=np.float64))


def share_off(differences: Chromaticities, matrices: Floats64) -> float:
    """Share 0…1 of the differences that show none of the lamps (N, 3, 3) alone."""
    if not len(differences):
        return 0.0
    return float(1.0 - shares_alone(differences, matrices).sum())


def share_of_third(differences: Chromaticities, matrices: Floats64) -> float:
    """Share of the differences that two lamps (2, 3, 3) do not give, and a third may.

    They show neither lamp alone, nor more of one and less of the other. The latter lie beyond the
    lamps on the line through both: no shadow ends there, but a surface turns from one lamp to the
    other, as at the edge of a box of which the flash shows both sides alike.
    """
    if not len(differences):
        return 0.0
    one, other = differences.corners(matrices)
    limit = _OFF + 2 * _deviation(differences)
    between, of_one, of_other = other - one, differences.u - one, differences.u - other
    length = np.maximum(np.linalg.norm(between, axis=1), 1e-9)
    near = np.minimum(np.linalg.norm(of_one, axis=1), np.linalg.norm(of_other, axis=1)) <= limit
    # whatever its noise, for that would put a third lamp there, too
    on_line = np.abs(cross_2d(of_one, between)) <= _ON_LINE * length
    outside = ((of_one * between).sum(axis=1) < 0) | ((of_other * between).sum(axis=1) > 0)
    # lamps that are nearly one have no line
    swapped = on_line & outside & (length > _OFF)
    return float(np.mean(~near & ~swapped))


def shares_alone(data: Chromaticities, matrices: Floats64) -> Floats64:
    """Shares (N,) of the data that show each of the lamps (N, 3, 3) alone, 0 without any."""
    if not len(data):
        return np.zeros(len(matrices))
    off = np.linalg.norm(data.u - data.corners(matrices), axis=2)
    shown = off.min(axis=0) <= _OFF + 2 * _deviation(data)
    nearest = off.argmin(axis=0)
    return np.array([np.mean(shown & (nearest == lamp)) for lamp in range(len(matrices))])


def places_alone(evidence: Evidence, matrices: Floats64) -> Floats64:
    """Places (N,) that show each of the lamps (N, 3, 3) alone ÷ usable pixels.

    They are edges of shadows, and terminators, which count less.
    """
    edges = evidence.difference_share * shares_alone(evidence.differences, matrices)
    bends = evidence.terminator_share * shares_alone(evidence.terminators, matrices)
    return edges + _TERMINATOR * bends


def share_outside(pixels: Chromaticities, matrices: Floats64) -> float:
    """Share 0…1 of the pixels outside the triangle of three lamps (3, 3, 3)."""
    corners = pixels.corners(matrices)
    turn = np.sign(cross_2d(corners[1] - corners[0], corners[2] - corners[0]))
    inside = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        edge = corners[b] - corners[a]
        length = np.maximum(np.linalg.norm(edge, axis=1), 1e-9)
        inside.append(turn * cross_2d(edge, pixels.u - corners[a]) / length)
    outside = -np.min(inside, axis=0)
    return float((outside > _OUTSIDE + 2 * _deviation(pixels)).mean())


def _left_of_pixels(reduced: ReducedPair, matrices: Floats64) -> Floats32:
    """What lamps (N, 3, 3) leave of usable pixels: (4, n), as _leave writes it."""
    light = reduced.no_flash[reduced.usable]
    weights = (1.0 / light.mean(axis=0)).astype(np.float32)
    found = np.empty((4, len(light)), np.float32)
    _leave(
        reduced.no_flash,
        reduced.flash,
        reduced.no_flash_variance,
        reduced.flash_variance,
        reduced.flash_only,
        reduced.usable,
        matrices.astype(np.float32),
        weights,
        found,
    )
    return found


@exact
def _leave(
    no_flash: Image,
    flash: Image,
    no_flash_variance: Image,
    flash_variance: Image,
    flash_only: bool,
    usable: Mask,
    matrices: Floats32,
    weights: Floats32,
    found: Floats32,
) -> None:
    """Write (4, n) of the usable pixels: light that lamps leave unexplained, all light, variances.

    These are the photograph's own, and that of the light less the flash part by the mixture of the
    lamps. The rest as in ReducedPair. weights: (3,) of the channels.
    """
    zero, two = np.float32(0.0), np.float32(2.0)
    count, at = len(matrices), 0
    lit, share = np.zeros((3, 3), np.float32), np.zeros(3, np.float32)
    for y in range(usable.shape[0]):
        for x in range(usable.shape[1]):
            if not usable[y, x]:
                continue
            light, (r, g, b) = _pixel(no_flash, y, x), _pixel(flash, y, x)
            for j in range(count):
                for k in range(3):
                    given = matrices[j, k, 0] * r + matrices[j, k, 1] * g + matrices[j, k, 2] * b
                    lit[j, k] = weights[k] * max(given, zero)
            seen = light[0] * weights[0], light[1] * weights[1], light[2] * weights[2]
            first = lit[0, 0], lit[0, 1], lit[0, 2]
            second, third = (lit[1, 0], lit[1, 1], lit[1, 2]), (lit[2, 0], lit[2, 1], lit[2, 2])
            if count < 3:  # of one lamp the second is black
                z0, z1, scale = shares_of_two(seen, first, second)
                share[0], share[1] = z0 / scale, z1 / scale
            else:
                share[0], share[1], share[2] = shares_of_three(seen, first, second, third)
            left, own, mixed = zero, zero, zero
            for k in range(3):
                rest = seen[k]
                for j in range(count):
                    rest -= share[j] * lit[j, k]
                left += abs(rest) / weights[k]
                variance = no_flash_variance[y, x, k]
                own += variance
                mixed += variance
                for c in range(3):
                    through = zero
                    for j in range(count):
                        through += share[j] * matrices[j, k, c]
                    mixed += through * through * flash_variance[y, x, c]
                    if c == k and not flash_only:  # a difference lacks what noise adds to no_flash
                        mixed += two * through * variance
            found[0, at], found[1, at] = left, light[0] + light[1] + light[2]
            found[2, at], found[3, at] = own, mixed
            at += 1


@spliced
def _pixel(image: Image, y: int, x: int) -> Colour:
    return image[y, x, 0], image[y, x, 1], image[y, x, 2]


def _total(light: Floats32) -> Floats32:
    """Sum over channels of (n, 3); NumPy's takes ten times as long."""
    return np.asarray(light @ np.ones(3, np.float32))


def _deviation(data: Chromaticities) -> Floats64:
    return np.sqrt(data.variance / 2)
