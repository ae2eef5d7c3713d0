from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.light.model import Model
from pipeline.matrixfit.evidence import evidence_of_surfaces
from pipeline.matrixfit.fit import fit_pin
from pipeline.matrixfit.known import FORBIDDEN_DEGREES, Known, Pin, nothing_known


@pytest.fixture
def known(model: Model, surfaces: Floats64) -> Callable[[Floats64, Floats64], Known]:
    """Pin some lamps and forbid some, given by their coefficients."""

    def of_lamps(pinned: Floats64, forbidden: Floats64) -> Known:
        pins = [
            fit_pin(evidence_of_surfaces(surfaces, surfaces @ matrix.T), model, True)
            for matrix in model.lamp_matrix(pinned)
        ]
        whites = model.lamp_matrix(forbidden) @ model.flash_white
        whites = whites / np.linalg.norm(whites, axis=1, keepdims=True)
        return Known(tuple(pins), whites, model.flash_white)

    return of_lamps


def turned(model: Model, coefficients: Floats64, degrees: float) -> Floats64:
    """A matrix (3, 3) whose white card differs by an angle from that of a lamp."""
    white = model.lamp_matrix(coefficients) @ model.flash_white
    white = white / np.linalg.norm(white)
    across = np.cross(white, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    angle = np.radians(degrees)
    moved = np.cos(angle) * white + np.sin(angle) * across
    return np.asarray(np.outer(moved, model.flash_white / (model.flash_white @ model.flash_white)))


@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_pin_is_the_lamp_that_the_surfaces_show(
    model: Model, surfaces: Floats64, warm_to_cool: Floats64, which: int, off: Callable[..., float]
) -> None:
    true = model.lamp_matrix(warm_to_cool[which])
    pin = fit_pin(evidence_of_surfaces(surfaces, 3 * surfaces @ true.T), model, True)
    assert np.linalg.norm(pin.matrix) == pytest.approx(1)
    assert off(pin.matrix[None], true[None]) < 1e-3


def test_of_few_colours_the_prior_tells_the_rest(
    model: Model, surfaces: Floats64, warm_to_cool: Floats64
) -> None:
    """One surface tells a lamp's colour; its matrix is then the model's own."""
    theta = model.prior.coordinates(model.lamp_matrix(warm_to_cool[:1]))
    theta[0, 3] += 0.1
    (true,) = model.prior.matrices(theta)

    one = fit_pin(evidence_of_surfaces(surfaces[:1], surfaces[:1] @ true.T), model, True)
    all_ = fit_pin(evidence_of_surfaces(surfaces, surfaces @ true.T), model, True)

    seen = surfaces[0] @ one.matrix.T
    np.testing.assert_allclose(
        seen / seen.sum(), true @ surfaces[0] / (true @ surfaces[0]).sum(), atol=1e-4
    )
    outside = [model.prior.coordinates(pin.matrix[None])[0, 3] for pin in (one, all_)]
    assert abs(outside[0]) < 0.3 * outside[1]
    assert outside[1] == pytest.approx(theta[0, 3] / np.linalg.norm(theta), rel=0.1)


@pytest.mark.parametrize(
    ("degrees", "near"), [(0.0, True), (2.9, True), (3.1, False), (20.0, False)]
)
def test_lights_near_a_forbidden_one_are_forbidden(
    known: Callable[[Floats64, Floats64], Known],
    model: Model,
    warm_to_cool: Floats64,
    degrees: float,
    near: bool,
) -> None:
    assert FORBIDDEN_DEGREES == 3
    it = known(warm_to_cool[:0], warm_to_cool[[2, 0]])
    matrix = turned(model, warm_to_cool[0], degrees)
    assert it.forbids(np.stack([matrix, -matrix])).tolist() == [near, near]


def test_a_fence_stands_about_forbidden_lamps(
    known: Callable[[Floats64, Floats64], Known], model: Model, warm_to_cool: Floats64
) -> None:
    """3000 in the middle, nothing beyond 3.4°, nothing for pinned lamps; its gradient is true."""
    it = known(warm_to_cool[[1]], warm_to_cool[[0]])
    first = turned(model, warm_to_cool[0], 0.0)

    def height(degrees: float) -> float:
        return it.fence(np.stack([first, -2 * turned(model, warm_to_cool[0], degrees)]))[0]

    assert height(0.0) == pytest.approx(3000, rel=1e-6)
    assert height(2.0) == pytest.approx(3000 * (1 - (2.0 / 3.4) ** 2) ** 2, rel=0.01)
    assert height(3.0) > 100
    assert height(3.41) == 0
    lamps = np.stack([first, turned(model, warm_to_cool[0], 2.0)])
    _, gradient = it.fence(lamps)
    assert not gradient[0].any()
    for place in np.ndindex(3, 3):
        step = np.zeros_like(lamps)
        step[1][place] = 1e-6
        slope = (it.fence(lamps + step)[0] - it.fence(lamps - step)[0]) / 2e-6
        assert gradient[1][place] == pytest.approx(slope, rel=1e-3, abs=1e-2)


def test_fences_of_all_lamps_and_lights_add_up(
    known: Callable[[Floats64, Floats64], Known], model: Model, warm_to_cool: Floats64
) -> None:
    """Of lamps of any length and sign, whose gradients are true."""
    near = warm_to_cool[0] + [0.0, 0.02, 0.0]
    it = known(warm_to_cool[:0], np.stack([warm_to_cool[0], near, warm_to_cool[2]]))
    lamps = np.stack(
        [
            2 * turned(model, warm_to_cool[0], 1.0),
            -3 * turned(model, warm_to_cool[0], 2.0),
            turned(model, warm_to_cool[2], 1.5),
        ]
    )

    value, gradient = it.fence(lamps)

    alone = [
        Known((), it.forbidden[[light]], model.flash_white).fence(lamps[[lamp]])[0]
        for lamp in range(3)
        for light in range(3)
    ]
    assert np.count_nonzero(alone) == 5
    assert value == pytest.approx(sum(alone))
    for place in np.ndindex(3, 3, 3):
        step = np.zeros_like(lamps)
        step[place] = 1e-6
        slope = (it.fence(lamps + step)[0] - it.fence(lamps - step)[0]) / 2e-6
        assert gradient[place] == pytest.approx(slope, rel=1e-3, abs=1e-2)


def test_pinned_lamps_are_not_held_against_a_fit(
    known: Callable[[Floats64, Floats64], Known], model: Model, warm_to_cool: Floats64
) -> None:
    it = known(warm_to_cool[:1], warm_to_cool[:1])
    matrices = model.lamp_matrix(warm_to_cool)
    assert not it.rejects(matrices)
    assert it.rejects(matrices[[1, 0]])
    assert not nothing_known(model.flash_white).rejects(matrices)


def test_a_pinned_lamp_takes_the_place_of_the_nearest(
    known: Callable[[Floats64, Floats64], Known], model: Model, warm_to_cool: Floats64
) -> None:
    it = known(warm_to_cool[[1]], warm_to_cool[:0])
    others = model.lamp_matrix(warm_to_cool + np.array([0.02, 0.0, -0.02]))
    others[1] *= -1  # chromaticities do not tell T from −T
    others /= np.linalg.norm(others, axis=(1, 2), keepdims=True)

    found = it.completed(others)

    np.testing.assert_array_equal(found, np.stack([it.pinned[0].matrix, others[0], others[2]]))
    nothing = nothing_known(model.flash_white)
    np.testing.assert_array_equal(nothing.completed(others), others)
    assert isinstance(it.pinned[0], Pin)
