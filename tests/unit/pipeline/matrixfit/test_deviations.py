from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit.chromaticities import Chromaticities, nothing
from pipeline.matrixfit.deviations import (
    Deviations,
    find_deviations,
    monomials,
    no_deviations,
)
from pipeline.matrixfit.evidence import Evidence
from pipeline.pair.reduced import ReducedPair
from tests.definitions.pixels import deviating_light

LAMPS = np.array([np.diag([0.9, 0.5, 0.2]), np.diag([0.3, 0.5, 0.9]), np.diag([0.3, 0.9, 0.3])])
SIZE = (60, 90)
EVEN = np.ones(3)


def surfaces(seed: int = 5) -> Floats64:
    """Flash colours (60, 90, 3) of squares of 3 × 3 pixels, all of them unlike."""
    colours = np.random.default_rng(seed).dirichlet((6, 6, 6), (20, 30))
    return np.asarray(np.kron(colours, np.ones((3, 3, 1))))


def shades(lamps: int) -> Floats64:
    """Shares (N, 60, 90) that change evenly, of each lamp in another direction."""
    y, x = np.mgrid[0:1:60j, 0:1:90j]
    return np.stack([0.2 + x, 1.2 - x, 0.2 + y])[:lamps]


def true_deviations(flash: Floats64, lamps: int) -> Floats64:
    """(N, 60, 90, 3), of surfaces that reflect up to a few percent more or less of each lamp."""
    red, green = flash[..., 0] - 1 / 3, flash[..., 1] - 1 / 3
    bent = np.stack([red * green, green**2 - red**2, red**2 - 0.5 * green], axis=-1) / 5
    return np.stack([bent, -bent[..., ::-1], 0.7 * bent[..., [1, 2, 0]]])[:lamps]


def pair_of(flash: Floats64, light: Floats64, variance: float = 1e-9) -> ReducedPair:
    quiet = np.full((*SIZE, 3), variance, np.float32)
    usable = np.ones(SIZE, bool)
    return ReducedPair(
        light.astype(np.float32), flash.astype(np.float32), quiet, quiet, usable, 1, False
    )


def evidence_of(differences: Chromaticities) -> Evidence:
    return Evidence(
        nothing(), differences, nothing(), nothing(), 0.1 if len(differences) else 0.0, 0.0
    )


def shown_alone(responses: Floats64, flash: Floats64) -> Chromaticities:
    """Differences across edges of shadows that show each lamp alone, on each third square."""
    x = flash[1::9, 1::9].reshape(-1, 3)
    light = responses[:, 1::9, 1::9].reshape(len(responses), -1, 3)
    u = light[..., :2] / light.sum(axis=2, keepdims=True)
    n = len(responses) * len(x)
    return Chromaticities(
        np.tile(x, (len(responses), 1)), u.reshape(-1, 2), np.full((n, 3), 1e-8), np.ones(n)
    )


def error(found: Floats64, wanted: Floats64) -> float:
    """Root mean square of responses (N, …, 3), each lamp's scaled as it may be, relative."""
    scale = (found * wanted).sum(axis=(1, 2, 3)) / np.square(found).sum(axis=(1, 2, 3))
    off = scale[:, None, None, None] * found - wanted
    return float(np.sqrt(np.square(off).mean() / np.square(wanted).mean()))


def by_matrices(count: int) -> tuple[Floats64, Floats64, Floats64]:
    """Flash colours (60, 90, 3), matrices of so many lamps, and what they give (N, 60, 90, 3)."""
    flash, lamps = surfaces(), LAMPS[:count]
    return flash, lamps, np.einsum("jkl,hwl->jhwk", lamps, flash)


def mixed(responses: Floats64) -> Floats64:
    """The lamps' light together, (60, 90, 3)."""
    return np.asarray((shades(len(responses))[..., None] * responses).sum(axis=0))


@pytest.mark.parametrize("count", [2, 3])
def test_neighbours_and_edges_tell_what_matrices_lack(count: int) -> None:
    flash, lamps, straight = by_matrices(count)
    wanted = straight + true_deviations(flash, count)
    light = mixed(wanted)
    evidence = evidence_of(shown_alone(wanted, flash))

    found = find_deviations(pair_of(flash, light), evidence, lamps, EVEN)

    assert error(straight, wanted) > 0.03
    assert error(straight + deviating_light(flash, found), wanted) < 0.6 * error(straight, wanted)


@pytest.mark.parametrize("count", [2, 3])
def test_right_matrices_are_left_as_they_are(count: int) -> None:
    flash, lamps, straight = by_matrices(count)
    light = mixed(straight)
    evidence = evidence_of(shown_alone(straight, flash))

    found = find_deviations(pair_of(flash, light), evidence, lamps, EVEN)

    assert error(straight + deviating_light(flash, found), straight) < 0.003


