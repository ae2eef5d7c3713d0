"""Which lamps light the scene, and how many: from the reduced pair to Lamps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.errors import OptionError, UnusablePairError, counted
from pipeline.hui2018.lights import NO_AGREEMENT, invariants_of_pair, lights_of_pair
from pipeline.hui2018.pruning import prune
from pipeline.images.frames import Matrix
from pipeline.lamps.contradictions import contradictions, needless_pins
from pipeline.lamps.count import DOUBTFUL, MUCH_LEFT, UNSURE, Count, count_lamps, signs_of_fourth
from pipeline.light.model import Model
from pipeline.matrixfit.deviations import Deviations, find_deviations, no_deviations
from pipeline.matrixfit.evidence import Evidence, gather_evidence
from pipeline.matrixfit.fit import (
    MOST_LAMPS,
    Fit,
    FitInput,
    first_fit,
    fit_matrices,
    fit_pools,
    follow_outwards,
)
from pipeline.matrixfit.known import FORBIDDEN_DEGREES, Known, nothing_known
from pipeline.matrixfit.unexplained import left_over, places_alone
from pipeline.options import LampCount, Method
from pipeline.pair.reduced import ReducedPair
from pipeline.run_warnings import RunWarning
from pipeline.vectors import angles_deg, unit

MIN_PIXELS = 200
"""As few as tell anything of lamps."""

LEAST_CONTRAST = 1e-3
"""Sine of the least angle that is told from none."""

_ALIKE_DEGREES = 6.0  # chosen on development scenes (docs/trials/warnings.md)
_ALONE_DEGREES = 10.0  # to a lamp that might be beside the only one
_TYPICAL_SCATTER_DEGREES = 1.7  # median over lamps and reflectances, weighted PCA
_NO_LIGHT = -0.1  # of a lamp's colour, below which no light has a channel


@dataclass(frozen=True)
class Lamps:
    """The lamps found.

    coefficients: (N, 3) unit vectors b_j, camera RGB of a white card under the lamp (Model).
    matrices: (N, 3, 3) T_j, flash part → lamp, from the coefficients. deviations: from them, by the
    colour of the surface.
    channel_weights: (3,) 1 ÷ mean of the usable light of each channel, so that all count alike.
    requested: what was asked for; confidence: 0…1 that N is right (1 when it was given).
    lamp_confidence: (N,) 0…1, how far each lamp's colour stands out from the scatter.
    pinned: (N,) which pinned lamp each is, counted from 0, −1 for one that was free.
    invariants: (n, 3) the unit Γ they were estimated from, after pruning, for the diagram.
    four_or_more: whether there are signs of a fourth lamp. left_over: relative light that they do
    not explain in the worst tenth of it. alone: (N,) places where the edge of a shadow or a
    terminator shows each lamp alone ÷ usable pixels. contradictions: where the photograph speaks
    against what was pinned or forbidden. rival_deg: how far in colour lamps are from these that
    another search came to, in degrees (_rival_deg); 0 where there was none. changes: (N,) by how
    much brighter each was in the flash photograph, of itself; None where none changed.
    """

    coefficients: Floats64
    matrices: Matrix
    deviations: Deviations
    channel_weights: Floats64
    requested: LampCount
    confidence: float
    lamp_confidence: Floats64
    pinned: NDArray[np.int64]
    invariants: Floats64
    four_or_more: bool
    left_over: float
    alone: Floats64
    contradictions: tuple[RunWarning, ...]
    rival_deg: float = 0.0
    changes: Floats64 | None = None

    def __len__(self) -> int:
        return len(self.coefficients)

    @property
    def least_angle_deg(self) -> float:
        """Least angle between the colours of two lamps in degrees, 90 with one lamp."""
        return 90.0 if len(self) == 1 else float(_angles(self.coefficients).min())

    @property
    def alike(self) -> bool:
        """Whether two lamps are so near in colour that their layers hold each other's light."""
        return self.least_angle_deg < _ALIKE_DEGREES

    @property
    def least_sine(self) -> float:
        """Sine of the least angle between two lamps: how little noise it takes to mix them up."""
        return max(float(np.sin(np.radians(self.least_angle_deg))), LEAST_CONTRAST)

    @property
    def unexplained(self) -> bool:
        """Whether the lamps leave much of the light unexplained."""
        return self.left_over > MUCH_LEFT


FindLamps = Callable[[ReducedPair, LampCount], Lamps]
"""Finds so many lamps by what is usable of a pair. Raises as estimate_lamps."""


