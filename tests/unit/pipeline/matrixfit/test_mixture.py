from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit.mixture import blocks, mixture
from tests.definitions.mixture import plain_mixture

GREY = np.full(3, 1 / 3)
CORNERS = ((0.2, 0.3), (0.5, 0.4), (0.3, 0.6))
S = 0.01


def lamp(corner: tuple[float, float]) -> Floats64:
    """The diagonal matrix whose light on grey has that chromaticity."""
    return 3 * np.diag([*corner, 1 - sum(corner)])


def arguments(matrices: Floats64, x: Floats64, **more: Any) -> dict[str, Any]:
    """What the mixture takes, by default for data that are isotropic already."""
    given: dict[str, Any] = {
        "whitener": np.tile(np.eye(2), (len(x), 1, 1)),
        "sigma": np.full(len(x), S),
        "worth": np.ones(len(x)),
        "extension": 0.0,
        "outlier": 1.5,
        "area_power": 0.5,
        "interior": len(matrices) == 3,
        "mirrored": np.zeros(3),
    }
    return given | more


def evaluate(
    matrices: Floats64, x: Floats64, u: Floats64, weights: Floats64, **more: Any
) -> tuple[float, Floats64, Floats64]:
    """Value, gradient and counts."""
    given = arguments(matrices, x, **more)
    power = given["area_power"]
    data = blocks(x, u, given["whitener"], given["sigma"], given["worth"], power)
    shape = given["extension"], given["outlier"], power, given["interior"]
    value, gradient, counts = mixture(matrices, data, weights, *shape, given["mirrored"])
    return value, gradient, counts


def assert_as_defined(
    matrices: Floats64, x: Floats64, u: Floats64, weights: Floats64, **more: Any
) -> None:
    value, gradient, counts = evaluate(matrices, x, u, weights, **more)

    expected = plain_mixture(matrices, x=x, u=u, weights=weights, **arguments(matrices, x, **more))
    assert value == pytest.approx(expected[0], rel=1e-12, abs=1e-300)
    assert abs(gradient - expected[1]).max() <= 1e-11 * abs(expected[1]).max() + 1e-100
    assert abs(counts - expected[2]).max() <= 1e-12 * expected[2].max()


def density(point: tuple[float, float], lamps: int, component: int, **more: Any) -> float:
    """Density of one component at a point, the others being switched off."""
    size = {1: 2, 2: 4, 3: 8 if more.get("interior", True) else 7}[lamps]
    weights = np.zeros(size)
    weights[component] = 1.0
    matrices = np.array([lamp(corner) for corner in CORNERS[:lamps]])
    value, _, counts = evaluate(matrices, GREY[None], np.array([point]), weights, **more)
    assert counts[component] == pytest.approx(1)
    return math.exp(-value)


def normal_cdf(z: float) -> float:
    return (1 + math.erf(z / math.sqrt(2))) / 2


@pytest.mark.parametrize("lamps", [1, 2, 3])
def test_a_corner_is_a_normal_distribution(lamps: int) -> None:
    peak = 1 / (2 * math.pi * S**2)
    x, y = CORNERS[lamps - 1]

    assert density((x, y), lamps, lamps - 1) == pytest.approx(peak)
    assert density((x + S, y - 2 * S), lamps, lamps - 1) == pytest.approx(peak * math.exp(-2.5))


@pytest.mark.parametrize("component", [1, 3, 7])
def test_outliers_are_even(component: int) -> None:
    lamps = {1: 1, 3: 2, 7: 3}[component]

    assert density((0.9, -0.4), lamps, component) == pytest.approx(1.5)
    assert density((0.3, 0.3), lamps, component, outlier=6.0) == pytest.approx(6.0)


@pytest.mark.parametrize("extension", [0.0, 0.5])
@pytest.mark.parametrize("along", [-0.6, -0.01, 0.25, 0.5, 1.02, 1.51])
def test_an_edge_is_even_along_it_and_normal_across(extension: float, along: float) -> None:
    length = math.hypot(0.3, 0.1)
    point = (0.2 + 0.3 * along + S * 0.1 / length, 0.3 + 0.1 * along - S * 0.3 / length)

    found = density(point, 2, 2, extension=extension)

    across = math.exp(-0.5) / (math.sqrt(2 * math.pi) * S)
    from_low = normal_cdf((along + extension) * length / S)
    from_high = normal_cdf((1 + extension - along) * length / S)
    expected = across * (from_low + from_high - 1) / ((1 + 2 * extension) * length)
    assert found == pytest.approx(max(expected, 1e-300), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("edge", [3, 4, 5])
def test_edges_join_the_corners_in_order(edge: int) -> None:
    a, b = ((0, 1), (0, 2), (1, 2))[edge - 3]
    middle = tuple(np.mean([CORNERS[a], CORNERS[b]], axis=0))
    length = math.dist(CORNERS[a], CORNERS[b])

    found = density((middle[0], middle[1]), 3, edge)

    assert found == pytest.approx(1 / (math.sqrt(2 * math.pi) * S * length))


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (2, 0, 1), (1, 0, 2)])
@pytest.mark.parametrize("power", [0.2, 0.5, 1.0])
def test_the_interior_is_even_within_the_triangle(order: tuple[int, ...], power: float) -> None:
    area = abs(0.3 * 0.3 - 0.1 * 0.1) / 2
    matrices = np.array([lamp(CORNERS[i]) for i in order])
    weights = np.eye(8)[6]

    def at(x: float, y: float) -> float:
        u = np.array([[x, y]])
        return math.exp(-evaluate(matrices, GREY[None], u, weights, area_power=power)[0])

    even = 50 * (50 * (area + 2 * S**2)) ** -power
    assert at(1 / 3, 1.3 / 3) == pytest.approx(even, rel=1e-6)
    on_edge = at(0.35, 0.35)
    assert on_edge == pytest.approx(even / 2, rel=1e-6)
    assert at(0.35, 0.25) < 1e-12 * even


