"""Bands that a lamp leaves which flickers with the mains, read out by the sensor row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.pair.ratios import Ratios

_FROM_CYCLES, _MOST_CYCLES = 4, 60  # to the height of the picture
_ROWS_KNOWN = 0.5  # share of the rows, at least
_LINE = 2  # cycles on either side that a wave leaks to
_BAND_HEIGHT = 0.02  # of the light, at least
_STANDS_OUT = 3.5  # times all other waves, and those across the rows
_IN_FLASH = 0.15  # of bands' height in the ratio, at least, is in the flash's own light
_FLASH_KNOWN = 5.0  # standard deviations of a ratio that the flash adds
_TOGETHER = 0.25  # of the mean wave must be in every channel


def bands(ratios: Ratios) -> float | None:
    """Height of periodic bands along the rows, relative to the light; None where there are none.

    ratios: their rows those of the sensor. A lamp that flickers with the mains, read out row by
    row, leaves them in the ratio of two photographs, in all channels at once, and in their
    difference; stripes of a surface differ in colour, and those of light behind a blind are not in
    what the flash added. Fewer than five to the picture cannot be told from the fall-off of the
    flash.
    """
    logs = np.where(ratios.usable[..., None], ratios.logs, np.nan)
    rows, columns = (_waves(planes) for planes in (logs, logs.transpose(1, 0, 2)))
    if rows is None:
        return None
    heights = np.abs(rows.mean(axis=1))
    strongest = int(np.argmax(heights))
    near = slice(max(strongest - _LINE, 0), strongest + _LINE + 1)
    beside = [0, *range(near.start, min(near.stop, len(heights)))]  # 0 may be the fall-off's
    others = np.delete(heights, beside).max(initial=0.0)
    across = 0.0 if columns is None else np.abs(columns[near].mean(axis=1)).max(initial=0.0)
    height = float(heights[strongest])
    if strongest == 0 or height < max(_BAND_HEIGHT, _STANDS_OUT * others, _STANDS_OUT * across):
        return None
    together = (rows[strongest] / rows[strongest].mean()).real.min()
    if together < _TOGETHER or _of_steady_light(ratios, strongest, height):
        return None
    return height


def _of_steady_light(ratios: Ratios, line: int, height: float) -> bool:
    """Whether the flash's own light lacks the wave: then the lamps' is the same in both."""
    more = np.expm1(ratios.logs)
    known = ratios.usable & (more > _FLASH_KNOWN * ratios.noise).all(axis=2)
    rows = _waves(np.log(np.where(known[..., None], more * ratios.no_flash, np.nan)))
    if rows is None:
        return False
    # of lamps that flicker, what the ratio holds is lessened by the flash, and this by the lamps
    in_both = np.abs(rows[line].mean()) * np.median(more[known] / (1 + more[known]))
    return bool(in_both < _IN_FLASH * height)


def _waves(planes: Floats64) -> NDArray[np.complex128] | None:
    """Waves down the rows (n, 3), from 4 to 60 cycles, of what neighbouring rows differ in.

    Differences of rows are taken in each column before the median over columns, so that neither
    surfaces nor the fall-off of light count, and are summed again.
    """
    height, width = planes.shape[:2]
    if height < 4 * _FROM_CYCLES:
        return None
    steps = np.diff(planes, axis=0)
    enough = np.isfinite(steps[..., 0]).sum(axis=1) >= max(8, width // 10)
    if enough.mean() < _ROWS_KNOWN:
        return None
    medians = np.zeros((height, 3))
    medians[1:][enough] = np.nanmedian(steps[enough], axis=1)
    profiles = np.cumsum(medians, axis=0)
    y = np.linspace(-1, 1, height)
    powers = np.vander(y, 4)
    profiles -= powers @ np.linalg.lstsq(powers, profiles, rcond=None)[0]
    window = np.hanning(height)[:, None]
    waves = np.fft.rfft(profiles * window, axis=0) * 2 / window.sum()
    return np.asarray(waves[_FROM_CYCLES : min(_MOST_CYCLES, height // 4) + 1])