@pytest.mark.parametrize("count", [2, 3])
def test_what_may_be_noise_counts_the_less_for_it(count: int) -> None:
    """Noise of the photograph alone; edges of shadows say that the matrices are right."""
    flash, lamps, straight = by_matrices(count)
    wanted = straight + true_deviations(flash, count)
    light = mixed(wanted)
    evidence = evidence_of(shown_alone(straight, flash))
    clear = pair_of(flash, light)
    noisy = replace(clear, no_flash_variance=np.full_like(clear.no_flash_variance, 0.1))

    quiet, loud = (find_deviations(one, evidence, lamps, EVEN) for one in (clear, noisy))

    changed = error(straight + deviating_light(flash, quiet), straight)
    assert error(straight + deviating_light(flash, loud), straight) < 0.2 * changed


def test_colours_that_noise_sets_apart_tell_nothing() -> None:
    flash, lamps, straight = by_matrices(2)
    light = mixed(straight + true_deviations(flash, 2))
    clear = pair_of(flash, light)
    noisy = replace(clear, flash_variance=np.full_like(clear.flash_variance, 0.1**2 / 3))
    evidence = evidence_of(shown_alone(straight, flash))

    assert find_deviations(clear, evidence, lamps, EVEN).terms.any()
    assert not find_deviations(noisy, evidence, lamps, EVEN).terms.any()


def test_where_the_flash_part_may_be_misplaced_surfaces_are_compared_beyond_their_edges() -> None:
    """Squares of 6 × 6 pixels, whose outermost ones may show the colours beside them."""
    flash: Floats64 = np.kron(surfaces()[1:30:3, 1:45:3], np.ones((6, 6, 1))).astype(np.float64)
    lamps = LAMPS[:2]
    straight = np.einsum("jkl,hwl->jhwk", lamps, flash)
    wanted = straight + true_deviations(flash, 2)
    y, x = np.mgrid[:60, :90] % 6
    beside_edge = np.isin(x, (0, 5)) | np.isin(y, (0, 5))
    variance = np.where(beside_edge, 0.2**2, 1e-9)[..., None] * np.ones(3)
    side_by_side = replace(
        pair_of(flash, mixed(wanted)), flash_variance=variance.astype(np.float32)
    )
    evidence = evidence_of(shown_alone(wanted, flash))

    apart = find_deviations(replace(side_by_side, offset=0.35), evidence, lamps, EVEN)

    assert not find_deviations(side_by_side, evidence, lamps, EVEN).terms.any()
    assert error(straight + deviating_light(flash, apart), wanted) < 0.7 * error(straight, wanted)


@pytest.mark.parametrize("shape", [(1, 90), (60, 1), (4, 5)])
def test_pictures_smaller_than_the_step_between_neighbours_have_none(
    shape: tuple[int, int],
) -> None:
    flash = surfaces()[: shape[0], : shape[1]]
    quiet = np.full((*shape, 3), 1e-9, np.float32)
    light = np.einsum("jkl,hwl->hwk", LAMPS[:2], flash).astype(np.float32)
    usable = np.ones(shape, bool)
    small = ReducedPair(
        light, flash.astype(np.float32), quiet, quiet, usable, 1, False, offset=0.35
    )

    found = find_deviations(small, evidence_of(nothing()), LAMPS[:2], EVEN)

    np.testing.assert_array_equal(found.terms, np.zeros((2, 3, 10)))


def test_what_a_matrix_can_say_is_left_to_it() -> None:
    """Other matrices would mend it: 3 % more green of one lamp, 3 % less of the other."""
    flash, lamps, straight = by_matrices(2)
    wanted = straight * np.array([[1, 1.03, 1], [1, 0.97, 1]])[:, None, None]
    light = mixed(wanted)

    found = find_deviations(
        pair_of(flash, light), evidence_of(shown_alone(wanted, flash)), lamps, EVEN
    )

    assert np.abs(deviating_light(flash, found)).mean() < 0.01 * straight.mean()


@pytest.mark.parametrize("count", [2, 3])
def test_neither_exposure_nor_channel_weights_change_what_is_found(count: int) -> None:
    """Weights settle what counts where not all can be explained; here nearly all can."""
    flash, lamps, straight = by_matrices(count)
    wanted = straight + true_deviations(flash, count)
    light = mixed(wanted)
    evidence = evidence_of(shown_alone(wanted, flash))

    def found(exposure: float, weights: Floats64) -> Deviations:
        pair = pair_of(exposure * flash, exposure * light, 1e-9 * exposure**2)
        noise = np.full_like(pair.no_flash_variance, 1e-3 * exposure**2)
        pair = replace(pair, no_flash_variance=noise)
        return find_deviations(pair, evidence, lamps, weights)

    np.testing.assert_allclose(
        found(0.01, EVEN).terms, found(1.0, EVEN).terms, rtol=1e-3, atol=1e-7
    )
    for weights in (EVEN, np.array([3.0, 1.0, 5.0])):
        told = deviating_light(flash, found(1.0, weights))
        assert error(straight + told, wanted) < 0.7 * error(straight, wanted)


