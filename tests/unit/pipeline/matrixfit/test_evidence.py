from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.matrixfit.evidence import Data, gather_evidence
from pipeline.reduced import ReducedPair

Array = NDArray[np.float64]

HEIGHT, WIDTH = 40, 80  # so that differences are of pixels next to each other
CENTRED = np.eye(3) - 1 / 3


def reduced_pair(no_flash: Any, flash: Any, **more: Any) -> ReducedPair:
    given: dict[str, Any] = {
        "no_flash_variance": np.zeros_like(no_flash),
        "flash_variance": np.zeros_like(flash),
        "usable": np.ones(no_flash.shape[:2], bool),
        "block": 1,
        "rendered": False,
    }
    given.update({k: np.broadcast_to(v, no_flash.shape) for k, v in more.items() if k != "usable"})
    if "usable" in more:
        given["usable"] = more["usable"]
    return ReducedPair(no_flash=no_flash, flash=flash, **given)


def even(*rgb: float) -> Array:
    return np.tile(np.array(rgb), (HEIGHT, WIDTH, 1))


def left_and_right(left: Array, right: Array) -> Array:
    return np.where(np.arange(WIDTH)[None, :, None] < WIDTH // 2, left, right)


def test_pixels_are_chromaticities_of_light_and_flash() -> None:
    found = gather_evidence(reduced_pair(even(0.4, 0.3, 0.1), even(0.2, 0.5, 0.3)), True).pixels

    assert len(found) == HEIGHT * WIDTH
    np.testing.assert_allclose(found.x, np.tile([0.2, 0.5, 0.3], (len(found), 1)))
    np.testing.assert_allclose(found.u, np.tile([0.5, 0.375], (len(found), 1)))
    assert found.weight.sum() == pytest.approx(400)


@pytest.mark.parametrize("flash_only", [True, False])
def test_noise_of_grey_pixels_is_known(flash_only: bool) -> None:
    """Light a and flash part b, both grey: variances v over (3a)² and (3b)², off the diagonal."""
    a, b, v_n, v_f = 0.4, 0.5, 1e-5, 3e-5
    pair = reduced_pair(even(a, a, a), even(b, b, b), no_flash_variance=v_n, flash_variance=v_f)

    found = gather_evidence(pair, flash_only).pixels

    size = v_n / a**2 + v_f / b**2 + (0 if flash_only else 2 * v_n / (a * b))
    expected = CENTRED[[0, 0, 1], [0, 1, 1]] * size / 9
    np.testing.assert_allclose(found.covariance, np.tile(expected, (len(found), 1)), rtol=1e-9)


@pytest.mark.parametrize("flash_only", [True, False])
def test_noise_of_coloured_pixels_is_what_it_does_to_them(flash_only: bool) -> None:
    rng = np.random.default_rng(2)
    n, f = np.array([0.5, 0.3, 0.2]), np.array([0.3, 0.4, 0.35])
    v_n, v_f = np.array([1e-6, 2e-6, 3e-6]), np.array([5e-6, 6e-6, 4e-6])
    pair = reduced_pair(even(*n), even(*f), no_flash_variance=v_n, flash_variance=v_f)
    noise_n = rng.normal(0, np.sqrt(v_n), (200_000, 3))
    if flash_only:
        noise_f = rng.normal(0, np.sqrt(v_f), noise_n.shape)
    else:  # the photograph with the flash less the one without
        noise_f = rng.normal(0, np.sqrt(v_f - v_n), noise_n.shape) - noise_n
    x, u = f / f.sum(), n / n.sum()
    noisy_x, noisy_u = (
        (one + noise) / (one + noise).sum(axis=1, keepdims=True)
        for one, noise in ((f, noise_f), (n, noise_n))
    )
    # the lamp that gives u on x gives this on the noisy flash colour
    predicted = u / x * noisy_x
    residual = noisy_u - predicted / predicted.sum(axis=1, keepdims=True)
    true = np.cov(residual[:, :2].T)

    found = gather_evidence(pair, flash_only).pixels.covariance[0]

    np.testing.assert_allclose(found, true[[0, 0, 1], [0, 1, 1]], atol=0.02 * true.max())


def test_no_photograph_is_better_than_its_least_noise() -> None:
    found = gather_evidence(reduced_pair(even(0.4, 0.4, 0.4), even(0.5, 0.5, 0.5)), True).pixels

    np.testing.assert_allclose(found.covariance[:, 0], 2 / 3 * 2 * 1.5e-4**2)


def test_pixels_that_are_not_usable_or_dark_are_left_out() -> None:
    light, flash = even(0.4, 0.3, 0.1), even(0.2, 0.5, 0.3)
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[:10] = False
    light[10:15] *= 0.004
    flash[15:20] *= 0.009

    found = gather_evidence(reduced_pair(light, flash, usable=usable), True).pixels

    assert len(found) == 20 * WIDTH


def test_nothing_usable_is_no_evidence() -> None:
    pair = reduced_pair(
        even(0.4, 0.3, 0.1), even(0.2, 0.5, 0.3), usable=np.zeros((HEIGHT, WIDTH), bool)
    )

    found = gather_evidence(pair, False)

    assert len(found.pixels) == len(found.differences) == 0
    assert found.difference_share == 0


def test_differences_are_the_lamp_that_is_shadowed() -> None:
    """On grey, the right half lacks a lamp of (0.3, 0.2, 0.1): 40 pairs, and the oblique ones."""
    lamp = np.array([0.3, 0.2, 0.1])
    rest = even(0.2, 0.3, 0.3)

    found = gather_evidence(
        reduced_pair(left_and_right(rest + lamp, rest), even(0.5, 0.5, 0.5)), True
    )

    data = found.differences
    assert len(data) >= HEIGHT
    np.testing.assert_allclose(data.x, np.full((len(data), 3), 1 / 3))
    np.testing.assert_allclose(data.u, np.tile(lamp[:2] / lamp.sum(), (len(data), 1)))
    assert found.difference_share == pytest.approx(len(data) / (HEIGHT * WIDTH))
    assert data.weight.sum() == pytest.approx(250 * len(data) / 600)


@pytest.mark.parametrize("flash", [0.5, 0.05, 0.02])
def test_differences_under_a_dim_flash_have_covariances(flash: float) -> None:
    """The flash part is a difference: it cannot be less noisy than the photograph."""
    lamp, rest = np.array([0.2, 0.1, 0.1]), even(0.7, 0.05, 0.05)
    light = left_and_right(rest + lamp, rest)

    found = gather_evidence(reduced_pair(light, even(flash, flash, flash)), False).differences

    assert len(found) >= HEIGHT
    xx, xy, yy = found.covariance.T
    assert (xx > 0).all()
    assert (yy > 0).all()
    assert (xx * yy > xy * xy).all()


def test_noise_of_grey_differences_is_known() -> None:
    a, less, b, v_n, v_f = 0.6, 0.3, 0.5, 1e-6, 3e-6
    pair = reduced_pair(
        left_and_right(even(a, a, a), even(less, less, less)),
        even(b, b, b),
        no_flash_variance=v_n,
        flash_variance=v_f,
    )

    found = gather_evidence(pair, True).differences

    size = 2 * v_n / (a - less) ** 2 + v_f / (2 * b**2)
    expected = CENTRED[[0, 0, 1], [0, 1, 1]] * size / 9
    np.testing.assert_allclose(found.covariance, np.tile(expected, (len(found), 1)), rtol=1e-6)


@pytest.mark.parametrize(
    ("right_flash", "some"),
    [
        ((0.5, 0.5, 0.5), True),
        ((0.505, 0.5, 0.495), True),
        ((0.55, 0.5, 0.45), False),
        ((0.56, 0.56, 0.56), True),
        ((0.6, 0.6, 0.6), False),
    ],
)
def test_differences_are_of_one_surface_only(
    right_flash: tuple[float, float, float], some: bool
) -> None:
    """The flash shows both sides alike in colour, and nearly in brightness."""
    light = left_and_right(even(0.5, 0.5, 0.4), even(0.2, 0.3, 0.3))
    flash = left_and_right(even(0.5, 0.5, 0.5), even(*right_flash))

    assert bool(len(gather_evidence(reduced_pair(light, flash), True).differences)) is some


@pytest.mark.parametrize("drop", [0.05, 0.6])
def test_differences_are_steps_of_some_size(drop: float) -> None:
    whole = even(0.5, 0.5, 0.4)
    pair = reduced_pair(left_and_right(whole, (1 - drop) * whole), even(0.5, 0.5, 0.5))

    assert bool(len(gather_evidence(pair, True).differences)) is (drop == 0.6)


@pytest.mark.parametrize(("columns", "some"), [(1, True), (2, False), (4, False)])
def test_differences_are_of_steps_that_end(columns: int, some: bool) -> None:
    """Where the light goes on changing, a surface bends and all lamps change."""
    fall = np.clip((np.arange(WIDTH) - WIDTH // 2) / columns + 1, 0, 1)[None, :, None]
    pair = reduced_pair((1 - 0.8 * fall) * even(0.5, 0.5, 0.4), even(0.5, 0.5, 0.5))

    assert bool(len(gather_evidence(pair, True).differences)) is some


def two_brightnesses(share: float = 0.5) -> ReducedPair:
    """Of 10,000 pixels, those on the left have four times the light; flash colours differ."""
    left = np.arange(100)[None, :, None] < 100 * share
    flash = np.where(left, [0.4, 0.3, 0.3], [0.3, 0.4, 0.3]) * np.ones((100, 100, 1))
    return reduced_pair(np.where(left, 0.8, 0.2) * flash, flash)


def test_pixels_are_drawn_by_the_root_of_their_light() -> None:
    found = gather_evidence(two_brightnesses(), True).pixels

    assert len(found) == 3600
    assert (found.x[:, 0] > found.x[:, 1]).sum() == pytest.approx(2400, abs=2)
    np.testing.assert_allclose(found.weight, 400 / 3600)


def test_drawing_is_the_same_every_time() -> None:
    first, second = (gather_evidence(two_brightnesses(0.3), True).pixels for _ in range(2))

    np.testing.assert_array_equal(first.x, second.x)
    np.testing.assert_array_equal(first.u, second.u)


def test_rare_light_is_drawn_more_often() -> None:
    flash = np.full((100, 100, 3), 0.3)
    light = flash.copy()
    light[:4] = (0.6, 0.2, 0.1)  # of the same sum: 400 of 10,000 pixels

    found = gather_evidence(reduced_pair(light, flash), True).pixels

    rare, common = 400**-0.6 * 400, 9600**-0.6 * 9600
    drawn = (found.u[:, 0] > 0.5).sum()
    assert drawn == pytest.approx(min(3600 * rare / (rare + common), 400), abs=2)
    assert drawn > 2 * 3600 * 400 / 10_000


def test_noisy_pixels_are_left_out() -> None:
    light, flash = even(0.4, 0.4, 0.4), left_and_right(even(0.5, 0.5, 0.5), even(0.6, 0.5, 0.4))
    noise = left_and_right(even(*(0.03,) * 3), even(*(0.05,) * 3))  # relative to the whole light
    variance = (noise * 1.2) ** 2 / 3

    found = gather_evidence(reduced_pair(light, flash, no_flash_variance=variance), True).pixels

    assert len(found) == HEIGHT * WIDTH / 2
    np.testing.assert_allclose(found.x, 1 / 3)


def test_of_a_very_noisy_pair_the_least_noisy_pixels_are_taken() -> None:
    light, flash = even(0.4, 0.4, 0.4), left_and_right(even(0.5, 0.5, 0.5), even(0.6, 0.5, 0.4))
    noise = left_and_right(even(*(0.2,) * 3), even(*(0.3,) * 3))
    variance = (noise * 1.2) ** 2 / 3

    found = gather_evidence(reduced_pair(light, flash, no_flash_variance=variance), True).pixels

    assert len(found) == HEIGHT * WIDTH / 2
    np.testing.assert_allclose(found.x, 1 / 3)


@pytest.mark.parametrize("count", [1, 7, 99, 100, 500])
def test_thinned_data_keep_their_weight(count: int) -> None:
    rng = np.random.default_rng(0)
    data = Data(
        rng.uniform(size=(100, 3)),
        rng.uniform(size=(100, 2)),
        rng.uniform(size=(100, 3)),
        rng.uniform(size=100),
    )

    found = data.thinned(count)

    assert len(found) == min(count, 100)
    assert found.weight.sum() == pytest.approx(data.weight.sum())
    assert {tuple(u) for u in found.u} <= {tuple(u) for u in data.u}
