"""Finds a sphere in a pair by its outline: a matt one by its shading, a mirror by its highlight."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from scipy.optimize import least_squares

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.calibration.marks import on_screen
from pipeline.calibration.sphere import sphere_outline, view_rays
from pipeline.options import Circle

_LONG_SIDE = 800  # pixels of the picture in which circles are looked for
_RADII = (0.02, 0.48)  # by the short side
_ROUND = 0.6  # how much of the outline must show
_MOST = 16  # circles looked at, of each picture
_RAYS, _STEPS, _BLUR = 120, 61, 5  # along which the outline is refined, and points of each
_EDGE = (0.9, 1.1)  # radii between which it lies
_OFF = 0.005  # of the radius: edges farther from the outline are of something else
_SHADED = 0.05  # relative error of the flash part as that of a matt sphere
_ONE_COLOUR = 0.02  # how much of it may be of another colour than the whole
_WIDER = (0.96, 0.98, 1.0, 1.02, 1.04)  # times the radius: a circle found is off by so much
_INNER_MATT = 0.9  # of the radius: beyond, the light of the flash is faint
_INNER_MIRROR = 0.95  # the same: beyond, pixels show what is behind the sphere, too
_HIGHLIGHT = (0.15, 6.0)  # how far from the middle, by the radius; times what is around it
_BRIGHT = 0.5  # of the brightest: what belongs to the highlight
_SMALL = 0.05  # how much of a sphere the highlight of a flash may fill: more is no mirror's
_APART = 0.3  # of the radius: middles nearer than that are of one sphere


def find_spheres(no_flash: Floats, flash: Floats, mirror: bool, focal_px: float) -> list[Circle]:
    """Find the outlines of spheres that the flash lights from the camera, the likeliest first.

    no_flash, flash: linear light (H, W, 3) of the lamps and of the flash alone. mirror: look for
    mirror spheres, else for matt ones of one colour. focal_px: focal length in pixels. Circles have
    the middle and the area of the ellipse that an outline is. Raises OptionError for a sphere too
    near, or too far to the side.
    """
    height, width = flash.shape[:2]
    scale = min(1.0, _LONG_SIDE / max(height, width))
    size = (round(width * scale), round(height * scale))
    small = [
        np.asarray(
            cv2.resize(np.ascontiguousarray(light, np.float32), size, interpolation=cv2.INTER_AREA),
            np.float32,
        )
        for light in (no_flash, flash)
    ]
    judge: Callable[[Floats32, Circle], float | None] = _mirror if mirror else _matt
    judged = []
    for circle in _circles(small):
        error = judge(small[1], circle)
        if error is not None:
            judged.append((error, circle))
    judged.sort(key=lambda pair: pair[0])
    found: list[Circle] = []
    for _, one in judged:
        if all(
            np.hypot(one.x - o.x, one.y - o.y) > _APART * max(one.radius, o.radius) for o in found
        ):
            found.append(one)
    whole = np.sqrt(np.maximum(no_flash, 0) + np.maximum(flash, 0)).astype(np.float32)
    refined = [
        _refined(whole, Circle(x=c.x / scale, y=c.y / scale, radius=c.radius / scale), focal_px)
        for c in found
    ]
    return [_within(whole.shape, circle) for circle in refined]


def _circles(lights: list[Floats32]) -> list[Circle]:
    short = min(lights[0].shape[:2])
    low, high = (round(share * short) for share in _RADII)
    found = []
    for light in (lights[1], lights[0] + lights[1]):
        screen = cv2.medianBlur(on_screen(light), 3)
        for grey in (screen.max(axis=2), cv2.cvtColor(screen, cv2.COLOR_RGB2GRAY)):
            circles = cv2.HoughCircles(
                grey, cv2.HOUGH_GRADIENT_ALT, 1.5, 4, param1=120, param2=_ROUND,
                minRadius=max(6, low), maxRadius=high,
            )  # fmt: skip
            if circles is not None:
                rows = np.asarray(circles, np.float64).reshape(-1, circles.shape[-1])[:_MOST, :3]
                found += [Circle(x=x + 0.5, y=y + 0.5, radius=r) for x, y, r in rows.tolist()]
    return found


def _matt(flash: Floats32, circle: Circle) -> float | None:
    """How far the light of the flash is from that of a matt sphere; None where it is none.

    The light of a flash at the camera on a sphere far enough away is as the cosine to the normal.
    """
    best = None
    for wider in _WIDER:
        tried = Circle(x=circle.x, y=circle.y, radius=circle.radius * wider)
        light, away = _inside(flash, tried, _INNER_MATT)
        if light is None:  # a narrower one may lie in the picture
            break
        shape = np.sqrt(1 - away**2)
        colour = (light * shape[:, None]).sum(axis=0) / (shape**2).sum()
        total = float(colour.sum())
        if total <= 0:
            return None
        error = float(np.sqrt(np.mean((light.sum(axis=1) - shape * total) ** 2))) / total
        tint = light / np.maximum(light.sum(axis=1, keepdims=True), 1e-9) - colour / total
        spots = float(np.median(np.abs(tint)))
        if error < _SHADED and spots < _ONE_COLOUR and (best is None or error < best):
            best = error
    return best


def _mirror(flash: Floats32, circle: Circle) -> float | None:
    """How far from the middle the flash is reflected; None where it is not, or not alone."""
    light, away = _inside(flash, circle, _INNER_MIRROR)
    if light is None:
        return None
    bright = light.sum(axis=1)
    spot = bright > _BRIGHT * bright.max()
    around = float(np.median(bright[~spot])) if (~spot).any() else 0.0
    apart, times = _HIGHLIGHT
    if spot.mean() > _SMALL or bright.max() < times * max(around, 1e-6):
        return None
    aside = float(away[spot].mean())
    return aside if aside < apart else None


def _inside(light: Floats32, circle: Circle, share: float) -> tuple[Floats64 | None, Floats64]:
    """Light (n, 3) of a circle's inner share, and how far from its middle, by its radius."""
    height, width = light.shape[:2]
    reach = circle.radius
    if not (reach <= circle.x <= width - reach and reach <= circle.y <= height - reach):
        return None, np.empty(0)
    left, top = int(circle.x - reach), int(circle.y - reach)
    part = light[top : int(circle.y + reach) + 1, left : int(circle.x + reach) + 1]
    y, x = np.mgrid[: part.shape[0], : part.shape[1]] + 0.5
    away = np.hypot(x + left - circle.x, y + top - circle.y) / reach
    inner = away < share
    return part[inner].astype(np.float64), away[inner]


