"""Directions, strengths and colours of distant lamps, from a matt grey sphere.

The light of lamp j on a surface of normal n is albedo · c_j max(n·l_j, 0) (Lambert). The flash part
gives the albedo; where the shadow lines of lamps lie on the sphere tells the lamps apart.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32
from pipeline.calibration.lamps_and_flash import lamps_and_flash
from pipeline.calibration.lamps_estimate import LampsEstimate, inside_sphere
from pipeline.calibration.sphere_fit import SphereFit, SphereLight, fit_lamps, fit_one_more
from pipeline.errors import UnusablePairError
from pipeline.options import Circle, LampCount
from pipeline.pair.pair import Pair

_INNER = 0.9  # of the radius: beyond, the outline that was marked may miss the sphere
_MOST_UNUSABLE = 0.2  # share of the sphere
_BLOCKS = 4_000  # at least, of a large sphere
_LEAST_BLOCKS = 100  # that are wholly usable: fewer hardly fix the twelve unknowns of three lamps
_CLIPPED = (
    "The sphere is clipped, or moved between the photographs: expose shorter, and keep it still."
)
_NO_SPHERE = 0.12  # relative error of the flash part as that of a matt sphere
_ELSEWHERE = 0.1  # of the radius: no mark is so wrong
_NO_LAMPS = 0.08  # the same of the lamps' light
_MOST_LAMPS = 3
_ONE_MORE = 0.03  # what one more lamp must explain, in squares of what paint and noise allow
_MUCH_MORE = 0.01  # the same of one beyond those told or three: light off a table explains less
_UNSURE_DEG = 3.0  # standard deviation of a direction


def matt_lamps(pair: Pair, sphere: Circle, count: LampCount, focal_px: float) -> LampsEstimate:
    """Find the lamps that light a matt grey sphere.

    sphere: its outline, which is trusted to two hundredths of its radius. focal_px: focal length
    in pixels. Raises OptionError for a circle that is too small or outside; UnusablePairError
    where the sphere is clipped or dark or none, where distant lamps do not explain its light, where
    lamps cannot be told apart, and where four or more are found.
    """
    seen = _look(pair, sphere, focal_px)
    best = fit_lamps(seen, 1 if count == "auto" else count)
    for more in range(2, _MOST_LAMPS + 1) if count == "auto" else ():
        fit = fit_lamps(seen, more)
        if not best.cost - fit.cost >= _ONE_MORE:  # nor NaN, here and below
            break
        best = fit
    _check_sphere(best)
    if not best.misfit <= _NO_LAMPS:
        raise UnusablePairError(
            f"Distant lamps do not explain {best.misfit:.0%} of the light on the sphere: check "
            "the circle, the number of lamps, and that nothing near throws light or shadow on it."
        )
    sure = best.deviations_deg <= _UNSURE_DEG
    if not sure.all() or not (best.colours.max(axis=1) > 0).all():
        raise UnusablePairError(
            "The lamps cannot be told apart on this sphere: move them farther from each other, or "
            "photograph it under each of them alone."
        )
    tried = count == "auto" and len(best.directions) < _MOST_LAMPS
    one_more = not tried and best.cost - fit_one_more(seen, best).cost >= _MUCH_MORE
    if one_more and count == "auto":
        raise UnusablePairError(
            "Four lamps or more light the sphere, and three are the most that it tells: photograph "
            "it under some of them at a time. Where only three shine, keep other light off it, or "
            "tell their number."
        )
    order = np.argsort(-best.colours[:, 1])
    dx, dy, wider = best.moved * sphere.radius
    return LampsEstimate(
        directions=best.directions[order],
        colours=np.maximum(best.colours[order], 0.0),
        deviations_deg=best.deviations_deg[order],
        misfit=best.misfit,
        circle=Circle(x=sphere.x + dx, y=sphere.y + dy, radius=sphere.radius + wider),
        flash_aside_deg=best.flash_aside_deg,
        one_more=one_more,
    )


def _look(pair: Pair, sphere: Circle, focal_px: float) -> SphereLight:
    """Light of the sphere, means over blocks of pixels where there are many."""
    mask = inside_sphere(pair.unusable.shape, sphere, _INNER)
    if pair.unusable[mask].mean() > _MOST_UNUSABLE:
        raise UnusablePairError(_CLIPPED)
    height, width = mask.shape
    side = max(1, int(np.sqrt(mask.sum() / _BLOCKS)))
    size = (width // side, height // side)
    crop = np.s_[: size[1] * side, : size[0] * side]

    def means(picture: NDArray[Any]) -> Floats32:
        shrunk = cv2.resize(picture[crop].astype(np.float32), size, interpolation=cv2.INTER_AREA)
        return np.asarray(shrunk)

    whole = means(mask & ~pair.unusable) > 1 - 0.5 / side**2
    if whole.sum() < _LEAST_BLOCKS:  # of pixels that are scattered few spoil most blocks
        raise UnusablePairError(_CLIPPED)
    rows, columns = np.nonzero(whole)
    lights = lamps_and_flash(
        pair, means(pair.no_flash[:])[whole], means(pair.flash[:])[whole], side**2
    )
    x, y = ((at.astype(np.float64) + 0.5) * side for at in (columns, rows))
    return SphereLight(x, y, sphere, focal_px, (width, height), lights)


def _check_sphere(fit: SphereFit) -> None:
    if not (fit.flash_misfit <= _NO_SPHERE and np.abs(fit.moved).max() <= _ELSEWHERE):
        raise UnusablePairError(
            "The circle is not the outline of a matt sphere of one grey in the light of the flash: "
            "check the circle, and that the flash reaches the sphere."
        )
