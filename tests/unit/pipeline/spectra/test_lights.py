"""Spectra of flashes, lamps and neutral lights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.colour.temperature import cct_duv
from pipeline.errors import OptionError
from pipeline.images.frames import Frame
from pipeline.light.model import build_model
from pipeline.options import Spectrum
from pipeline.photometric_stereo.responses import LampBank
from pipeline.spectra import cameras, lights
from pipeline.spectra.cameras import find_camera
from pipeline.spectra.families import family_spectra
from pipeline.spectra.lights import (
    find_light,
    lamp_spectra,
    light_table,
    look_up_light,
    packaged_light,
    reflectance_spectra,
)
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.wavelengths import WAVELENGTHS_NM


def kelvin(light: np.typing.NDArray[np.float64]) -> float | None:
    found = cct_duv(cie_1931() @ light)
    return None if found is None else found[0]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("A", 2856),
        ("D50", 5003),
        ("D55", 5503),
        ("d65", 6504),
        ("D75", 7504),
        ("D58", 5800),
        ("FL2", 4225),
        ("FL11", 4000),
        ("LED-B1", 2733),
        ("led", 6600),
        ("xenon", 7200),
    ],
)
def test_lights_have_the_temperature_they_are_known_for(name: str, expected: float) -> None:
    assert kelvin(find_light(name)) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("name", ["xenon", "led", "A", "D65", "D200", "FL7", "HP1", "E"])
def test_spectra_are_positive_and_sum_to_1(name: str) -> None:
    light = find_light(name)
    assert light.shape == WAVELENGTHS_NM.shape
    assert light.min() >= 0
    assert light.sum() == pytest.approx(1)


@pytest.mark.parametrize(("nm", "ratio"), [(460, 1.178), (560, 1.0), (600, 0.9001), (700, 0.7160)])
def test_d65_is_the_published_table(nm: int, ratio: float) -> None:
    """CIE 15, relative to 560 nm."""
    light = find_light("D65")
    at = {int(w): value for w, value in zip(WAVELENGTHS_NM, light, strict=True)}
    assert at[nm] / at[560] == pytest.approx(ratio, abs=0.001)


def test_the_xenon_flash_is_neither_flat_nor_daylight() -> None:
    flash, flat = find_light("xenon"), np.ones(81)
    cosine = flash @ flat / np.linalg.norm(flash) / np.linalg.norm(flat)
    assert 8 < np.degrees(np.arccos(cosine)) < 18


@pytest.mark.parametrize(
    ("name", "near"), [("xenn", "xenon"), ("FL 2b", "FL2"), ("LED-B9", "LED-B1|LED-B5")]
)
def test_unknown_names_are_refused_with_near_ones(name: str, near: str) -> None:
    with pytest.raises(
        OptionError, match=f"No flash spectrum is called .*near names are .*({near})"
    ):
        find_light(name)


@pytest.mark.parametrize("name", ["D39", "D30", "D999", "D", "D6500", ""])
def test_daylight_that_does_not_exist_is_refused(name: str) -> None:
    with pytest.raises(OptionError, match="No neutral light spectrum is called"):
        find_light(name, "neutral light")


def test_a_table_is_brought_onto_the_grid() -> None:
    table = Spectrum(wavelength_nm=[400, 600, 700], power=[1, 3, 3])

    light = find_light(table)

    at = dict(zip(WAVELENGTHS_NM.tolist(), light.tolist(), strict=True))
    assert at[500.0] / at[600.0] == pytest.approx(2 / 3)
    assert at[380.0] == at[400.0]
    assert at[780.0] == at[700.0]


def test_a_dark_table_is_refused_with_its_purpose() -> None:
    dark = Spectrum.model_construct(wavelength_nm=[400.0, 500.0, 700.0], power=[0.0, 0.0, 0.0])
    with pytest.raises(OptionError, match="The neutral light spectrum is zero from 380 to 780 nm"):
        find_light(dark, "neutral light")


@pytest.mark.parametrize("wavelengths", [[380, 780], [380, 381, 382, 780]])
@pytest.mark.parametrize("power", [6e299, 1e308])
def test_a_table_without_a_sum_is_refused(wavelengths: list[float], power: float) -> None:
    endless = Spectrum(wavelength_nm=wavelengths, power=[power] * len(wavelengths))
    with pytest.raises(OptionError, match="The flash spectrum is too large to be added up"):
        find_light(endless)


@pytest.mark.parametrize("power", [1e-300, 1e299])
def test_a_table_may_have_any_scale(power: float) -> None:
    flat = Spectrum(wavelength_nm=[380, 780], power=[power, power])
    np.testing.assert_allclose(find_light(flat), 1 / 81)


@pytest.mark.usefixtures("spectra_folder")
@pytest.mark.parametrize(
    "request_",
    ["xenon", "led", "A", "D58", "my torch", Spectrum(wavelength_nm=[400, 700], power=[1, 3])],
)
def test_what_is_looked_up_makes_the_light_that_is_found(request_: str | Spectrum) -> None:
    np.testing.assert_array_equal(look_up_light(request_)(), find_light(request_))


@pytest.mark.usefixtures("spectra_folder")
@pytest.mark.parametrize(
    "request_",
    ["xenn", "D39", "", "Acme One", Spectrum(wavelength_nm=[380, 780], power=[1e308, 1e308])],
)
def test_what_is_not_found_is_refused_when_it_is_looked_up(request_: str | Spectrum) -> None:
    with pytest.raises(OptionError) as found:
        find_light(request_, "neutral light")
    with pytest.raises(OptionError) as looked_up:
        look_up_light(request_, "neutral light")
    assert str(looked_up.value) == str(found.value)


def test_daylight_is_looked_up_without_being_made(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[float] = []
    monkeypatch.setattr(lights, "daylight", made.append)
    make = look_up_light("D41")
    assert made == []
    make()
    assert made == [4100]


@pytest.mark.usefixtures("spectra_folder")
@pytest.mark.parametrize("name", ["my torch", "MY_TORCH", "mytorch"])
def test_the_users_folder_has_lights(name: str) -> None:
    light = find_light(name)
    assert light[-1] / light[0] == pytest.approx(3)


@pytest.mark.usefixtures("spectra_folder")
def test_a_camera_is_no_light() -> None:
    with pytest.raises(OptionError, match="it needs wavelength_nm,power"):
        find_light("Acme One")


def test_lamps_to_learn_from_are_many_and_different() -> None:
    lamps = lamp_spectra()

    unit = lamps / np.linalg.norm(lamps, axis=1, keepdims=True)
    cosines = unit @ unit.T - np.eye(len(lamps))
    temperatures = [t for t in map(kelvin, lamps) if t is not None]
    assert len(lamps) > 40
    assert cosines.max() < 0.9995
    np.testing.assert_allclose(lamps.sum(1), 1.0)
    assert min(temperatures) < 2100
    assert max(temperatures) > 9500


def test_reflectances_to_learn_from_begin_with_the_color_checker() -> None:
    surfaces = reflectance_spectra()

    assert surfaces.shape == (24 + 190 + 99, 81)
    assert surfaces.min() >= 0
    assert surfaces.max() <= 1
    green = surfaces @ (cie_1931()[1] * find_light("D65")) / (cie_1931()[1] @ find_light("D65"))
    np.testing.assert_allclose(green[18:24], [0.90, 0.59, 0.36, 0.19, 0.09, 0.03], atol=0.02)


@pytest.mark.usefixtures("spectra_folder")
def test_names_of_any_script_are_told_apart(spectra_folder: Path) -> None:
    (spectra_folder / "лампа_1.csv").write_text("wavelength_nm,power\n400,1\n700,2\n")
    (spectra_folder / "!.csv").write_text("wavelength_nm,power\n400,1\n700,5\n")

    light = find_light("Лампа 1")

    assert light[-1] / light[0] == pytest.approx(2)
    for name in ("свет 1", "свет", "!", "?"):
        with pytest.raises(OptionError, match="No flash spectrum is called"):
            find_light(name)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ("my_torch.json", r"my_torch\.csv and my_torch\.json"),
        ("more/my_torch.csv", r"more/my_torch\.csv and my_torch\.csv"),
        ("My Torch.csv", r"My Torch\.csv and my_torch\.csv"),
    ],
)
def test_two_files_of_one_name_are_refused_where_it_is_asked_for(
    spectra_folder: Path, other: str, said: str
) -> None:
    (spectra_folder / other).write_text("wavelength_nm,power\n400,1\n700,2\n")

    with pytest.raises(OptionError, match=f"The files {said} .* have the same name: rename one"):
        find_light("my torch")
    assert find_light("D65") is packaged_light("D65")


@pytest.mark.parametrize("name", ["xenon", "led", "LED-B5", "A", "D65", "D58"])
def test_a_packaged_light_is_none_of_the_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)
    own = find_light(name)
    (tmp_path / f"{name}.csv").write_text("wavelength_nm,power\n400,1\n700,2\n")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))

    assert find_light(name)[-1] / find_light(name)[0] == pytest.approx(2)
    np.testing.assert_array_equal(packaged_light(name), own)


def test_a_packaged_light_that_is_not_there_is_told() -> None:
    with pytest.raises(KeyError, match="torch"):
        packaged_light("torch")


def test_no_file_changes_what_the_program_itself_needs(
    frame_of: Callable[..., Frame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each would fail over a camera's table in place of the light."""
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)
    camera = find_camera("Nikon D5100", frame_of())
    flash, neutral = find_light("xenon"), find_light("D50")
    sensor_xyz, xenon = cameras._sensor_xyz(), family_spectra()["xenon"]
    model = build_model(camera, flash, neutral, "wpca", response=camera)
    for name in ("D65", "A", "E", "xenon", "D50", "LED-B5", "FL7"):
        (tmp_path / f"{name}.csv").write_text("wavelength_nm,R,G,B\n400,0,0,1\n700,1,1,0\n")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))

    again = build_model(camera, flash, neutral, "wpca", response=camera)

    np.testing.assert_array_equal(again.camera_to_xyz, model.camera_to_xyz)
    assert again.response is not None
    np.testing.assert_array_equal(again.response.camera_to_xyz, model.camera_to_xyz)
    assert cameras.balanced(camera).sensitivities.max() == 1
    np.testing.assert_array_equal(cameras._sensor_xyz.__wrapped__(), sensor_xyz)
    np.testing.assert_array_equal(family_spectra.__wrapped__()["xenon"], xenon)
    assert LampBank(camera.sensitivities, flash).flash_white[1] == pytest.approx(1)


def test_a_table_is_one_that_is_given_or_of_the_folder(spectra_folder: Path) -> None:
    table = Spectrum(wavelength_nm=[400.0, 700.0], power=[1.0, 2.0])
    (spectra_folder / "my_flash.csv").write_text("wavelength_nm,power\n400,1\n700,2\n")
    assert light_table(table) is table
    assert light_table("My Flash") == table
    assert [light_table(name) for name in ("xenon", "D65", "no such light")] == [None] * 3


def test_a_file_of_the_folder_that_is_no_table_is_named(spectra_folder: Path) -> None:
    (spectra_folder / "broken.csv").write_text("x")
    with pytest.raises(OptionError, match=r"^The file broken\.csv in the folder"):
        light_table("broken")