def test_two_lamps_give_all_light_that_there_is() -> None:
    """Surfaces give green that no mixture of the lamps has, and edges of shadows do not show it."""
    flash, lamps, straight = by_matrices(2)
    off = np.cross(straight[0], straight[1])
    off = off / np.linalg.norm(off, axis=2, keepdims=True)
    bent = np.square(flash[..., :1] - 1 / 3) * off
    light = mixed(straight + bent)
    evidence = evidence_of(shown_alone(straight, flash))

    found = deviating_light(flash, find_deviations(pair_of(flash, light), evidence, lamps, EVEN))

    along = [float((one * bent).sum() / np.square(bent).sum()) for one in found]
    assert min(along) > 0.04


@pytest.mark.parametrize("count", [2, 3])
def test_shadows_and_things_that_end_where_colours_do_count_for_little(count: int) -> None:
    """In every fourth row of squares a lamp is six times weaker than beside it."""
    flash, lamps, straight = by_matrices(count)
    shares = shades(count).copy()
    for top in range(0, 60, 12):
        shares[0, top : top + 3] /= 6
    light = (shares[..., None] * straight).sum(axis=0)

    evidence = evidence_of(shown_alone(straight, flash))

    found = find_deviations(pair_of(flash, light), evidence, lamps, EVEN)

    # 0.15 if all counted alike
    assert error(straight + deviating_light(flash, found), straight) < 0.005


def test_channel_weights_settle_what_light_counts() -> None:
    """Blue that no lamp gives changes deviations the less, the less blue counts."""
    flash, lamps, straight = by_matrices(2)
    light = mixed(straight)
    light[..., 2] += 0.02

    def blue(weight: float) -> float:
        weights = np.array([1.0, 1.0, weight])
        evidence = evidence_of(shown_alone(straight, flash))
        found = find_deviations(pair_of(flash, light), evidence, lamps, weights)
        return float(np.abs(deviating_light(flash, found)[..., :2]).max())

    assert blue(0.01) < 0.4 * blue(1.0)


@pytest.mark.parametrize("what", ["one lamp", "one colour", "nothing usable", "no edges"])
def test_where_nothing_tells_there_are_no_deviations(what: str) -> None:
    flash = surfaces()
    count = 1 if what == "one lamp" else 2
    if what == "one colour":
        flash = np.full_like(flash, 1 / 3)
    light = np.einsum("jkl,hwl->hwk", LAMPS[:count], flash)
    pair = pair_of(flash, light)
    if what == "nothing usable":
        pair.usable[:] = False

    found = find_deviations(pair, evidence_of(nothing()), LAMPS[:count], EVEN)

    np.testing.assert_array_equal(found.terms, np.zeros((count, 3, 10)))


def test_light_is_the_polynomial_times_the_flash() -> None:
    terms = np.arange(60).reshape(2, 3, 10) / 100
    deviations = Deviations(np.array([0.3, 0.4]), np.array([0.1, 0.05]), terms)
    flash = np.array([[0.8, 0.7, 0.5]])  # chromaticity .4, .35: q = 1, −1

    expected = terms @ np.array([1, 1, 1, 1, -1, -1, -1, 1, 1, -1]) * 2.0

    np.testing.assert_allclose(deviating_light(flash, deviations)[:, 0], expected, rtol=1e-6)


def test_polynomials_go_on_no_further_than_three_deviations() -> None:
    far, farther = monomials(np.array([[3.0, -3.0], [7.0, -5.0]]))

    np.testing.assert_array_equal(far, [1, 3, 9, 27, -3, -9, -27, 9, 27, -27])
    np.testing.assert_array_equal(far, farther)


@pytest.mark.parametrize("flash", [(0.0, 0.0, 0.0), (-0.2, 0.05, 0.05)])
def test_without_light_of_the_flash_nothing_is_added(flash: tuple[float, float, float]) -> None:
    terms = np.ones((2, 3, 10))
    deviations = Deviations(np.zeros(2), np.ones(2), terms)

    np.testing.assert_array_equal(
        deviating_light(np.array([flash]), deviations), np.zeros((2, 1, 3))
    )


def test_no_deviations_add_nothing() -> None:
    np.testing.assert_array_equal(
        deviating_light(surfaces(), no_deviations(3)), np.zeros((3, *SIZE, 3))
    )
