"""Three channels from the mosaic of a Bayer sensor, by ratios of colours; compiled.

Sources: Hamilton and Adams 1997 (US 5,629,734) for what a row or a column says of the missing
colour; Pekkucuksen and Altunbasak, "Gradient based threshold free color filter array
interpolation", 2010, for weighing both instead of choosing; Pekkucuksen and Altunbasak,
"Multiscale gradients-based color filter array interpolation", 2013, for the diagonal neighbours.
Here ratios of channels stand for their differences: a pattern on a surface does not change them,
nor does the balance of the channels, so that the two photographs of a pair keep theirs.
"""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats32
from pipeline.compiling import compiled, inlined
from pipeline.images.coded_image import LevelImage
from pipeline.images.frames import Numbers, Plane, numbers_of
from pipeline.images.memory import empty_codes
from pipeline.images.strips import widened

Values = NDArray[np.uint16]

_MOST = 65535.0  # of the code values that come out

_OFFSET = 0.003  # of white, added before ratios are taken: below it noise would bend them
_LEAST = 0.2  # of the offset, for values below black
_HALO = 10  # photosites that a pixel depends on are up to 9 away; even, so that tiles begin alike
_TILE = 256  # rows and columns that stay in the processor's cache
_PLANES = 6
_ALIKE = 1e-4  # squared sums of gradients, below which rows and columns count the same
_NEAR, _FAR = 10 / 32, -1 / 32  # weights of diagonal neighbours

_ROUNDER = 1.5 * 2.0**23  # x + this has round(x) in its lowest bits
_ROOT_HALF = np.float32(math.sqrt(0.5)).view(np.int32)
_EXP2 = tuple(math.log(2.0) ** k / math.factorial(k) for k in range(7))
_LOG2 = tuple(2.0 / ((2 * k + 1) * math.log(2.0)) for k in range(5))


def is_bayer(colours: NDArray[np.integer]) -> bool:
    """Whether channels of 2 × 2 photosites are a red, a blue and two greens on a diagonal."""
    if colours.shape != (2, 2) or sorted(np.ravel(colours)) != [0, 1, 1, 2]:
        return False
    return bool((colours[0, 0] == 1) == (colours[1, 1] == 1))


def demosaic(
    mosaic: Values, colours: NDArray[np.integer], black: Floats, white: float
) -> LevelImage:
    """Give every photosite its three channels: (H, W, 3), 0 = black, 1 = white.

    What the sensor measured stays as it is, below black, too; nothing is above white. What it did
    not is rounded to 16 bits. The result is the same for a picture that is turned, and close to it
    for channels of another balance.

    Parameters
    ----------
    mosaic : (H, W), what the sensor measured, at least 2 × 2
    colours : (2, 2), channel (0, 1, 2) of the upper left photosites, green on a diagonal
    black : (2, 2), what these measure without light
    white : what is measured between the least of black and the white level

    Raises ValueError for a smaller mosaic and for colours that are no Bayer pattern.
    """
    if mosaic.ndim != 2 or min(mosaic.shape) < 2:
        raise ValueError(f"{mosaic.shape} photosites are no mosaic")
    if not is_bayer(colours):
        raise ValueError(f"{colours.tolist()} is no Bayer pattern")
    height, width = mosaic.shape
    out = empty_codes((height, width, 3), np.uint16)
    scratch = np.empty(_PLANES * (_TILE + 2 * _HALO) ** 2, np.float32)
    first, second, third, fourth = (int(channel) for channel in np.ravel(colours))
    channels = (first, second, third, fourth)
    levels = numbers_of(np.asarray(black, np.float64))
    per_unit, zero = _scale(max(levels), white)
    codes = white * per_unit, zero
    for top in range(0, height, _TILE):
        rows = slice(top, min(top + _TILE, height))
        for left in range(0, width, _TILE):
            columns = slice(left, min(left + _TILE, width))
            window = _window(mosaic, rows, columns)
            _demosaic(window, channels, levels, 1.0 / white, scratch, codes, out, top, left)
    return LevelImage(out, zero, 1.0 / codes[0])


