"""The mixture of corners, edges, mirrors, interior and outliers, compiled: value, gradient, counts.

Data go through it in blocks of a fixed size, and each component through a block in a loop of its
own, simple enough to become vector code. What these loops read and write are rows of a block in
one array, at distances that the compiler knows.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.arrays import Floats64
from pipeline.compiling import compiled, exact, inlined, summing
from pipeline.matrixfit.elementary import exp, log, ndtr

_SHORT = 0.01  # of σ: edges shorter than this keep a fixed direction
_AREA_SCALE = 50.0
_TINY = 1e-300
_MIN_TOTAL = 0.02  # of the sum of a lamp's light of unit norm: beyond, chromaticity runs away
_PEAK = 1.0 / math.sqrt(2.0 * math.pi)  # of a normal density

_BLOCK = 128
# Rows of a block of data: colour; chromaticity and whitener in units of σ; 1/σ²; the factor of the
# interior's density that does not depend on lamps; worth.
_X0, _X1, _X2, _U0, _U1, _W00, _W01, _W10, _W11, _DENSITY, _EVEN, _WORTH, _DATA = range(
    0, 13 * _BLOCK, _BLOCK
)
# Of a lamp there: its part of the density, derivatives of the density by its corner, the corner
# itself, whitened and plain, and 1 / sum of its light.
_PART, _BY0, _BY1, _C0, _C1, _P0, _P1, _INVERSE, _LAMP = range(0, 9 * _BLOCK, _BLOCK)
# Of an edge, after its part: how far across and along it data are, the latter in its lengths;
# exp(−across²/2); its direction.
_ACROSS, _ALONG, _BELL, _E0, _E1, _EDGE = range(_BLOCK, 7 * _BLOCK, _BLOCK)


def blocks(
    x: Floats64,
    u: Floats64,
    whitener: Floats64,
    sigma: Floats64,
    worth: Floats64,
    area_power: float,
) -> Floats64:
    """Data as `mixture` takes them, the last block filled up with data worth nothing.

    Parameters
    ----------
    x : (n, 3) flash colours; u : (n, 2) whitened chromaticities; whitener : (n, 2, 2);
    sigma : (n,) isotropic deviations after whitening; worth : (n,) weights of the data
    area_power : exponent of the interior's density in its area
    """
    rows = [*x.T, *(u / sigma[:, None]).T, *(whitener.reshape(-1, 4) / sigma[:, None]).T]
    rows += [sigma**-2.0, _AREA_SCALE * (_AREA_SCALE * sigma**2) ** -area_power, worth]
    count = -(-len(x) // _BLOCK)
    full = np.zeros((len(rows), count * _BLOCK))
    full[:, : len(x)] = rows
    return full.reshape(len(rows), count, _BLOCK).transpose(1, 0, 2).reshape(count, _DATA)


@compiled
def _corner(data: Floats64, matrix: Floats64, weight: float, lamp: Floats64) -> None:
    """A lamp's corner and its density: normal about it."""
    share = weight * _PEAK * _PEAK
    m00, m01, m02 = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    m10, m11, m12 = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    m20, m21, m22 = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    for i in range(_BLOCK):
        x0, x1, x2 = data[_X0 + i], data[_X1 + i], data[_X2 + i]
        r = m00 * x0 + m01 * x1 + m02 * x2
        g = m10 * x0 + m11 * x1 + m12 * x2
        total = r + g + (m20 * x0 + m21 * x1 + m22 * x2)
        least = -_MIN_TOTAL if total < 0.0 else _MIN_TOTAL
        inverse = 1.0 / (least if abs(total) < _MIN_TOTAL else total)
        p0, p1 = r * inverse, g * inverse
        c0 = data[_W00 + i] * p0 + data[_W01 + i] * p1
        c1 = data[_W10 + i] * p0 + data[_W11 + i] * p1
        o0, o1 = data[_U0 + i] - c0, data[_U1 + i] - c1
        p = share * data[_DENSITY + i] * exp(-0.5 * (o0 * o0 + o1 * o1))
        lamp[_PART + i], lamp[_BY0 + i], lamp[_BY1 + i] = p, p * o0, p * o1
        lamp[_C0 + i], lamp[_C1 + i] = c0, c1
        lamp[_P0 + i], lamp[_P1 + i], lamp[_INVERSE + i] = p0, p1, inverse