def _refined(light: Floats32, circle: Circle, focal_px: float) -> Circle:
    """The outline by the edges that rays from the middle meet near it.

    Edges of a sphere lie on a cone from the camera, which away from the middle of the picture is
    seen as an ellipse: a circle would follow a part of it.
    """
    size = light.shape[1], light.shape[0]
    angles = np.arange(_RAYS) * 2 * np.pi / _RAYS
    across = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    steps = np.linspace(*_EDGE, _STEPS) * circle.radius
    for _ in range(2):
        at = (circle.x, circle.y) + across[:, None] * steps[:, None] - 0.5
        part, left, top = _around(light, circle, float(steps[-1]))
        u, v = (np.ascontiguousarray(at[..., i] - (left, top)[i], np.float32) for i in (0, 1))
        profile = cv2.remap(part, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        profile = cv2.GaussianBlur(profile, (_BLUR, 1), 0)
        slope = np.abs(np.gradient(profile, axis=1)).sum(axis=2)
        edges = (circle.x, circle.y) + across * steps[slope.argmax(axis=1)][:, None]
        rays = view_rays(edges[:, 0], edges[:, 1], focal_px, size)

        def beyond(cone: Floats64, rays: Floats64 = rays) -> Floats64:
            """Angles (n,) between edges and a cone (x, y, angle), all by the focal length."""
            axis = view_rays(cone[:1], cone[1:2], focal_px, size)[0]
            apart = np.arctan2(np.linalg.norm(np.cross(rays, axis), axis=1), rays @ axis)
            return np.asarray(apart * focal_px - cone[2])

        half = float(beyond(np.array([circle.x, circle.y, 0.0])).mean())
        start = np.array([circle.x, circle.y, half])
        fit = least_squares(beyond, start, loss="cauchy", f_scale=_OFF * half)
        x, y, half = fit.x.tolist()
        circle = sphere_outline((x, y), max(half, 1.0) / focal_px, focal_px, size)
    return circle


def _within(shape: tuple[int, ...], circle: Circle) -> Circle:
    """A circle made to lie in a picture (H, W, 3): that of a sphere at its edge may fit beyond."""
    height, width = shape[:2]
    x, y = min(max(circle.x, 1.0), width - 1.0), min(max(circle.y, 1.0), height - 1.0)
    return Circle(x=x, y=y, radius=min(circle.radius, x, y, width - x, height - y))


def _around(light: Floats32, circle: Circle, reach: float) -> tuple[Floats32, int, int]:
    """Part of a picture so far around a circle's middle, and its left and upper edge.

    cv2.remap takes pictures of less than 32,767 pixels a side.
    """
    height, width = light.shape[:2]
    left, right = _span(circle.x, reach, width)
    top, bottom = _span(circle.y, reach, height)
    return light[top:bottom, left:right], left, top


def _span(middle: float, reach: float, size: int) -> tuple[int, int]:
    """First of the pixels of a side that an interpolation looks at, and the one after the last."""
    first = min(max(int(middle - reach) - 2, 0), size - 1)
    return first, min(max(int(middle + reach) + 2, first + 1), size)