def estimate_lamps(
    reduced: ReducedPair,
    model: Model,
    requested: LampCount,
    method: Method,
    known: Known | None = None,
) -> Lamps:
    """Estimate the lamps, and their number where it is not given.

    method: "best" fits a matrix to each lamp (matrixfit), "paper" takes the published algorithms.
    known: pinned and forbidden lamps, of which "paper" knows nothing. Raises UnusablePairError
    where too few pixels are usable, OptionError where every fit has a forbidden lamp.
    """
    known = known or nothing_known(model.flash_white)
    given = FitInput(reduced, gather_evidence(reduced), model, known)
    _check_enough(given.evidence)
    gammas = _invariants(reduced, model)
    fits = _Fits(given)
    if requested == "auto":
        count = count_lamps(given, fits.first)
    else:
        count = Count(requested, confidence=1.0)
    weights = 1.0 / reduced.no_flash[reduced.usable].mean(axis=0, dtype=np.float64)
    if method == "paper":
        found = _published(given, count.number)
    else:
        found = _fitted(given, fits, count.number, weights)
    against = _against_known(given, fits, count.number)
    left = left_over(reduced, found.matrices)
    four_or_more = False
    if count.number == MOST_LAMPS and (method == "best" or requested == "auto"):
        # lamps followed outwards leave less, as if there were no fourth
        four_or_more = signs_of_fourth(given, fits.moved(MOST_LAMPS).matrices)
    order = _warm_first(found.coefficients)
    coefficients, matrices = found.coefficients[order], found.matrices[order]
    return Lamps(
        coefficients=coefficients,
        matrices=matrices,
        deviations=found.deviations,
        channel_weights=weights,
        requested=requested,
        confidence=_confidence(count, left, four_or_more) if requested == "auto" else 1.0,
        lamp_confidence=_stand_out(coefficients, gammas),
        pinned=np.where(order < len(known.pinned), order, -1),
        invariants=gammas,
        four_or_more=four_or_more,
        left_over=left,
        alone=places_alone(given.evidence, matrices),
        contradictions=tuple(against),
        rival_deg=found.rival_deg,
    )


class _Fits:
    """The fits of every number of lamps, each made when it is first asked for.

    first: what one search comes to (first_fit). usual: the best one (fit_matrices). moved: that,
    followed by pools of light (fit_pools).
    """

    def __init__(self, given: FitInput) -> None:
        self.first = cache(lambda lamps: first_fit(given, lamps))
        self.usual = cache(lambda lamps: fit_matrices(given, lamps, self.first(lamps)))
        self.moved = cache(lambda lamps: fit_pools(given, self.usual(lamps)))


def _check_enough(evidence: Evidence) -> None:
    """Raise UnusablePairError where too few pixels tell of lamps."""
    if len(evidence.pixels) < MIN_PIXELS:
        raise UnusablePairError(
            "Too few pixels show both lamps and flash unclipped: bring the flash nearer or raise "
            "its power, and expose so that little is clipped."
        )


def _confidence(count: Count, left: float, four_or_more: bool) -> float:
    """Confidence 0…1 in a number of lamps that was counted; the rest as in Lamps."""
    confidence = count.confidence
    if left > MUCH_LEFT:
        confidence = min(confidence, DOUBTFUL)
    if four_or_more:
        confidence = min(confidence, UNSURE)
    return confidence


@dataclass(frozen=True)
class _Found:
    """Lamps as one of the methods found them, in no order.

    coefficients, matrices, rival_deg: as in Lamps. deviations: of the lamps from warm to cool.
    """

    coefficients: Floats64
    matrices: Matrix
    deviations: Deviations
    rival_deg: float = 0.0


def _published(given: FitInput, number: int) -> _Found:
    """So many lamps as the paper finds them."""
    coefficients = lights_of_pair(given.reduced, given.model, number)
    return _Found(coefficients, given.model.lamp_matrix(coefficients), no_deviations(number))


def _fitted(given: FitInput, fits: _Fits, number: int, weights: Floats64) -> _Found:
    """So many lamps as they are fitted, followed to where fewer pixels are pure.

    weights: of the channels. Raises OptionError where every fit has a forbidden lamp.
    """
    reduced, model = given.reduced, given.model
    first, fit = fits.first(number), follow_outwards(given, fits.moved(number))
    if fit.cost == np.inf:
        explain = counted(len(fit.matrices), "lamp explains", "lamps explain")
        raise OptionError(
            f"Whatever {explain} the photograph, one of them is less than "
            f"{FORBIDDEN_DEGREES:g}° in colour from a forbidden one: forbid fewer, or ask for "
            "another number of lamps."
        )
    if given.known.pinned:
        first = replace(first, passed_over=_that_shine(first.passed_over, model))
    coefficients, matrices = _normalised(fit.matrices, model)
    warm_first = matrices[_warm_first(coefficients)]
    return _Found(
        coefficients,
        matrices,
        find_deviations(reduced, given.evidence, warm_first, weights),
        # a rendering's curve leads searches apart
        0.0 if reduced.rendered else _rival_deg(first, coefficients, model),
    )


