"""Which lamps light the scene, and how many: from the reduced pair to Lamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.count import count_lamps
from pipeline.errors import UnusablePairError
from pipeline.frames import Matrix
from pipeline.hui2018.invariant import light_coefficients
from pipeline.hui2018.lamps import one_lamp, prune, three_lamps, two_lamps, unit
from pipeline.model import Model
from pipeline.reduced import ReducedPair
from pipeline.shares import shares

Array = NDArray[np.float64]

_MIN_PIXELS = 200
_PRUNED = 0.03
_PRUNED_FOR_THREE = (0.06, 0.1, 0.15, 0.2)  # the smallest triangle obeys every outlier
_LINE_TOLERANCE = 0.04  # in the tangent plane, 2.3°: the scatter of one lamp over reflectances
_TAIL = 0.01
_SIMILAR_DEGREES = 6.0
_ALONE_DEGREES = 10.0
_LEAST_CONTRAST = 1e-3
_TYPICAL_SCATTER_DEGREES = 1.7  # median over lamps and reflectances, weighted PCA


_MOST = 3
_PURE_SHARE, _PURE_PIXELS, _MANY_PURE_PIXELS = 0.7, 0.003, 0.0145


@dataclass(frozen=True)
class Lamps:
    """The lamps found.

    coefficients: (N, 3) unit vectors b_j, camera RGB of a white card under the lamp (Model).
    matrices: (N, 3, 3) T_j, flash part → lamp, from the coefficients.
    channel_weights: (3,) 1 ÷ mean of the usable light of each channel, so that all count alike.
    requested: what was asked for; confidence: 0…1 that N is right (1 when it was given).
    lamp_confidence: (N,) 0…1, how far each lamp's colour stands out from the scatter.
    invariants: (n, 3) the unit Γ they were estimated from, after pruning, for the diagram.
    """

    coefficients: Array
    matrices: Matrix
    channel_weights: Array
    requested: Literal["auto", 1, 2, 3]
    confidence: float
    lamp_confidence: Array
    invariants: Array
    warnings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.coefficients)

    @property
    def contrast(self) -> float:
        """Sine of the least angle between two lamps: how little noise it takes to mix them up."""
        if len(self) == 1:
            return 1.0
        return max(float(np.sin(np.radians(_angles(self.coefficients).min()))), _LEAST_CONTRAST)


def estimate_lamps(
    reduced: ReducedPair, model: Model, requested: Literal["auto", 1, 2, 3], rendered: bool
) -> Lamps:
    """Estimate the lamps' colours by the published algorithms, and their number where not given.

    rendered: the photographs are not sensor values, so that the model fits them less well.
    Raises UnusablePairError where too few pixels are usable.
    """
    no_flash = reduced.no_flash[reduced.usable].astype(np.float64)
    flash = reduced.flash[reduced.usable].astype(np.float64)
    if len(no_flash) < _MIN_PIXELS:
        raise UnusablePairError(
            "Too few pixels show both lamps and flash unclipped: bring the flash nearer or raise "
            "its power, and expose so that little is clipped."
        )
    gammas = unit(light_coefficients(no_flash, flash, model.tensor))
    gammas = prune(gammas[gammas.any(axis=1)], _PRUNED)
    if len(gammas) < _MIN_PIXELS:
        raise UnusablePairError(
            "The light of hardly any pixel fits the camera's model: check camera and encoding."
        )
    candidates = {
        1: one_lamp(gammas),
        2: two_lamps(gammas, _LINE_TOLERANCE, _TAIL),
        3: three_lamps(gammas),
    }
    if requested == "auto":
        one, two = model.lamp_matrix(candidates[1])[0], model.lamp_matrix(candidates[2])
        count, confidence = count_lamps(reduced, one, two, rendered)
        if count == _MOST and _purity(reduced, model, candidates[count]) < _PURE_PIXELS:
            # the triangle's corners lie where no light is: outliers made it
            count, confidence = 2, 1.0 - confidence
    else:
        count, confidence = int(requested), 1.0
    if count == _MOST:
        candidates[_MOST] = _filled_triangle(reduced, model, gammas, candidates[_MOST])
    coefficients = _warm_first(candidates[count])
    return Lamps(
        coefficients=coefficients,
        matrices=model.lamp_matrix(coefficients),
        channel_weights=1.0 / no_flash.mean(axis=0),
        requested=requested,
        confidence=confidence,
        lamp_confidence=_stand_out(coefficients, gammas),
        invariants=gammas,
        warnings=tuple(_warnings(coefficients)),
    )


def _filled_triangle(reduced: ReducedPair, model: Model, gammas: Array, whole: Array) -> Array:
    """The largest triangle with light in all its corners, of ever more pruned invariants.

    Where there is none, as on smooth things without cast shadows, the whole one.
    """
    for triangle in (whole, *(three_lamps(prune(gammas, share)) for share in _PRUNED_FOR_THREE)):
        if _purity(reduced, model, triangle) >= _MANY_PURE_PIXELS:
            return triangle
    return whole


def _purity(reduced: ReducedPair, model: Model, coefficients: Array) -> float:
    """Share of pixels lit nearly by one lamp alone, for the lamp that has fewest of them."""
    no_flash = reduced.no_flash[reduced.usable]
    matrices = model.lamp_matrix(coefficients).astype(np.float32)
    predicted = np.einsum("nkl,pl->npk", matrices, reduced.flash[reduced.usable])
    light = (shares(no_flash, predicted)[..., None] * predicted).sum(axis=-1)
    share = light / np.maximum(light.sum(axis=0), 1e-9)
    return float((share > _PURE_SHARE).mean(axis=1).min())


def _warm_first(coefficients: Array) -> Array:
    """Order the lamps from warm to cool, so that equal scenes give equal names."""
    return np.asarray(coefficients[np.argsort(-coefficients[:, 0] / coefficients.sum(1))])


def _stand_out(coefficients: Array, gammas: Array) -> Array:
    """Share of a lamp's angle to its nearest other (or, alone, of 10°) that is not scatter."""
    if len(coefficients) == 1:
        off = np.linalg.norm(gammas - coefficients[0], axis=1)
        nearest = np.array([_ALONE_DEGREES])
    else:
        off = np.abs(gammas @ unit(np.cross(coefficients[0], coefficients[1])))
        nearest = _angles(coefficients).min(axis=1)
    # three lamps span the sphere, so that scatter cannot be told from light
    scatter = np.degrees(np.median(off)) if len(coefficients) < 3 else _TYPICAL_SCATTER_DEGREES
    return np.asarray(nearest**2 / np.maximum(nearest**2 + (2 * scatter) ** 2, 1e-12))


def _angles(coefficients: Array) -> Array:
    """Angles in degrees between each lamp and the others, (N, N − 1)."""
    cosines = np.clip(coefficients @ coefficients.T, -1.0, 1.0)
    n = len(coefficients)
    return np.degrees(np.arccos(cosines[~np.eye(n, dtype=bool)].reshape(n, n - 1)))


def _warnings(coefficients: Array) -> list[str]:
    if len(coefficients) < 2:
        return []
    nearest = float(_angles(coefficients).min())
    if nearest >= _SIMILAR_DEGREES:
        return []
    return [
        f"Two lamps are only {nearest:.1f}° apart in colour; their layers may hold each other's "
        "light. A coloured filter on one of the lamps helps."
    ]
