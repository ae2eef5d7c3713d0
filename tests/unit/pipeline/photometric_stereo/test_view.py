from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats, Floats64
from pipeline.pair.reduced import ReducedPair
from pipeline.photometric_stereo.view import View, make_view
from tests.reduced_pairs import HEIGHT, WIDTH, even, left_and_right, reduced_pair


@pytest.mark.parametrize(("most", "step"), [(10**6, 1), (500, 3)])
def test_the_cameras_axis_goes_through_the_middle_of_the_photograph(most: int, step: int) -> None:
    """And not of its whole blocks, of which some are left over at the right and below."""
    reduced = replace(reduced_pair(even(0.3, 0.3, 0.3), even(0.2, 0.2, 0.2)), block=12)
    height, width = reduced.usable.shape
    wider = replace(reduced, dropped=(11, 7))

    view = make_view(wider, 1000.0, most)

    assert view.step == step
    side = 12 * step
    middle = np.array([12 * width + 11, 12 * height + 7]) / 2
    np.testing.assert_allclose(view.centre, middle / side - 0.5)
    assert view.focal == pytest.approx(1000 / side)


def grainy() -> ReducedPair:
    """Another light in every pixel, some of which are clipped and cannot be used."""
    random = np.random.default_rng(1)
    flash, light = random.uniform(0.2, 0.8, (2, HEIGHT, WIDTH, 3))
    flash_variance, light_variance = random.uniform(1e-6, 2e-6, (2, HEIGHT, WIDTH, 3))
    usable = random.random((HEIGHT, WIDTH)) < 0.7
    flash[~usable] = light[~usable] = 9.0
    return reduced_pair(
        light,
        flash,
        flash_variance=flash_variance,
        no_flash_variance=light_variance,
        usable=usable,
    )


def test_pictures_are_means_of_the_usable_pixels() -> None:
    """Of 3 × 3 pixels each; what is left over at the right and below is not looked at."""
    reduced = grainy()
    usable = reduced.usable[:39, :78].reshape(13, 3, 26, 3, 1)

    def means(picture: Floats) -> Floats64:
        blocks = picture[:39, :78].reshape(13, 3, 26, 3, 3)
        return np.asarray((blocks * usable).sum(axis=(1, 3)) / usable.sum(axis=(1, 3)))

    found = make_view(reduced, 1000.0, 300)

    assert found.step == 3
    np.testing.assert_array_equal(found.mask, usable.mean(axis=(1, 3))[..., 0] >= 0.5)
    assert 0 < (~found.mask).sum() < 100
    np.testing.assert_allclose(found.flash[found.mask], means(reduced.flash)[found.mask])
    np.testing.assert_allclose(found.light[found.mask], means(reduced.no_flash)[found.mask])
    for variance, of_pixels in (
        (found.flash_variance, reduced.flash_variance),
        (found.light_variance, reduced.no_flash_variance),
    ):
        np.testing.assert_allclose(variance[found.mask], means(of_pixels)[found.mask] / 3)


@pytest.mark.parametrize(("light", "gain"), [(0.1, 0.5), (-0.1, 0.0), (2.0, 5.0)])
def test_noise_of_the_flash_counts_by_how_bright_the_lamps_are_beside_it(
    light: float, gain: float
) -> None:
    pair = reduced_pair(
        even(light, light, light),
        even(0.2, 0.2, 0.2),
        no_flash_variance=1e-6,
        flash_variance=3e-6,
    )
    view = make_view(pair, 1000.0, 10**6)

    scene = view.scene(np.eye(3), (), view.materials())

    np.testing.assert_allclose(scene.light, light)
    np.testing.assert_allclose(scene.flash, 0.2)
    # the part is a difference, so that what noise adds to the lamps' light is missing in it
    np.testing.assert_allclose(scene.variance, 1e-6 + gain**2 * 3e-6 + 2 * gain * 1e-6)

    alone = make_view(replace(pair, flash_only=True), 1000.0, 10**6).scene(
        np.eye(3), (), view.materials()
    )

    np.testing.assert_allclose(alone.variance, 1e-6 + gain**2 * 3e-6)


def test_materials_are_colours_of_the_flash_and_as_wide_as_its_noise() -> None:
    def of_noise(relative: float) -> View:
        flash = left_and_right(even(0.2, 0.4, 0.4), even(0.5, 0.25, 0.25))
        variance = (relative * flash.sum(axis=2, keepdims=True)) ** 2 / 3
        return make_view(
            reduced_pair(even(0.3, 0.3, 0.3), flash, flash_variance=variance), 1000.0, 10**6
        )

    clear, noisy = (of_noise(relative).materials() for relative in (0.0, 0.02))

    assert sorted(map(tuple, np.round(clear.centres, 9))) == [(0.2, 0.4), (0.5, 0.25)]
    assert clear.radius == pytest.approx(0.008)
    assert noisy.radius == pytest.approx(0.018)