def _scale(black: float, white: float) -> tuple[float, float]:
    """How many code values what is measured takes to rise by 1, and which one is without light.

    black: most that is measured without light. white: as in demosaic.
    """
    below = max(black, _OFFSET * white)  # what is found goes below black as far as the offset
    per_unit = (_MOST - 1) / (white + below)
    if per_unit > 1:
        per_unit = 2.0 ** math.floor(math.log2(per_unit))  # whole values stay whole
    return per_unit, float(math.ceil(per_unit * below))


def _window(mosaic: Values, rows: slice, columns: slice) -> Values:
    """Photosites of a tile with _HALO more on all sides, mirrored at the border of the picture."""
    (y, inner_y), (x, inner_x) = (
        widened(part, _HALO, size) for part, size in zip((rows, columns), mosaic.shape, strict=True)
    )
    window = cv2.copyMakeBorder(
        np.ascontiguousarray(mosaic[y, x]),
        _HALO - inner_y.start,
        _HALO - (y.stop - rows.stop),
        _HALO - inner_x.start,
        _HALO - (x.stop - columns.stop),
        cv2.BORDER_REFLECT_101,
    )
    return np.asarray(window, np.uint16)


@inlined
def _exp2(x: Any) -> Any:
    """2^x to some parts in 10⁷, where that is neither denormal nor infinite."""
    shifted = np.float32(x + np.float32(_ROUNDER))
    r = np.float32(x - np.float32(shifted - np.float32(_ROUNDER)))
    power = np.int32((shifted.view(np.int32) + np.int32(127)) << np.int32(23)).view(np.float32)
    total = np.float32(_EXP2[6])
    for k in range(5, -1, -1):
        total = total * r + np.float32(_EXP2[k])
    return total * power


@inlined
def _log2(x: Any) -> Any:
    """log2 x of a positive number to some parts in 10⁷."""
    bits = np.float32(x).view(np.int32)
    e = np.int32((bits - np.int32(_ROOT_HALF)) >> np.int32(23))
    m = np.int32(bits - np.int32(e << np.int32(23))).view(np.float32)  # √½ … √2
    f = np.float32((m - np.float32(1.0)) / (m + np.float32(1.0)))
    square = np.float32(f * f)
    total = np.float32(_LOG2[4])
    for k in range(3, -1, -1):
        total = total * square + np.float32(_LOG2[k])
    return np.float32(e) + f * total


@compiled
def _demosaic(
    window: Values,
    colours: tuple[int, int, int, int],
    black: Numbers,
    scale: float,
    scratch: Floats32,
    codes: tuple[float, float],
    out: Values,
    top: int,
    left: int,
) -> None:
    """Write a tile (h, w) of out (H, W, 3) from window (h + 2·_HALO, w + 2·_HALO).

    colours, black: of the four upper left photosites. scratch: room for _PLANES planes. codes: how
    many code values light of 1 takes, and which one is without light. Parts are cut out here: cut
    out before, they would be of several types, each to be compiled.
    What comes out at photosites of the other kind is left unused: loops without branches become
    vector instructions, and so do those that look to the left in a part that begins there. Of an
    index less a number the compiler does not know that it counts from the front.
    """
    height, width = window.shape
    planes = scratch[: _PLANES * height * width].reshape((_PLANES, height, width))
    light, across, down = planes[0], planes[1], planes[2]
    share, steep, fall = planes[3], planes[4], planes[5]
    _write_light(window, black, scale, light)
    _write_ratios(light, across, down)
    _write_gradients(across, down, steep, fall)
    _write_share(steep, fall, share)
    green, diagonal = steep, fall  # their memory, once they have been weighed
    _write_green(across, down, share, green)
    _write_diagonal(green, diagonal)
    tile = out[top : top + height - 2 * _HALO, left : left + width - 2 * _HALO]
    _write_channels(light, share, green, diagonal, colours, codes, tile)


