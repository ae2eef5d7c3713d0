from __future__ import annotations

import numpy as np
import pytest

from drivers.sim import spectra
from drivers.sim.address import SimulatedCamera
from drivers.sim.studio import Studio, mosaic


def studio(**options: object) -> Studio:
    fields = {"width": 300, "height": 200, **options}
    return Studio(SimulatedCamera.model_validate(fields))


def test_the_mosaic_takes_rggb() -> None:
    image = np.arange(4 * 4 * 3, dtype=np.float32).reshape(4, 4, 3)
    seen = mosaic(image)
    assert (seen[::2, ::2] == image[::2, ::2, 0]).all()
    assert (seen[::2, 1::2] == image[::2, 1::2, 1]).all()
    assert (seen[1::2, ::2] == image[1::2, ::2, 1]).all()
    assert (seen[1::2, 1::2] == image[1::2, 1::2, 2]).all()


@pytest.mark.parametrize("lights", [1, 2, 3])
@pytest.mark.parametrize("scene", ["studio", "objects"])
def test_nothing_is_clipped_and_little_wasted(scene: str, lights: int) -> None:
    truth = studio(scene=scene, lights=lights).truth()
    brightest = (truth.layers.sum(0) + truth.flash).max(-1)
    assert (brightest > 1).mean() < 0.001
    assert brightest.max() == pytest.approx(0.92, abs=0.03)
    assert np.median(truth.flash[..., 1][brightest > 0.01]) > 0.02


@pytest.mark.parametrize("lights", [2, 3])
def test_every_lamp_has_places_of_its_own(lights: int) -> None:
    green = studio(lights=lights).truth().layers[..., 1]
    share = green / np.maximum(green.sum(0), 1e-6)
    for lamp in range(lights):
        assert ((share[lamp] > 0.99) & (green[lamp] > 0.02)).mean() > 0.005


def test_the_truth_is_consistent() -> None:
    truth = studio(lights=3).truth()
    assert truth.layers.shape == (3, 200, 300, 3)
    assert truth.layers.dtype == np.float32
    assert truth.lamps == ("incandescent", "white LED", "xenon off a green card")
    assert np.allclose(np.linalg.norm(truth.directions, axis=1), 1)
    assert np.allclose(truth.rgb[:, 1], 0.18 * truth.strengths)
    assert truth.focal_px == pytest.approx(85 * np.hypot(300, 200) / np.hypot(36, 24))
    assert min(truth.layers.min(), truth.flash.min(), truth.white_balanced.min()) >= 0


def test_a_lamp_looks_the_same_in_company() -> None:
    alone = studio(lights=1).truth()
    company = studio(lights=2).truth()
    scale = company.strengths[0] / alone.strengths[0]  # each is metered for itself
    difference = np.abs(company.layers[0] - alone.layers[0] * scale)
    assert difference.max() < 0.05  # the other lamp's shadows add pixels that are sampled finely
    assert (difference < 1e-6).mean() > 0.95


def test_white_balance_keeps_the_green_of_grey() -> None:
    truth = studio(lights=2).truth()
    wall = np.s_[2:30, 2:60]  # neutral paper in full light
    assert np.allclose(
        truth.white_balanced[wall][..., 1], truth.layers.sum(0)[wall][..., 1], rtol=0.02
    )
    ratio = truth.white_balanced[wall] / truth.white_balanced[wall][..., 1:2]
    assert np.ptp(ratio, axis=(0, 1)).max() < 1e-3  # one colour of light everywhere


def test_paper_has_the_colour_of_what_shines_on_it() -> None:
    """Of every lamp as told by a grey card, of daylight where white is balanced, of the flash."""
    truth = studio(lights=3).truth()
    lit = [*truth.layers, truth.white_balanced, truth.flash]
    flash = spectra.sensitivities() @ spectra.flash()
    for light, white in zip(lit, [*truth.rgb, spectra.neutral(), flash], strict=True):
        paper = np.median(light[2:30, 2:60], axis=(0, 1))
        np.testing.assert_allclose(paper / paper[1], white / white[1], rtol=0.015)


def test_the_objects_shade_each_other_nowhere() -> None:
    truth = studio(scene="objects", lights=3).truth()
    seen = np.isfinite(truth.normals[..., 0])
    inner = seen & np.roll(seen, 3, 1) & np.roll(seen, -3, 1) & np.roll(seen, 3, 0)
    inner &= np.roll(seen, -3, 0)
    for layer, direction in zip(truth.layers[..., 1], truth.directions, strict=True):
        facing = inner & (truth.normals @ direction > 0.15)
        assert (layer[facing] > 0).all()
    every = (truth.normals @ truth.directions.T > 0.15).all(-1)
    assert (every & inner).sum() > 0.6 * inner.sum()


def test_the_objects_follow_lamberts_law_exactly() -> None:
    truth = studio(scene="objects", lights=3).truth()
    middle = np.nan_to_num(truth.normals[..., 2]) > 0.6
    shading = np.maximum(truth.normals[middle] @ truth.directions.T, 0)
    for lamp in range(3):
        lit = shading[:, lamp] > 0.3
        albedo = truth.layers[lamp][middle][lit] / shading[lit, lamp, None]
        assert np.ptp(albedo, axis=0).max() < 0.02 * albedo.max()


def test_the_paper_of_the_studio_is_one_material_on_floor_and_wall() -> None:
    """Under every lamp, whatever its direction in the axes of the tilted camera."""
    truth = studio(lights=3).truth()
    for layer, direction, strength in zip(
        truth.layers[..., 1], truth.directions, truth.strengths, strict=True
    ):
        for corner in (np.s_[2:20, 2:40], np.s_[180:198, 250:298]):
            paper = np.median(layer[corner] / (truth.normals[corner] @ direction)) / strength
            assert paper == pytest.approx(0.589, abs=0.005)


def test_the_sensor_sees_the_truth_through_its_mosaic() -> None:
    one = studio(lights=2)
    truth, (lamps, flash) = one.truth(), one.sensor_light()
    assert np.allclose(lamps, mosaic(truth.layers.sum(0)), atol=1e-6)
    assert np.allclose(flash, mosaic(truth.flash), atol=1e-6)