@compiled
def _mirror(data: Floats64, red: float, green: float, weight: float, lamp: Floats64) -> None:
    """The density of light that is mirrored: normal about the lamp's own chromaticity."""
    share = weight * _PEAK * _PEAK
    for i in range(_BLOCK):
        o0 = data[_U0 + i] - (data[_W00 + i] * red + data[_W01 + i] * green)
        o1 = data[_U1 + i] - (data[_W10 + i] * red + data[_W11 + i] * green)
        p = share * data[_DENSITY + i] * exp(-0.5 * (o0 * o0 + o1 * o1))
        lamp[_PART + i], lamp[_BY0 + i], lamp[_BY1 + i] = p, p * o0, p * o1


@compiled
def _edge(
    data: Floats64,
    first: Floats64,
    second: Floats64,
    weight: float,
    extension: float,
    edge: Floats64,
) -> None:
    """An edge's density: normal across it, even along it with ends blurred alike."""
    share = weight * _PEAK / (1.0 + 2.0 * extension)
    for i in range(_BLOCK):
        c0, c1 = first[_C0 + i], first[_C1 + i]
        d0, d1 = second[_C0 + i] - c0, second[_C1 + i] - c1
        length = math.sqrt(d0 * d0 + d1 * d1)
        short = length < _SHORT
        length = _SHORT if short else length
        inverse = 1.0 / length
        e0, e1 = 1.0 if short else d0 * inverse, 0.0 if short else d1 * inverse
        f0, f1 = data[_U0 + i] - c0, data[_U1 + i] - c1
        along, across = f0 * e0 + f1 * e1, f0 * e1 - f1 * e0
        low, high = along + extension * length, along - (1.0 + extension) * length
        at_low, at_high = exp(-0.5 * low * low), exp(-0.5 * high * high)
        covered = ndtr(low, at_low) - ndtr(high, at_high)
        at_low, at_high = at_low * _PEAK, at_high * _PEAK
        bell = exp(-0.5 * across * across)
        most = share * data[_DENSITY + i] * bell * inverse
        p = most * (_TINY if covered < _TINY else covered)
        # derivatives along the edge and across it
        slope = most * (at_low - at_high)
        widen = most * (extension * at_low + (1.0 + extension) * at_high) - p * inverse
        turn = slope * across * inverse
        part = along * inverse
        shift = p * across
        first[_BY0 + i] += e1 * (shift * (1.0 - part) - turn) - e0 * (slope + widen)
        first[_BY1 + i] += -e0 * (shift * (1.0 - part) - turn) - e1 * (slope + widen)
        second[_BY0 + i] += e1 * (shift * part + turn) + e0 * widen
        second[_BY1 + i] += -e0 * (shift * part + turn) + e1 * widen
        edge[_PART + i], edge[_ACROSS + i], edge[_BELL + i] = p, across, bell
        edge[_ALONG + i], edge[_E0 + i], edge[_E1 + i] = part, e0, e1


@compiled
def _interior(
    data: Floats64,
    lamps: Floats64,
    edges: Floats64,
    weight: float,
    area_power: float,
    inside: Floats64,
) -> None:
    """The density of three lamps' triangle: even within it, blurred at its edges."""
    for i in range(_BLOCK):
        a, b, c = i, i + _LAMP, i + 2 * _LAMP
        ab, ac, bc = i, i + _EDGE, i + 2 * _EDGE
        a0, a1 = lamps[_C0 + a], lamps[_C1 + a]
        b0, b1 = lamps[_C0 + b], lamps[_C1 + b]
        c0, c1 = lamps[_C0 + c], lamps[_C1 + c]
        cross = (b0 - a0) * (c1 - a1) - (b1 - a1) * (c0 - a0)
        turn = 1.0 if cross >= 0.0 else -1.0
        reach = 0.5 * abs(cross) + 2.0
        even = weight * data[_EVEN + i] * exp(-area_power * log(reach))
        # to the left of an edge, where the inside lies when corners turn left, across is negative
        in_ab, at_ab = _side(edges[_ACROSS + ab], edges[_BELL + ab], -turn)
        in_ac, at_ac = _side(edges[_ACROSS + ac], edges[_BELL + ac], turn)
        in_bc, at_bc = _side(edges[_ACROSS + bc], edges[_BELL + bc], -turn)
        p = even * in_ab * in_ac * in_bc
        inside[i] = p
        ab_a, ab_b = _ends(even * in_ac * in_bc * at_ab, edges[_ALONG + ab])
        ac_a, ac_c = _ends(even * in_ab * in_bc * at_ac, edges[_ALONG + ac])
        bc_b, bc_c = _ends(even * in_ab * in_ac * at_bc, edges[_ALONG + bc])
        ab0, ab1 = edges[_E0 + ab], edges[_E1 + ab]
        ac0, ac1 = edges[_E0 + ac], edges[_E1 + ac]
        bc0, bc1 = edges[_E0 + bc], edges[_E1 + bc]
        widen = -0.5 * area_power / reach * turn * p
        lamps[_BY0 + a] += ab_a * ab1 + ac_a * ac1 + widen * (b1 - c1)
        lamps[_BY1 + a] += widen * (c0 - b0) - ab_a * ab0 - ac_a * ac0
        lamps[_BY0 + b] += ab_b * ab1 + bc_b * bc1 + widen * (c1 - a1)
        lamps[_BY1 + b] += widen * (a0 - c0) - ab_b * ab0 - bc_b * bc0
        lamps[_BY0 + c] += ac_c * ac1 + bc_c * bc1 + widen * (a1 - b1)
        lamps[_BY1 + c] += widen * (b0 - a0) - ac_c * ac0 - bc_c * bc0