@compiled
def _write_light(window: Values, black: Numbers, scale: float, light: Plane) -> None:
    """Write the light of every photosite, at most 1."""
    unit, one = np.float32(scale), np.float32(1.0)
    height, width = window.shape
    level = np.empty(width, np.float32)
    for y in range(height):
        first = 2 * (y & 1)
        level[0::2], level[1::2] = np.float32(black[first]), np.float32(black[first + 1])
        values, written = window[y], light[y]
        for x in range(width):
            written[x] = min((np.float32(values[x]) - level[x]) * unit, one)


@compiled
def _write_ratios(light: Plane, across: Plane, down: Plane) -> None:
    """Write log2 of the other colour over the photosite's own, as its row and its column say.

    The mean of two neighbours over that of the photosite and the two beyond, 1 2 1.
    """
    half, quarter, offset = np.float32(0.5), np.float32(0.25), np.float32(_OFFSET)
    least = np.float32(_OFFSET * _LEAST)
    height, width = light.shape
    rows = np.empty((5, width), np.float32)
    for y in range(2, height - 2):
        for k in range(5):
            values, raised = light[y + k - 2], rows[k]
            for x in range(width):
                raised[x] = max(values[x] + offset, least)
        r0, r1, r2, r3, r4 = rows[0], rows[1], rows[2], rows[3], rows[4]
        written = down[y]
        for x in range(width):
            own = half * r2[x] + quarter * (r0[x] + r4[x])
            written[x] = _log2(half * (r1[x] + r3[x]) / own)
        written = across[y]
        for x in range(2, width - 2):
            own = half * r2[x] + quarter * (r2[x - 2] + r2[x + 2])
            written[x] = _log2(half * (r2[x - 1] + r2[x + 1]) / own)


@compiled
def _write_gradients(across: Plane, down: Plane, steep: Plane, fall: Plane) -> None:
    """Write how much the ratios change along rows and along columns."""
    height, width = across.shape
    inner = slice(3, width - 3)
    for y in range(3, height - 3):
        before, after = across[y, 2 : width - 4], across[y, 4 : width - 2]
        above, below = down[y - 1, inner], down[y + 1, inner]
        first, second = steep[y, inner], fall[y, inner]
        for x in range(len(first)):
            first[x] = abs(after[x] - before[x])
            second[x] = abs(below[x] - above[x])


@compiled
def _write_share(steep: Plane, fall: Plane, share: Plane) -> None:
    """Write how much the row counts, 0…1: the less its ratios change in 5 × 5 photosites."""
    alike = np.float32(_ALIKE)
    height, width = share.shape
    first, second = np.empty(width, np.float32), np.empty(width, np.float32)
    for y in range(5, height - 5):
        for plane, summed in ((steep, first), (fall, second)):
            r0, r1, r2, r3, r4 = plane[y - 2], plane[y - 1], plane[y], plane[y + 1], plane[y + 2]
            for x in range(3, width - 3):
                summed[x] = (r0[x] + r4[x]) + (r1[x] + r3[x]) + r2[x]
        written = share[y]
        for x in range(5, width - 5):
            a = (first[x - 2] + first[x + 2]) + (first[x - 1] + first[x + 1]) + first[x]
            b = (second[x - 2] + second[x + 2]) + (second[x - 1] + second[x + 1]) + second[x]
            a, b = a * a + alike, b * b + alike
            written[x] = b / (a + b)