def test_densities_add_up_by_their_weights() -> None:
    matrices = np.array([lamp(corner) for corner in CORNERS[:2]])
    point = (0.21, 0.305)
    weights = np.array([0.2, 0.3, 0.4, 0.1])

    value, _, counts = evaluate(
        matrices, GREY[None], np.array([point]), weights, worth=np.array([3.0])
    )

    parts = weights * [density(point, 2, k) if k != 1 else 0.0 for k in range(4)]
    assert value == pytest.approx(-3 * math.log(parts.sum()))
    np.testing.assert_allclose(counts, 3 * parts / parts.sum(), atol=1e-9)


def test_the_flash_colour_moves_the_corner() -> None:
    """A lamp of diag(1, 2, 3) on flash colour (½, ¼, ¼) gives (2, 2, 3) / 7."""
    matrices = np.diag([1.0, 2.0, 3.0])[None]

    value, _, _ = evaluate(
        matrices, np.array([[0.5, 0.25, 0.25]]), np.array([[2 / 7, 2 / 7]]), np.array([1.0, 0.0])
    )

    assert value == pytest.approx(math.log(2 * math.pi * S**2))


def test_a_line_and_corners_integrate_to_one() -> None:
    axis = np.linspace(-0.5, 1.2, 150)
    points = np.stack(np.meshgrid(axis, axis), axis=2).reshape(-1, 2)
    matrices = np.array([lamp(corner) for corner in CORNERS[:2]])
    total = 0.0
    for u in points:
        value, _, _ = evaluate(
            matrices,
            GREY[None],
            u[None],
            np.array([0.3, 0.3, 0.4, 0.0]),
            sigma=np.full(1, 0.02),
            extension=0.5,
        )
        total += math.exp(-value)

    assert total * (axis[1] - axis[0]) ** 2 == pytest.approx(1, rel=1e-3)


def random_case(
    lamps: int, interior: bool, mirrors: bool, n: int = 30
) -> tuple[Floats64, Floats64, dict[str, Any]]:
    rng = np.random.default_rng(10 * lamps + interior)
    size = lamps + lamps * (lamps - 1) // 2 + mirrors * lamps + interior + 1
    skew = rng.normal(0, 0.2, (n, 2, 2))
    weights = rng.dirichlet(np.ones(size))
    given: dict[str, Any] = {
        "x": rng.dirichlet(np.full(3, 4.0), n),
        "u": rng.uniform(0.1, 0.6, (n, 2)),
        "weights": weights,
        "whitener": np.eye(2) + skew,
        "sigma": rng.uniform(0.02, 0.1, n),
        "worth": rng.uniform(0.5, 2, n),
        "interior": interior,
        "mirrored": mirrors * np.array([0.25, 0.4, 0.35]),
    }
    matrices = np.array([lamp(corner) for corner in (*CORNERS, (0.4, 0.45))[:lamps]])
    return matrices + rng.normal(0, 0.1, matrices.shape), weights, given


MIXTURES = pytest.mark.parametrize(
    ("lamps", "interior", "mirrors"),
    [
        (1, False, False),
        (1, False, True),
        (2, False, False),
        (2, False, True),
        (3, False, False),
        (3, True, False),
        (3, True, True),
        (4, False, False),
    ],
)


@MIXTURES
@pytest.mark.parametrize("extension", [0.0, 0.5])
@pytest.mark.parametrize("n", [1, 300])
def test_the_compiled_mixture_is_that_of_the_definition(
    lamps: int, interior: bool, mirrors: bool, extension: float, n: int
) -> None:
    matrices, _, given = random_case(lamps, interior, mirrors, n)

    assert_as_defined(matrices, extension=extension, area_power=0.2, **given)


