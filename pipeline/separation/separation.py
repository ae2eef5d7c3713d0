"""From the pair and its lamps to the light of each lamp, a strip of rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import exact, spliced
from pipeline.hui2018.separation import published_layers
from pipeline.images.area_means import area_means
from pipeline.images.frames import (
    Colour,
    Image,
    Numbers,
    Plane,
    Planes,
    channels_first,
    numbers_of,
    planes_of,
    rows_by_planes,
    write_planes,
)
from pipeline.images.sigma_filter import ROUNDS, SigmaFilter
from pipeline.images.strips import widened
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import Options, Quality
from pipeline.pair import misregistration, placing
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair
from pipeline.progress import Progress
from pipeline.separation import smoothing
from pipeline.separation.changed_lamps import lit_by_flash
from pipeline.separation.fill import Surroundings
from pipeline.separation.find_highlights import find_highlights
from pipeline.separation.proportions import model_proportions
from pipeline.threads import ahead

_ROUNDS: dict[Quality, int] = {"best": ROUNDS, "balanced": 3, "fast": 2}  # of the noise filter
_UNUSABLE_REACH = 1  # pixels around unusable ones that demosaicing has mixed with them
_INVISIBLE = 0.002  # standard deviation of a proportion that is not worth averaging
_DOUBT = 1.5  # standard deviations of a pixel's light at which it counts for a little less


@dataclass(frozen=True)
class Strip:
    """Some rows of the separated pair.

    rows: which. layers: float32 (N, h, W, 3), each lamp's light, linear camera RGB, 1.0 = white
    level of the no-flash photograph. no_flash, flash: (h, W, 3), the no-flash photograph and the
    flash part, for `best` with their noise filtered. confidence: (h, W) 0…1, 0 where the layers
    are filled in from the surroundings. `best` lays all of them in memory by planes.
    """

    rows: slice
    layers: Floats32
    no_flash: Image
    flash: Image
    confidence: Floats32


def separate(
    pair: Pair,
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    options: Options,
    progress: Progress,
    strip_rows: int,
) -> Iterator[Strip]:
    """Separate the pair, top to bottom.

    The method "paper" gives eq. 3 of Hui et al. 2018 as it is. "best" takes shares by non-negative
    least squares in the image, on the pair with its noise filtered, and deals the unfiltered
    photograph out in the proportions of the model's layers, highlights in those of what is
    mirrored: the layers add up to the photograph and its noise is not amplified. Pixels without a
    usable flash part take the proportions of their surroundings. The quality says how widely noise
    is averaged. The result does not depend on strip_rows.
    """
    height, width = pair.unusable.shape
    strips = progress.strips("layers", height, strip_rows)
    if options.method == "paper":
        yield from _published(pair, lamps, model, strips)
        return
    surroundings = Surroundings(reduced, lamps)
    highlights = find_highlights(reduced, lamps, model.flash_white)
    as_bright = _as_bright(reduced) if pair.flash_only else None
    for rows, wide, inner, (no_flash, flash) in ahead(_filtered(pair, options.quality, strips)):
        if not pair.flash_only:
            flash = flash - no_flash
        photograph = rows_by_planes(pair.no_flash, wide)
        confidence, placed, uncertainty = _reliability(pair, wide, photograph, lamps.least_sine)
        if pair.registration_px > 0:
            flash = placing.place_flash(no_flash, flash, placed, confidence)
        flash = lit_by_flash(no_flash, flash, lamps)
        proportions = model_proportions(no_flash, flash, lamps)
        in_guide = flash if as_bright is None else flash * as_bright
        smooth = smoothing.smooth_proportions(
            proportions, no_flash, in_guide, confidence * placed, uncertainty, inner
        )
        trust = confidence[inner]
        if pair.registration_px > 0:
            smooth, trust = placing.mend_proportions(
                smooth,
                proportions,
                photograph,
                pair.no_flash_noise,
                placed,
                confidence,
                inner,
            )
        no_flash, flash, confidence = no_flash[inner], flash[inner], confidence[inner]
        if highlights:
            smooth = highlights.deal_out(rows, no_flash, flash, lamps, smooth)
        layers = surroundings.rows(rows, width)
        as_sharp = pair.photograph is pair.no_flash
        _deal_out(
            planes_of(photograph[inner] if as_sharp else rows_by_planes(pair.photograph, rows)),
            trust,
            channels_first(smooth),
            channels_first(layers),
        )
        yield Strip(rows, layers, no_flash, flash, confidence)


def _as_bright(reduced: ReducedPair) -> np.float32:
    """By what to multiply a flash part in any units, so that it is as bright as the lamps."""
    light, part = (one[reduced.usable].sum(axis=1) for one in (reduced.no_flash, reduced.flash))
    return np.float32(np.median(light / part)) if len(part) else np.float32(1.0)


def _published(pair: Pair, lamps: Lamps, model: Model, strips: Iterator[slice]) -> Iterator[Strip]:
    """Separate by eq. 3, without filters."""
    for rows in strips:
        no_flash = pair.no_flash[rows]
        flash = pair.flash[rows] - (0 if pair.flash_only else no_flash)
        layers = published_layers(
            no_flash, flash, lamps.coefficients, model.tensor, model.published
        )
        yield Strip(rows, layers, no_flash, flash, _open(pair, rows))


def separate_reduced(pair: Pair, reduced: ReducedPair, lamps: Lamps) -> Strip:
    """Separate the blocks of a reduced pair roughly, all of them at once.

    What cannot be separated takes the proportions of its surroundings, and the light of the
    photograph, clipped as it may be.
    """
    height, width = reduced.usable.shape
    crop = width * reduced.block, height * reduced.block
    light = area_means(pair.photograph, (width, height), crop)
    layers = Surroundings(reduced, lamps).blocks() * light
    confidence = reduced.usable.astype(np.float32)
    return Strip(slice(0, height), layers, light, reduced.flash, confidence)


def _filtered(
    pair: Pair, quality: Quality, strips: Iterator[slice]
) -> Iterator[tuple[slice, slice, slice, tuple[Image, Image]]]:
    """Filter the noise of a pair strip by strip; of one that was aligned, softened at first.

    Yields four things for each strip: its rows; the same with a halo that smoothing and placing
    look at; where the strip's rows lie among the wider ones; and of the wider ones the no-flash and
    the flash photograph, (h, W, 3).
    """
    height, width = pair.unusable.shape
    halo = smoothing.HALO + (placing.HALO if pair.registration_px > 0 else 0)

    def read(rows: slice, planes: Floats32) -> None:
        for photograph, part in ((pair.no_flash, planes[:3]), (pair.flash, planes[3:])):
            if pair.registration_px > 0:
                wide, inner = widened(rows, misregistration.SOFTENED_HALO, height)
                write_planes(misregistration.softened(photograph[wide]), inner, part)
            else:
                write_planes(photograph, rows, part)

    noises = pair.no_flash_noise, pair.flash_noise
    noise_filter = SigmaFilter(read, (width, height), noises, _ROUNDS[quality])
    for rows in strips:
        wide, inner = widened(rows, halo, height)
        no_flash, flash, _ = noise_filter.rows(wide)
        yield rows, wide, inner, (no_flash, flash)


def _open(pair: Pair, rows: slice) -> Floats32:
    """1 in usable pixels, 0 in unusable ones and beside them, where demosaicing mixes."""
    wide, inner = widened(rows, _UNUSABLE_REACH, len(pair.unusable))
    kernel = np.ones((2 * _UNUSABLE_REACH + 1, 2 * _UNUSABLE_REACH + 1), dtype=np.uint8)
    near = cv2.dilate(pair.unusable[wide].astype(np.uint8), kernel)
    return np.asarray(1.0 - near[inner], dtype=np.float32)


def _reliability(
    pair: Pair, rows: slice, photograph: Image, least_sine: float
) -> tuple[Floats32, Floats32, Floats32]:
    """Confidence, placement and uncertainty (h, W), each 0…1; photograph: rows of the no-flash one.

    Confidence is how far flash part and no-flash light stand out from their noise, 0 in unusable
    pixels. Placement is less where the flash part is not quite from the same place, as beside
    edges. Uncertainty is what both may do to proportions.
    """
    confidence = _open(pair, rows)
    placed, uncertainty = np.ones_like(confidence), np.empty_like(confidence)
    beside = np.zeros_like(confidence)
    if pair.registration_px > 0:
        wide, inner = widened(rows, misregistration.HALO, len(pair.unusable))
        variance = misregistration.registration_variance(pair.flash[wide], pair.registration_px)
        beside = variance[inner].sum(axis=2)
        part = pair.flash[rows].sum(axis=2)
        if not pair.flash_only:
            part -= photograph.sum(axis=2)
        placed = placing.placement(part, beside)
    _weigh_noise(
        planes_of(photograph),
        planes_of(rows_by_planes(pair.flash, rows)),
        beside,
        (numbers_of(pair.no_flash_noise.gain), numbers_of(pair.no_flash_noise.floor)),
        (numbers_of(pair.flash_noise.gain), numbers_of(pair.flash_noise.floor)),
        pair.flash_only,
        least_sine,
        confidence,
        uncertainty,
    )
    return confidence, placed, uncertainty


@exact
def _weigh_noise(
    no_flash: Planes,
    flash: Planes,
    beside: Plane,
    no_flash_noise: tuple[Numbers, Numbers],
    flash_noise: tuple[Numbers, Numbers],
    flash_only: bool,
    least_sine: float,
    confidence: Plane,
    uncertainty: Plane,
) -> None:
    """Multiply confidence (h, W), and write uncertainty.

    beside: variance (h, W) of a flash photograph that lies beside the other.
    """
    for y in range(confidence.shape[0]):
        for x in range(confidence.shape[1]):
            n = no_flash[0][y, x], no_flash[1][y, x], no_flash[2][y, x]
            f = flash[0][y, x], flash[1][y, x], flash[2][y, x]
            light, part = _total(n), _total(f)
            variance = _variance(n, no_flash_noise)
            part_variance = _variance(f, flash_noise) + beside[y, x]
            if not flash_only:
                part -= light
                part_variance += variance
            squared, part_squared = light * light, part * part
            certain = (
                max(part, 0.0)
                * part
                / (part_squared + _DOUBT**2 * part_variance)
                * (max(light, 0.0) * light / (squared + _DOUBT**2 * variance))
            )
            relative = variance / max(squared, variance)
            relative += part_variance / max(part_squared, part_variance)
            confidence[y, x] *= certain
            noise = relative / (least_sine * least_sine) - _INVISIBLE * _INVISIBLE
            uncertainty[y, x] = min(np.sqrt(max(noise, 0.0)), 1.0)


@spliced
def _total(a: Colour) -> float:
    """In double precision: a sum of what hardly differs may be taken from another."""
    return np.float64(a[0]) + np.float64(a[1]) + np.float64(a[2])


@spliced
def _variance(a: Colour, noise: tuple[Numbers, Numbers]) -> float:
    """Of a pixel's sum."""
    gain, floor = noise
    return (
        gain[0] * max(np.float64(a[0]), 0.0)
        + gain[1] * max(np.float64(a[1]), 0.0)
        + gain[2] * max(np.float64(a[2]), 0.0)
        + (floor[0] + floor[1] + floor[2])
    )


@exact
def _deal_out(
    photograph: Planes,
    confidence: Plane,
    proportions: Floats32,
    layers: Floats32,
) -> None:
    """Turn proportions around (N, 3, h, W) into layers, by a pixel's own as far as trusted."""
    one = np.float32(1.0)
    for y in range(confidence.shape[0]):
        trust = confidence[y]
        for lamp in range(len(layers)):
            for k in range(3):
                light, own, layer = photograph[k][y], proportions[lamp, k, y], layers[lamp, k, y]
                for x in range(len(trust)):
                    part = trust[x] * own[x] + (one - trust[x]) * layer[x]
                    layer[x] = part * light[x]