def _against_known(given: FitInput, fits: _Fits, number: int) -> list[RunWarning]:
    """Where the photograph speaks against what is known of so many lamps, if anything is."""
    known = given.known
    if not known.pinned and not len(known.forbidden):
        return []
    found, nothing = fits.usual(number), nothing_known(given.model.flash_white)
    against = contradictions(given, found, fit_matrices(replace(given, known=nothing), number))
    if against or not 1 < len(known.pinned) == number or not given.evidence.has_edges:
        return against
    fewer = [
        fit_matrices(replace(given, known=known.without(pin)), number - 1) for pin in known.pinned
    ]
    return needless_pins(found, fewer)


def _invariants(reduced: ReducedPair, model: Model) -> Floats64:
    """Unit Γ (n, 3) of the usable pixels, pruned as published, in the model's coordinates."""
    gammas = invariants_of_pair(reduced, model)
    kept = prune(gammas[gammas.any(axis=1)])
    if not len(kept):
        raise UnusablePairError(NO_AGREEMENT)
    return unit(kept @ np.linalg.inv(model.published).T)


def _normalised(matrices: Matrix, model: Model) -> tuple[Floats64, Matrix]:
    """Coefficients (N, 3) of unit length, and the matrices that go with them."""
    whites = matrices @ model.flash_white
    # chromaticities do not tell T from −T
    scale = np.sign(whites.sum(axis=1)) * np.linalg.norm(whites, axis=1)
    return whites / scale[:, None], matrices / scale[:, None, None]


def _that_shine(found: tuple[Floats64, ...], model: Model) -> tuple[Floats64, ...]:
    """Keep those sets of lamps (N, 3, 3) in which each may be a light: no channel far below 0.

    A search that begins with a pinned lamp beside published ones may end at what is no light: then
    a published one was wrong, and nothing speaks against the pin. Of values in sRGB, which may be
    negative for lights, all are kept.
    """
    if model.camera.in_srgb:
        return found
    return tuple(one for one in found if _normalised(one, model)[0].min() > _NO_LIGHT)


def _rival_deg(found: Fit, coefficients: Floats64, model: Model) -> float:
    """Angle in degrees between the lamps found and those that a search passed over.

    It is the largest from a lamp of either set to the nearest of the other (Hausdorff's distance),
    over all sets passed over; 0 where there are none. coefficients: (N, 3) unit, of those found.
    """
    furthest = 0.0
    for rival in found.passed_over:
        cosines = coefficients @ _normalised(rival, model)[0].T
        nearest = min(cosines.max(axis=0).min(), cosines.max(axis=1).min())
        furthest = max(furthest, float(angles_deg(nearest)))
    return furthest


def _warm_first(coefficients: Floats64) -> NDArray[np.int64]:
    """Order (N,) of the lamps from warm to cool, so that equal scenes give equal names."""
    return np.argsort(-coefficients[:, 0] / coefficients.sum(1), kind="stable")


def _stand_out(coefficients: Floats64, gammas: Floats64) -> Floats64:
    """How far each lamp's colour stands out, (N,) 0…1: a² ÷ (a² + (2s)²).

    a: angle in degrees to the nearest other lamp, 10° of one alone. s: scatter of the invariants.
    """
    alone = len(coefficients) == 1
    nearest = np.array([_ALONE_DEGREES]) if alone else _angles(coefficients).min(axis=1)
    scatter = _scatter_degrees(coefficients, gammas)
    return np.asarray(nearest**2 / np.maximum(nearest**2 + (2 * scatter) ** 2, 1e-12))


def _scatter_degrees(coefficients: Floats64, gammas: Floats64) -> float:
    """Median angle of the invariants (n, 3) to the one lamp, or to the great circle of two."""
    if len(coefficients) > 2:  # they span the sphere, so that scatter cannot be told from light
        return _TYPICAL_SCATTER_DEGREES
    if len(coefficients) == 1:
        off = np.linalg.norm(gammas - coefficients[0], axis=1)
    else:
        off = np.abs(gammas @ unit(np.cross(coefficients[0], coefficients[1])))
    return float(np.degrees(np.median(off)))


def _angles(coefficients: Floats64) -> Floats64:
    """Angles in degrees between each lamp and the others, (N, N − 1)."""
    cosines = coefficients @ coefficients.T
    n = len(coefficients)
    return angles_deg(cosines[~np.eye(n, dtype=bool)].reshape(n, n - 1))