@MIXTURES
@pytest.mark.parametrize("factor", [1e-4, 0.01, 30.0])
def test_small_and_large_deviations_are_those_of_the_definition(
    lamps: int, interior: bool, mirrors: bool, factor: float
) -> None:
    matrices, _, given = random_case(lamps, interior, mirrors, 200)
    given["sigma"] *= factor

    assert_as_defined(matrices, extension=0.5, **given)


@MIXTURES
def test_far_outliers_are_those_of_the_definition(
    lamps: int, interior: bool, mirrors: bool
) -> None:
    matrices, weights, given = random_case(lamps, interior, mirrors, 40)
    given["u"][::2] += 100.0

    assert_as_defined(matrices, **given)
    weights[-1] = 0.0  # nothing explains them
    assert_as_defined(matrices, **given)


@MIXTURES
def test_lamps_alike_are_those_of_the_definition(lamps: int, interior: bool, mirrors: bool) -> None:
    matrices, _, given = random_case(lamps, interior, mirrors, 40)
    matrices[-1] = matrices[0]

    assert_as_defined(matrices, **given)


@MIXTURES
def test_no_data_are_worth_nothing(lamps: int, interior: bool, mirrors: bool) -> None:
    matrices, _, given = random_case(lamps, interior, mirrors, 0)

    value, gradient, counts = evaluate(matrices, **given)

    assert value == 0
    assert not gradient.any()
    assert not counts.any()


@MIXTURES
@pytest.mark.parametrize("extension", [0.0, 0.5])
def test_the_gradient_is_that_of_differences(
    lamps: int, interior: bool, mirrors: bool, extension: float
) -> None:
    matrices, _, given = random_case(lamps, interior, mirrors)
    _, gradient, _ = evaluate(matrices, extension=extension, **given)

    for place in np.ndindex(matrices.shape):
        step = np.zeros_like(matrices)
        step[place] = 1e-6
        up, down = (
            evaluate(matrices + sign * step, extension=extension, **given)[0] for sign in (1, -1)
        )
        assert gradient[place] == pytest.approx((up - down) / 2e-6, rel=1e-4, abs=1e-4)


@MIXTURES
def test_counts_sum_to_the_weights_of_the_data(lamps: int, interior: bool, mirrors: bool) -> None:
    matrices, weights, given = random_case(lamps, interior, mirrors)

    _, _, counts = evaluate(matrices, **given)

    assert counts.shape == weights.shape
    assert (counts > 0).all()
    assert counts.sum() == pytest.approx(given["worth"].sum())


@pytest.mark.parametrize("lamp_of_two", [0, 1])
def test_a_mirror_has_the_colour_of_its_lamp_whatever_the_surface(lamp_of_two: int) -> None:
    matrices = np.array([lamp(corner) for corner in CORNERS[:2]])
    point = np.array([CORNERS[lamp_of_two]])
    weights = np.eye(6)[3 + lamp_of_two]

    for surface in ([0.7, 0.2, 0.1], [0.1, 0.3, 0.6]):
        value, _, counts = evaluate(matrices, np.array([surface]), point, weights, mirrored=GREY)

        assert value == pytest.approx(math.log(2 * math.pi * S**2))
        assert counts[3 + lamp_of_two] == pytest.approx(1)


@pytest.mark.parametrize("lamps", [2, 3])
def test_corners_at_one_place_are_no_error(lamps: int) -> None:
    matrices = np.tile(lamp(CORNERS[0]), (lamps, 1, 1))
    weights = np.full(4 if lamps == 2 else 8, 0.1)
    u = np.array([CORNERS[0], (0.21, 0.3), (0.9, 0.1)])

    value, gradient, counts = evaluate(matrices, np.tile(GREY, (3, 1)), u, weights)

    assert np.isfinite(value)
    assert np.isfinite(gradient).all()
    assert counts.sum() == pytest.approx(3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lamp_whose_light_sums_to_nothing_is_no_error(sign: float) -> None:
    matrices = sign * np.diag([1.0, 1.0, -2.0])[None]

    value, gradient, _ = evaluate(
        matrices, GREY[None], np.array([[0.3, 0.3]]), np.array([0.9, 0.1])
    )

    assert value == pytest.approx(-math.log(0.1 * 1.5))
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("total", [0.01, -0.01, 0.025, -0.025])
def test_little_light_counts_as_a_fiftieth_with_its_sign(total: float) -> None:
    matrices = np.diag([1.0, 1.0, 3 * total - 2])[None]
    place = 1 / 3 / math.copysign(max(abs(total), 0.02), total)
    u = np.array([[place, place + S]])

    value, _, _ = evaluate(matrices, GREY[None], u, np.array([1.0, 0.0]))

    assert value == pytest.approx(math.log(2 * math.pi * S**2) + 0.5)
    assert_as_defined(matrices, GREY[None], u, np.array([1.0, 0.0]))
