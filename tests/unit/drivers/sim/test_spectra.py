from __future__ import annotations

import numpy as np
import pytest

from drivers.sim import spectra
from drivers.sim.scene import load_scene


@pytest.mark.parametrize("name", ["studio", "objects"])
def test_every_spectrum_of_a_scene_exists(name: str) -> None:
    scene = load_scene(name)
    size = spectra.WAVELENGTHS_NM.shape
    for reflectance in scene.materials.values():
        values = spectra.reflectance(reflectance)
        assert values.shape == size
        assert values.min() >= 0
        assert values.max() <= 1
    for lamp in scene.lamps:
        assert spectra.light(lamp.light).shape == size
        assert spectra.light(lamp.light).min() >= 0
        assert spectra.light(lamp.light).max() > 0
    assert {one for shape in scene.shapes for one in shape.materials} <= set(scene.materials)


def test_sensitivities_peak_in_red_green_and_blue() -> None:
    peaks = spectra.WAVELENGTHS_NM[spectra.sensitivities().argmax(axis=1)]
    assert 570 <= peaks[0] <= 630
    assert 500 <= peaks[1] <= 560
    assert 430 <= peaks[2] <= 490


def test_the_training_set_has_its_patches() -> None:
    at_550 = spectra.WAVELENGTHS_NM == 550
    found = [float(spectra.reflectance(f"training/{patch}")[at_550][0]) for patch in (0, 1, 189)]
    assert found == pytest.approx([0.0167, 0.0893, 0.1519])
    with pytest.raises(IndexError):
        spectra.reflectance("training/190")


def test_the_flash_is_measured_from_400_nm_on() -> None:
    """62.967 at 400 nm and 60.185 at 415 nm; what lies before is as it begins."""
    flash = spectra.flash()
    assert flash[spectra.WAVELENGTHS_NM <= 400].tolist() == 5 * [62.967]
    assert flash[spectra.WAVELENGTHS_NM == 415].tolist() == [60.185]


def test_the_three_lamps_look_different_to_the_camera() -> None:
    scene = load_scene("studio")
    rgb = []
    for lamp in scene.lamps:
        spd = spectra.light(lamp.light)
        if lamp.through:
            spd = spd * spectra.reflectance(lamp.through)
        response = spectra.sensitivities() @ spd
        rgb.append(response / np.linalg.norm(response))
    angles = [float(np.degrees(np.arccos(rgb[i] @ rgb[j]))) for i, j in ((0, 1), (0, 2), (1, 2))]
    assert min(angles) > 15
