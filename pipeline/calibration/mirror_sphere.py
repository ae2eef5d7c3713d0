"""Directions, strengths and colours of distant lamps, from their highlights on a mirror sphere.

A small highlight shows all of a lamp: a mirror sphere maps equal solid angles to equal areas of its
picture, so that the sum over the highlight is the lamp's light on a card, up to one factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.calibration.lamps_estimate import LampsEstimate, inside_sphere
from pipeline.calibration.sphere import view_sphere
from pipeline.errors import UnusablePairError, counted
from pipeline.images.frames import Image, Mask
from pipeline.options import Circle, LampCount
from pipeline.pair.pair import Pair
from pipeline.vectors import angles_deg, unit

_INNER = 0.97  # of the radius: beyond, a pixel holds too wide a view
_BRIGHT = 0.25  # of the brightest: a highlight; and from one level to the next, for dimmer ones
_DIMMEST = 0.01  # of the brightest: to be a lamp with less, it would fill the sphere
_LEAST_PX, _WIDEST = 3, 0.1  # fewer are hot pixels; more of the sphere is a lit wall
_FAINT = 0.05  # of the strongest lamp: what is below is a reflection of something lit
_SURROUNDED = 4.0  # times what the sphere shows elsewhere
_ELSEWHERE = 0.8  # quantile of the sphere's light: beside dim lamps, walls and noise count more
_LEAST_FACING = 0.05  # squared cosine to the viewer: at the rim a deviation has no end
_OUTLINE = 0.01  # standard deviation of the outline by the radius, assumed
_MOST = 3  # lamps: more are not separated
_CLIPPED = 0.97  # of white
_GLOW_PX = 2  # how far lenses spread a highlight

_Spot = tuple[NDArray[np.int64], NDArray[np.int64]]  # rows and columns (n,) of pixels


@dataclass(frozen=True)
class _Highlight:
    """What a highlight shows of its lamp.

    direction: (3,) unit, to the lamp. light: (3,), of all of it. brightest: its largest value.
    """

    direction: Floats64
    light: Floats64
    brightest: float


def mirror_lamps(pair: Pair, sphere: Circle, count: LampCount, focal_px: float) -> LampsEstimate:
    """Find the lamps that a mirror sphere reflects.

    sphere: its outline. focal_px: focal length in pixels. Where a highlight is clipped, colours
    are NaN: then only the directions are known, and of lamps below a quarter of the brightest
    nothing, for a clipped lamp is no measure for them. Deviations of directions are those that an
    outline a hundredth of its radius aside would cause, not of anything seen in the picture. Raises
    OptionError for a circle too small or outside, UnusablePairError where there are no highlights
    of lamps, or too many.
    """
    mask = inside_sphere(pair.unusable.shape, sphere, _INNER)
    room, flash = pair.no_flash[:], pair.flash_part()
    spots = _spots(room, mask)
    found = [_highlight(room, spot, sphere, focal_px) for spot in spots]
    if found and max(one.brightest for one in found) <= _CLIPPED * pair.clipping:
        # a soft box is dimmer than a bulb of as much light, whose sum tells
        dimmer = _dimmer_spots(room, mask, spots)
        found += [_highlight(room, spot, sphere, focal_px) for spot in dimmer]
    found.sort(key=lambda one: -float(one.light.sum()))
    if found:
        least = _FAINT * float(found[0].light.sum())
        found = [one for one in found if one.light.sum() > least]
    wanted = len(found) if count == "auto" else count
    if len(found) < max(wanted, 1) or wanted > _MOST:
        raise UnusablePairError(_unlike(len(found), count))
    lamps = found[:wanted]
    directions = np.array([one.direction for one in lamps])
    powers = np.array([one.light for one in lamps])
    # noise can leave less than nothing of a channel
    colours = np.maximum(powers, 0.0) / max(float(np.max(powers)), 1e-12)
    if max(one.brightest for one in lamps) > _CLIPPED * pair.clipping:
        colours = np.full_like(colours, np.nan)
    middle = view_sphere(
        sphere, np.array([sphere.x]), np.array([sphere.y]), focal_px, pair.unusable.shape[::-1]
    )
    flash_aside_deg = None
    for spot in _spots(flash, mask)[:1]:
        towards_flash = _highlight(flash, spot, sphere, focal_px).direction
        flash_aside_deg = float(angles_deg(towards_flash @ middle.towards[0]))
    # A highlight turns twice as far as the surface, which turns by the outline's error.
    deviation = np.degrees(
        2 * _OUTLINE / np.sqrt(np.maximum((1 + directions[:, 2]) / 2, _LEAST_FACING))
    )
    return LampsEstimate(
        directions=directions,
        colours=colours,
        deviations_deg=deviation,
        misfit=None,
        circle=sphere,
        flash_aside_deg=flash_aside_deg,
    )


def _unlike(shown: int, count: LampCount) -> str:
    """Sentence on a number of highlights other than what was asked for."""
    highlights = counted(shown, "highlight of a lamp", "highlights of lamps")
    if count == "auto":
        return (
            f"The sphere shows {highlights}, where one to three were looked for: check that the "
            "sphere is a mirror, switch off other lamps, or tell their number."
        )
    wanted = counted(count, "was", "were")
    return (
        f"The sphere shows {highlights}, where {wanted} looked for: check that the sphere is a "
        "mirror and reflects every lamp, or tell another number."
    )


def _spots(light: Image, mask: Mask) -> list[_Spot]:
    """Highlights within a mask (H, W), the brightest first."""
    bright = np.where(mask, light.sum(axis=2), 0.0)
    usual = float(np.median(bright[mask]))
    level = max(_BRIGHT * float(bright.max()), _SURROUNDED * usual)
    spots = _parts(bright > level, mask)
    return sorted(spots, key=lambda spot: -float(bright[spot].sum()))


def _dimmer_spots(light: Image, mask: Mask, spots: list[_Spot]) -> list[_Spot]:
    """Highlights within a mask (H, W) that are dimmer than a quarter of the brightest.

    spots: the brighter ones, of whose glow none is made.
    """
    bright = np.where(mask, light.sum(axis=2), 0.0)
    level = float(bright.max())
    least = max(_DIMMEST * level, _SURROUNDED * float(np.quantile(bright[mask], _ELSEWHERE)))
    owner = np.zeros(mask.shape, np.int32)
    for number, spot in enumerate(spots, 1):
        owner[spot] = number
    found = list(spots)
    level, settled = _BRIGHT * level, len(spots)
    while level > least:
        level, before = max(_BRIGHT * level, least), len(found)
        for part in _parts(bright > level, mask):
            held = np.unique(owner[part])
            held = held[held > 0]
            if len(held) == 0:
                found.append(part)
                owner[part] = len(found)
            elif len(held) == 1 and held[0] > settled:
                found[held[0] - 1] = part  # of which the level before may have shown the tip alone
                owner[part] = held[0]
        settled = before
    return found[len(spots) :]


def _parts(bright: Mask, sphere: Mask) -> list[_Spot]:
    """What hangs together of bright pixels (H, W), of the size of a lamp on a sphere (H, W)."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright.astype(np.uint8))
    pixels = stats[:, cv2.CC_STAT_AREA]
    right_size = (pixels >= _LEAST_PX) & (pixels < _WIDEST * sphere.sum())
    right_size[0] = False  # the rest of the picture
    parts = []
    for label in np.flatnonzero(right_size):
        left, top, width, height, _ = stats[label]
        rows, columns = np.nonzero(labels[top : top + height, left : left + width] == label)
        parts.append((rows + top, columns + left))
    return parts