@compiled
def _write_green(across: Plane, down: Plane, share: Plane, green: Plane) -> None:
    """Write log2 of green over the colour of red and blue photosites.

    Their neighbours' ratios are the other way round, and so count against theirs.
    """
    quarter = np.float32(0.25)
    height, width = share.shape
    inner = slice(5, width - 5)
    for y in range(5, height - 5):
        before, row, after = across[y, 4 : width - 6], across[y, inner], across[y, 6 : width - 4]
        above, here, below = down[y - 1, inner], down[y, inner], down[y + 1, inner]
        part, written = share[y, inner], green[y, inner]
        for x in range(len(written)):
            of_row = row[x] + row[x] - before[x] - after[x]
            of_column = here[x] + here[x] - above[x] - below[x]
            written[x] = quarter * (of_column + part[x] * (of_row - of_column))


@compiled
def _write_diagonal(green: Plane, diagonal: Plane) -> None:
    """Write log2 of green over the colour that red and blue photosites lack."""
    near, far = np.float32(_NEAR), np.float32(_FAR)
    height, width = green.shape
    for y in range(8, height - 8):
        r0, r1 = green[y - 3, 5 : width - 5], green[y - 1, 5 : width - 5]
        r2, r3 = green[y + 1, 5 : width - 5], green[y + 3, 5 : width - 5]
        written = diagonal[y, 8 : width - 8]
        for x in range(len(written)):
            around = (r1[x + 2] + r1[x + 4]) + (r2[x + 2] + r2[x + 4])
            beyond = (r0[x + 2] + r0[x + 4]) + (r3[x + 2] + r3[x + 4])
            beside = (r1[x] + r1[x + 6]) + (r2[x] + r2[x + 6])
            written[x] = near * around + far * (beyond + beside)


@compiled
def _write_channels(
    light: Plane,
    share: Plane,
    green: Plane,
    diagonal: Plane,
    colours: tuple[int, int, int, int],
    codes: tuple[float, float],
    out: Values,
) -> None:
    """Write what was measured and, from ratios to it, what was not.

    At green photosites, both other colours come from the neighbours, rows and columns as they
    count there.
    """
    half, offset = np.float32(0.5), np.float32(_OFFSET)
    least = np.float32(_OFFSET * _LEAST)
    height, width, _ = out.shape
    is_green = np.empty(width, np.bool_)
    own, middle, other = np.empty((3, width), np.uint16)
    for row in range(height):
        y, first = row + _HALO, 2 * (row & 1)
        phase = 0 if colours[first] == 1 else 1
        for x in range(width):
            is_green[x] = (x & 1) == phase
        channel = colours[first + 1 - phase]
        measured, part = light[y, _HALO:], share[y, _HALO:]
        g, g0, g1 = green[y, _HALO - 1 :], green[y - 1, _HALO:], green[y + 1, _HALO:]
        d, d0, d1 = diagonal[y, _HALO - 1 :], diagonal[y - 1, _HALO:], diagonal[y + 1, _HALO:]
        for x in range(width):
            value = max(measured[x] + offset, least)
            of_row, of_column = half * (g[x] + g[x + 2]), half * (d0[x] + d1[x])
            to_own = of_column + part[x] * (of_row - of_column)
            of_row, of_column = half * (d[x] + d[x + 2]), half * (g0[x] + g1[x])
            to_other = of_column + part[x] * (of_row - of_column)
            if is_green[x]:
                raised, lowered = -to_own, -to_other
            else:
                raised, lowered = g[x + 1], g[x + 1] - d[x + 1]
            found = value * _exp2(raised) - offset
            other[x] = _code(value * _exp2(lowered) - offset, codes)
            own[x] = _code(found if is_green[x] else measured[x], codes)
            middle[x] = _code(measured[x] if is_green[x] else found, codes)
        for x in range(width):
            out[row, x, channel], out[row, x, 1], out[row, x, 2 - channel] = (
                own[x],
                middle[x],
                other[x],
            )


@inlined
def _code(light: Any, codes: tuple[float, float]) -> Any:
    """Code value of light, at most that of white."""
    code = min(light, np.float32(1.0)) * np.float32(codes[0]) + np.float32(codes[1])
    return np.uint16(np.int32(np.rint(code)))
