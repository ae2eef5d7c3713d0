"""The mixture of pipeline.matrixfit.mixture, datum by datum."""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats64

_SHORT = 0.01  # of σ: edges shorter than this keep a fixed direction
_AREA_SCALE = 50.0
_TINY = 1e-300
_MIN_TOTAL = 0.02  # of the sum of a lamp's light of unit norm: beyond, chromaticity runs away
_ROOT_TAU = math.sqrt(2.0 * math.pi)


def _ndtr(z: float) -> float:
    return 0.5 * math.erfc(-z * 0.7071067811865476)


def plain_mixture(
    matrices: Floats64,
    x: Floats64,
    u: Floats64,
    whitener: Floats64,
    sigma: Floats64,
    worth: Floats64,
    weights: Floats64,
    extension: float,
    outlier: float,
    area_power: float,
    interior: bool,
    mirrored: Floats64,
) -> tuple[float, Floats64, Floats64]:
    """−Σ worth · log density of the mixture, its gradient (N, 3, 3), counts (K,).

    As pipeline.matrixfit.mixture.mixture, of data that `blocks` has not put into blocks yet: x, u,
    whitener, sigma and worth as it takes them.
    """
    lamps = matrices.shape[0]
    pairs = lamps * (lamps - 1) // 2
    gradient, counts = np.zeros_like(matrices), np.zeros_like(weights)
    value = 0.0
    own = np.empty((lamps, 3))  # chromaticity of what is mirrored, and its sum
    for j in range(lamps):
        light = matrices[j] @ mirrored
        t = float(light.sum())
        t = math.copysign(max(abs(t), _MIN_TOTAL), t)
        own[j] = light[0] / t, light[1] / t, t
    corner = np.empty((lamps, 2))
    plain = np.empty((lamps, 2))
    total = np.empty(lamps)
    by_corner = np.empty((lamps, 2))
    part = np.empty(weights.shape[0])
    side = np.empty(pairs)
    side_a = np.empty((pairs, 2))
    side_b = np.empty((pairs, 2))
    for i in range(x.shape[0]):
        s = sigma[i]
        for j in range(lamps):
            r = g = b = 0.0
            for k in range(3):
                r += matrices[j, 0, k] * x[i, k]
                g += matrices[j, 1, k] * x[i, k]
                b += matrices[j, 2, k] * x[i, k]
            t = r + g + b
            if abs(t) < _MIN_TOTAL:
                t = math.copysign(_MIN_TOTAL, t)
            total[j] = t
            plain[j, 0] = r / t
            plain[j, 1] = g / t
            for k in range(2):
                corner[j, k] = whitener[i, k, 0] * plain[j, 0] + whitener[i, k, 1] * plain[j, 1]
                by_corner[j, k] = 0.0
        mixed = weights[-1] * outlier
        part[-1] = mixed
        by_own = np.zeros((lamps, 2))
        if mirrored.any():
            for j in range(lamps):
                seen = whitener[i] @ own[j, :2]
                o0, o1 = (u[i] - seen) / s
                p = math.exp(-0.5 * (o0 * o0 + o1 * o1)) / (2.0 * math.pi * s * s)
                part[lamps + pairs + j] = weights[lamps + pairs + j] * p
                mixed += part[lamps + pairs + j]
                by_own[j] = part[lamps + pairs + j] * np.array([o0, o1]) / s
        for j in range(lamps):
            o0, o1 = (u[i, 0] - corner[j, 0]) / s, (u[i, 1] - corner[j, 1]) / s
            p = weights[j] * math.exp(-0.5 * (o0 * o0 + o1 * o1)) / (2.0 * math.pi * s * s)
            part[j] = p
            mixed += p
            by_corner[j, 0] += p * o0 / s
            by_corner[j, 1] += p * o1 / s
        e = 0
        for a in range(lamps):
            for c in range(a + 1, lamps):
                dx, dy = corner[c, 0] - corner[a, 0], corner[c, 1] - corner[a, 1]
                length = math.sqrt(dx * dx + dy * dy)
                if length < _SHORT * s:
                    e0, e1 = 1.0, 0.0
                    length = _SHORT * s
                else:
                    e0, e1 = dx / length, dy / length
                m0, m1 = e1, -e0
                f0, f1 = u[i, 0] - corner[a, 0], u[i, 1] - corner[a, 1]
                along, d = f0 * e0 + f1 * e1, f0 * m0 + f1 * m1
                low = (along + extension * length) / s
                high = (along - (1.0 + extension) * length) / s
                covered = max(_ndtr(low) - _ndtr(high), _TINY)
                at_low = math.exp(-0.5 * low * low) / _ROOT_TAU
                at_high = math.exp(-0.5 * high * high) / _ROOT_TAU
                across = math.exp(-0.5 * (d / s) ** 2) / (_ROOT_TAU * s)
                p = weights[lamps + e] * across * covered / ((1.0 + 2.0 * extension) * length)
                part[lamps + e] = p
                mixed += p
                side[e] = d
                ratio_d, ratio_t = d / length, along / length
                for k in range(2):
                    mk = m0 if k == 0 else m1
                    ek = e0 if k == 0 else e1
                    dt_b, dt_a = mk * ratio_d, -ek - mk * ratio_d
                    dd_b, dd_a = -mk * ratio_t, -mk * (1.0 - ratio_t)
                    side_a[e, k] = dd_a
                    side_b[e, k] = dd_b
                    stretch = ek / length
                    slope = (at_low - at_high) / s / covered
                    widen = (extension * at_low + (1.0 + extension) * at_high) / s / covered
                    by_corner[a, k] += p * (
                        slope * dt_a - widen * ek - d / (s * s) * dd_a + stretch
                    )
                    by_corner[c, k] += p * (
                        slope * dt_b + widen * ek - d / (s * s) * dd_b - stretch
                    )
                e += 1
        if interior:
            cross = (corner[1, 0] - corner[0, 0]) * (corner[2, 1] - corner[0, 1])
            cross -= (corner[1, 1] - corner[0, 1]) * (corner[2, 0] - corner[0, 0])
            turn = 1.0 if cross >= 0 else -1.0
            reach = abs(cross) / 2.0 + 2.0 * s * s
            p = weights[-2] * _AREA_SCALE * (_AREA_SCALE * reach) ** -area_power
            # d is negative to the left of an edge, where the inside lies when corners turn left
            for e in range(3):
                z = (turn if e == 1 else -turn) * side[e] / s
                p *= max(_ndtr(z), _TINY)
            part[-2] = p
            mixed += p
            for e in range(3):
                sign = turn if e == 1 else -turn
                z = sign * side[e] / s
                slope = math.exp(-0.5 * z * z) / _ROOT_TAU / max(_ndtr(z), _TINY) * sign / s
                a, c = (0, 1) if e == 0 else ((0, 2) if e == 1 else (1, 2))
                for k in range(2):
                    by_corner[a, k] += p * slope * side_a[e, k]
                    by_corner[c, k] += p * slope * side_b[e, k]
            factor = -area_power / reach * turn / 2.0 * p
            for j in range(3):
                q, r2 = (j + 1) % 3, (j + 2) % 3
                by_corner[j, 0] += factor * (corner[q, 1] - corner[r2, 1])
                by_corner[j, 1] += factor * (corner[r2, 0] - corner[q, 0])
        if mixed < _TINY:
            mixed = _TINY
        value -= worth[i] * math.log(mixed)
        scale = worth[i] / mixed
        for k in range(part.shape[0]):
            counts[k] += scale * part[k]
        for j in range(lamps):
            v0, v1 = whitener[i].T @ by_own[j] * scale
            drift = v0 * own[j, 0] + v1 * own[j, 1]
            gradient[j] -= np.outer([v0 - drift, v1 - drift, -drift], mirrored / own[j, 2])
            v0 = (whitener[i, 0, 0] * by_corner[j, 0] + whitener[i, 1, 0] * by_corner[j, 1]) * scale
            v1 = (whitener[i, 0, 1] * by_corner[j, 0] + whitener[i, 1, 1] * by_corner[j, 1]) * scale
            drift = v0 * plain[j, 0] + v1 * plain[j, 1]
            for k in range(3):
                step = x[i, k] / total[j]
                gradient[j, 0, k] -= (v0 - drift) * step
                gradient[j, 1, k] -= (v1 - drift) * step
                gradient[j, 2, k] += drift * step
    return value, gradient, counts