def _highlight(picture: Image, spot: _Spot, sphere: Circle, focal_px: float) -> _Highlight:
    """What a spot of a picture (H, W, 3) shows."""
    height, width = picture.shape[:2]
    rows, columns = _with_glow(spot, height, width)
    light = picture[rows, columns].astype(np.float64)
    x, y = columns.astype(np.float64) + 0.5, rows.astype(np.float64) + 0.5

    def towards(dx: float, dy: float) -> Floats64:
        view = view_sphere(sphere, x + dx, y + dy, focal_px, (width, height))
        cosine = (view.normals * view.towards).sum(axis=1, keepdims=True)
        return unit(2 * cosine * view.normals - view.towards)

    angle = np.cross(towards(0.5, 0) - towards(-0.5, 0), towards(0, 0.5) - towards(0, -0.5))
    share = light * np.linalg.norm(angle, axis=1, keepdims=True)
    direction = unit((towards(0, 0) * share.sum(axis=1, keepdims=True)).sum(axis=0))
    # the light falls off the sphere's own reflection evenly: what glows around is small beside it
    return _Highlight(direction, share.sum(axis=0), float(light.max()))


def _with_glow(spot: _Spot, height: int, width: int) -> _Spot:
    """A highlight and the pixels around it, inside a picture of that size."""
    rows, columns = spot
    top, left = max(rows.min() - _GLOW_PX, 0), max(columns.min() - _GLOW_PX, 0)
    bottom, right = min(rows.max() + _GLOW_PX + 1, height), min(columns.max() + _GLOW_PX + 1, width)
    box = np.zeros((bottom - top, right - left), np.uint8)
    box[rows - top, columns - left] = 1
    side = 2 * _GLOW_PX + 1
    rows, columns = np.nonzero(cv2.dilate(box, np.ones((side, side), np.uint8)))
    return rows + top, columns + left