@inlined
def _side(across: float, bell: float, sign: float) -> tuple[float, float]:
    """How much of the blurred side of an edge is at a distance, and its derivative by that."""
    covered = ndtr(sign * across, bell)
    return _TINY if covered < _TINY else covered, sign * bell * _PEAK


@inlined
def _ends(slope: float, along: float) -> tuple[float, float]:
    """What moving each end of an edge across it does at a place along it."""
    return slope * (along - 1.0), -slope * along


@compiled
def _add(part: Floats64, mixed: Floats64) -> None:
    for i in range(_BLOCK):
        mixed[i] += part[i]


@summing
def _settle(data: Floats64, mixed: Floats64) -> float:
    """−Σ worth · log of the mixed density, which becomes worth ÷ density."""
    value = 0.0
    for i in range(_BLOCK):
        density = _TINY if mixed[i] < _TINY else mixed[i]
        value -= data[_WORTH + i] * log(density)
        mixed[i] = data[_WORTH + i] / density
    return value


@summing
def _dot(part: Floats64, scale: Floats64) -> float:
    total = 0.0
    for i in range(_BLOCK):
        total += part[i] * scale[i]
    return total


@summing
def _pull(data: Floats64, lamp: Floats64, scale: Floats64, gradient: Floats64) -> None:
    """Add the gradient in a lamp's matrix."""
    g00 = g01 = g02 = g10 = g11 = g12 = g20 = g21 = g22 = 0.0
    for i in range(_BLOCK):
        by0, by1 = lamp[_BY0 + i], lamp[_BY1 + i]
        step = scale[i] * lamp[_INVERSE + i]
        v0 = (data[_W00 + i] * by0 + data[_W10 + i] * by1) * step
        v1 = (data[_W01 + i] * by0 + data[_W11 + i] * by1) * step
        drift = v0 * lamp[_P0 + i] + v1 * lamp[_P1 + i]
        v0, v1 = v0 - drift, v1 - drift
        x0, x1, x2 = data[_X0 + i], data[_X1 + i], data[_X2 + i]
        g00, g01, g02 = g00 + v0 * x0, g01 + v0 * x1, g02 + v0 * x2
        g10, g11, g12 = g10 + v1 * x0, g11 + v1 * x1, g12 + v1 * x2
        g20, g21, g22 = g20 + drift * x0, g21 + drift * x1, g22 + drift * x2
    gradient[0, 0] -= g00
    gradient[0, 1] -= g01
    gradient[0, 2] -= g02
    gradient[1, 0] -= g10
    gradient[1, 1] -= g11
    gradient[1, 2] -= g12
    gradient[2, 0] += g20
    gradient[2, 1] += g21
    gradient[2, 2] += g22


@summing
def _pull_of_mirror(data: Floats64, lamp: Floats64, scale: Floats64) -> tuple[float, float]:
    """How a lamp's own chromaticity is pulled."""
    red = green = 0.0
    for i in range(_BLOCK):
        by0, by1 = lamp[_BY0 + i], lamp[_BY1 + i]
        red += (data[_W00 + i] * by0 + data[_W10 + i] * by1) * scale[i]
        green += (data[_W01 + i] * by0 + data[_W11 + i] * by1) * scale[i]
    return red, green


