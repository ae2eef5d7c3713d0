from __future__ import annotations

import numpy as np
import pytest

from pipeline.matrixfit.evidence import gather_evidence
from tests.reduced_pairs import HEIGHT, WIDTH, even, left_and_right, reduced_pair

CENTRED = np.eye(3) - 1 / 3


def test_differences_are_the_lamp_that_is_shadowed() -> None:
    """On grey, the right half lacks a lamp of (0.3, 0.2, 0.1): 40 pairs, and the oblique ones."""
    lamp = np.array([0.3, 0.2, 0.1])
    rest = even(0.2, 0.3, 0.3)

    found = gather_evidence(
        reduced_pair(left_and_right(rest + lamp, rest), even(0.5, 0.5, 0.5), flash_only=True)
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

    found = gather_evidence(reduced_pair(light, even(flash, flash, flash))).differences

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
        flash_only=True,
    )

    found = gather_evidence(pair).differences

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

    assert (
        bool(len(gather_evidence(reduced_pair(light, flash, flash_only=True)).differences)) is some
    )


@pytest.mark.parametrize("drop", [0.05, 0.6])
def test_differences_are_steps_of_some_size(drop: float) -> None:
    whole = even(0.5, 0.5, 0.4)
    pair = reduced_pair(
        left_and_right(whole, (1 - drop) * whole), even(0.5, 0.5, 0.5), flash_only=True
    )

    assert bool(len(gather_evidence(pair).differences)) is (drop == 0.6)


@pytest.mark.parametrize(
    ("drop", "noise", "some"),
    [(0.15, 0.03, False), (0.15, 0.003, True), (0.25, 0.03, True)],
)
def test_steps_of_bright_light_are_a_fifth_of_it_or_beyond_noise(
    drop: float, noise: float, some: bool
) -> None:
    """In a pool of light five times as bright as what is around it, on another surface.

    noise: relative, of the strength of the flash part.
    """
    light, flash = even(0.1, 0.1, 0.08), even(0.5, 0.5, 0.5)
    light[:, -12:-6], light[:, -6:] = 5 * light[:, -12:-6], 5 * (1 - drop) * light[:, -6:]
    flash[:, :-12] = (0.6, 0.5, 0.4)
    pair = reduced_pair(light, flash, flash_only=True, flash_variance=0.75 * noise**2)

    assert bool(len(gather_evidence(pair).differences)) is some


@pytest.mark.parametrize(("columns", "some"), [(1, True), (2, False), (4, False)])
def test_differences_are_of_steps_that_end(columns: int, some: bool) -> None:
    """Where the light goes on changing, a surface bends and all lamps change."""
    fall = np.clip((np.arange(WIDTH) - WIDTH // 2) / columns + 1, 0, 1)[None, :, None]
    pair = reduced_pair(
        (1 - 0.8 * fall) * even(0.5, 0.5, 0.4), even(0.5, 0.5, 0.5), flash_only=True
    )

    assert bool(len(gather_evidence(pair).differences)) is some