@exact
def _pull_own(
    data: Floats64,
    mirror: Floats64,
    scale: Floats64,
    own: Floats64,
    mirrored: Floats64,
    gradient: Floats64,
) -> None:
    """Add a mirror's gradient by its lamp's matrix; own, mirrored: as in _write_own."""
    red, green = _pull_of_mirror(data, mirror, scale)
    red, green = red * own[2], green * own[2]
    drift = red * own[0] + green * own[1]
    gradient[0] -= (red - drift) * mirrored
    gradient[1] -= (green - drift) * mirrored
    gradient[2] += drift * mirrored


@exact
def _write_own(matrices: Floats64, mirrored: Floats64, own: Floats64) -> None:
    """Write of each lamp (N, 3): red and green of its own chromaticity, and 1 / sum of its light.

    mirrored: as in mixture.
    """
    for j in range(matrices.shape[0]):
        # not as a product of matrices, for which Numba loads SciPy's BLAS
        columns = matrices[j, :, 0], matrices[j, :, 1], matrices[j, :, 2]
        light = columns[0] * mirrored[0] + columns[1] * mirrored[1] + columns[2] * mirrored[2]
        total = light.sum()
        least = -_MIN_TOTAL if total < 0.0 else _MIN_TOTAL
        total = least if abs(total) < _MIN_TOTAL else total
        own[j, 0], own[j, 1], own[j, 2] = light[0] / total, light[1] / total, 1.0 / total


@exact
def mixture(
    matrices: Floats64,
    data: Floats64,
    weights: Floats64,
    extension: float,
    outlier: float,
    area_power: float,
    interior: bool,
    mirrored: Floats64,
) -> tuple[float, Floats64, Floats64]:
    """−Σ worth · log density of the mixture, its gradient (N, 3, 3), counts (K,).

    Parameters
    ----------
    matrices : (N, 3, 3) T_j
    data : blocks
    weights : (K,) of the components: N corners, the edges 01, 02, 12, N mirrors, the interior,
        outliers
    extension : how far edges reach beyond their ends, in lengths; outlier : their density
    area_power : exponent of the interior's density in its area, that of the blocks
    interior : whether there is one (three lamps)
    mirrored : (3,) chromaticity of the flash, summing to 1, on what mirrors light, which has no
        colour of its own; zeros where there are no mirrors

    The counts are Σ worth · responsibility.
    """
    count = matrices.shape[0]
    gradient, counts = np.zeros_like(matrices), np.zeros_like(weights)
    lamps = np.empty((count, _LAMP))
    edges = np.empty((count * (count - 1) // 2, _EDGE))
    inside, scale = np.empty(_BLOCK), np.empty(_BLOCK)
    mirrors, own = np.empty((count, _LAMP)), np.empty((count, 3))
    has_mirrors = mirrored[0] > 0.0
    _write_own(matrices, mirrored, own)
    value = 0.0
    for k in range(data.shape[0]):
        block = data[k]
        scale[:] = weights[-1] * outlier
        for j in range(count):
            _corner(block, matrices[j], weights[j], lamps[j])
            _add(lamps[j], scale)
        e = 0
        for a in range(count):
            for c in range(a + 1, count):
                _edge(block, lamps[a], lamps[c], weights[count + e], extension, edges[e])
                _add(edges[e], scale)
                e += 1
        if has_mirrors:
            for j in range(count):
                _mirror(block, own[j, 0], own[j, 1], weights[count + e + j], mirrors[j])
                _add(mirrors[j], scale)
        if interior:
            _interior(block, lamps.ravel(), edges.ravel(), weights[-2], area_power, inside)
            _add(inside, scale)
        value += _settle(block, scale)
        for j in range(count):
            counts[j] += _dot(lamps[j], scale)
            _pull(block, lamps[j], scale, gradient[j])
        for pair in range(edges.shape[0]):
            counts[count + pair] += _dot(edges[pair], scale)
        if has_mirrors:
            for j in range(count):
                counts[count + e + j] += _dot(mirrors[j], scale)
                _pull_own(block, mirrors[j], scale, own[j], mirrored, gradient[j])
        if interior:
            counts[-2] += _dot(inside, scale)
        counts[-1] += weights[-1] * outlier * scale.sum()
    return value, gradient, counts
