from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.arrays import Floats32, Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.colour.temperature import cct_duv, white_of
from pipeline.errors import OptionError
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model, build_model
from pipeline.mixes.mix import mix_basis, mix_matrices, mixed, to_be_mixed
from pipeline.mixes.mix_options import LampMix, Mix, MixBasis
from pipeline.pictures.shown import shown_gain
from pipeline.pictures.white_balance import whites_of
from pipeline.results.manifest import lamp_entries
from pipeline.spectra.cameras import Camera, named_camera
from pipeline.spectra.lights import find_light
from pipeline.spectra.matrices import best_matrix
from pipeline.spectra.wavelengths import WAVELENGTHS_NM

SRGB_TO_XYZ = np.linalg.inv(XYZ_TO_SRGB)


@pytest.fixture
def lamps(lamps_of: Callable[..., Lamps], warm_to_cool: Floats64) -> Lamps:
    return lamps_of(warm_to_cool[[0, 2]])


@pytest.fixture
def layers(lamps: Lamps, model: Model) -> Floats32:
    """Both lamps on a white card, one half as bright; then a grey one and a black one."""
    whites = lamps.matrices @ model.flash_white
    whites = whites / whites[:, 1:2] * [[0.25], [0.125]]
    return np.stack([np.stack([[w, w / 2, 0 * w]]) for w in whites]).astype(np.float32)


@pytest.fixture
def basis(layers: Floats32, lamps: Lamps, model: Model) -> MixBasis:
    return mix_basis(layers.sum(axis=0), np.inf, lamps, model)


def one(basis: MixBasis, layers: Floats32, **settings: Any) -> Floats64:
    """CIE XYZ of the white card under the first lamp alone."""
    mix = Mix(lamps=[LampMix(**settings), LampMix(on=False)])
    found = mixed(layers, mix_matrices(basis, mix))[0, 0]
    return np.asarray(SRGB_TO_XYZ @ found, np.float64)


def test_clipped_light_is_mixed_in_the_colour_of_its_lamp(
    lamps: Lamps, layers: Floats32, model: Model
) -> None:
    """In the place of the grey card, as bright as its brightest channel says."""
    clipped = layers.copy()
    clipped[:, 0, 1] = [[0.75] * 3, [0.25] * 3]
    basis = mix_basis(layers.sum(axis=0), 1.0, lamps, model)
    assert basis.clipping == 1.0

    found = to_be_mixed(clipped, basis)

    whites = layers[:, 0, 0]
    bright = np.array([0.75, 0.25]) / whites.min(axis=1)
    np.testing.assert_allclose(found[:, 0, 1], whites * bright[:, None], rtol=1e-5)
    np.testing.assert_array_equal(found[:, 0, [0, 2]], clipped[:, 0, [0, 2]])
    endless = mix_basis(layers.sum(axis=0), np.inf, lamps, model)
    assert endless.clipping is None
    assert to_be_mixed(clipped, endless) is clipped


def test_neutral_settings_give_the_photograph_as_it_is_shown(
    basis: MixBasis, layers: Floats32, model: Model
) -> None:
    photograph = layers.sum(axis=0)
    to_srgb = XYZ_TO_SRGB @ model.camera_to_xyz
    shown = photograph @ (shown_gain(photograph, to_srgb) * to_srgb).T

    found = mixed(layers, mix_matrices(basis, Mix(lamps=[LampMix(), LampMix()])))

    np.testing.assert_allclose(found, shown, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-4, 6e4])
def test_layers_of_any_scale_are_mixed_as_exactly(
    layers: Floats32, lamps: Lamps, model: Model, scale: float
) -> None:
    photograph = np.float32(scale) * layers.sum(axis=0)
    to_srgb = XYZ_TO_SRGB @ model.camera_to_xyz
    exact = shown_gain(photograph, to_srgb) * to_srgb
    basis = mix_basis(photograph, np.inf, lamps, model)

    found = mix_matrices(basis, Mix(lamps=[LampMix(), LampMix()]))

    np.testing.assert_allclose(found[0], exact, rtol=0, atol=1e-6 * np.abs(exact).max())


def test_stops_gels_and_switches_are_factors(basis: MixBasis, layers: Floats32) -> None:
    plain, brighter = one(basis, layers), one(basis, layers, ev=1.5)
    np.testing.assert_allclose(brighter, 2**1.5 * plain, rtol=1e-5)
    assert not one(basis, layers, on=False, ev=3).any()
    gel = XYZ_TO_SRGB @ one(basis, layers, rgb=(1.0, 0.5, 0.0))
    np.testing.assert_allclose(gel, [1, 0.5, 0] * (XYZ_TO_SRGB @ plain), atol=1e-6)


def test_a_neutral_lamp_has_the_colour_of_the_neutral_light_and_its_green(
    basis: MixBasis, layers: Floats32, model: Model
) -> None:
    found = one(basis, layers, neutral=True)

    np.testing.assert_allclose(found / found[1], basis.neutral, rtol=2e-3)
    gain = np.array(basis.to_xyz)[1].sum() / model.camera_to_xyz[1].sum()
    assert found[1] == pytest.approx(gain * layers[0, 0, 0, 1], rel=2e-3)


@pytest.mark.parametrize("neutral", [False, True])
@pytest.mark.parametrize(("kelvin", "tint"), [(2700.0, 0.0), (6500.0, 30.0), (12000.0, -30.0)])
def test_a_temperature_is_that_of_the_light_and_keeps_its_brightness(
    basis: MixBasis, layers: Floats32, neutral: bool, kelvin: float, tint: float
) -> None:
    before = one(basis, layers, neutral=neutral)

    found = one(basis, layers, neutral=neutral, temperature_k=kelvin, tint=tint)

    assert found[1] == pytest.approx(before[1], rel=2e-3)
    light = cct_duv(found)
    assert light is not None
    assert light[0] == pytest.approx(kelvin, rel=0.01)
    assert light[1] == pytest.approx(-tint / 3000, abs=5e-4)


@pytest.mark.parametrize("neutral", [False, True])
@pytest.mark.parametrize("kelvin", [1000.0, 2500.0, 3500.0])
def test_a_tint_that_no_light_has_takes_no_light_away(
    basis: MixBasis, layers: Floats32, neutral: bool, kelvin: float
) -> None:
    before = one(basis, layers, neutral=neutral)

    found = one(basis, layers, neutral=neutral, temperature_k=kelvin, tint=-150)

    assert white_of(kelvin, 0.05)[2] < 0
    assert found.min() >= 0
    assert found[1] == pytest.approx(before[1], rel=0.04)


def lit_by(light: str, name: str, lamps_of: Callable[..., Lamps]) -> tuple[Lamps, Model]:
    """A lamp as it is fitted at best, and the model of a measured camera."""
    camera = named_camera(name)
    s, flash = camera.sensitivities, find_light("xenon")
    model = build_model(camera, flash, find_light("D65"), "wpca")
    matrix = best_matrix(s * flash / (s @ flash)[1], s * find_light(light))
    return lamps_of(np.ones(3), matrices=matrix[None] / matrix[1].sum()), model


@pytest.mark.parametrize("name", ["Nikon D5100", "Sigma SD1 Merrill"])
@pytest.mark.parametrize("light", ["A", "D65", "FL2", "FL11", "LED-B3", "HP1"])
def test_the_temperature_that_is_told_of_a_lamp_changes_nothing(
    lamps_of: Callable[..., Lamps], light: str, name: str
) -> None:
    """Nor does one near it jump; one that is another's has just its colour."""
    lamps, model = lit_by(light, name, lamps_of)
    card = np.array([[whites_of(lamps, model)[0]]], np.float32)
    basis = mix_basis(card, np.inf, lamps, model)
    (told,) = lamp_entries(lamps, model, np.ones(1))

    def lit(**settings: Any) -> Floats64:
        mix = Mix(lamps=[LampMix(**settings)])
        return np.asarray(SRGB_TO_XYZ @ (mix_matrices(basis, mix)[0] @ card[0, 0]), np.float64)

    plain, tint = lit(), -3000 * told["duv"]
    found = lit(temperature_k=told["cct_k"], tint=tint)
    np.testing.assert_allclose(found, plain, atol=1e-3 * plain[1])
    near = lit(temperature_k=1e6 / (1e6 / told["cct_k"] - 1), tint=tint)
    assert 0 < near[2] - plain[2] < 0.01 * plain[1]
    for kelvin in (told["cct_k"] * 2, told["cct_k"] / 1.8):
        light_of = cct_duv(lit(temperature_k=kelvin, tint=9))
        assert light_of is not None
        assert light_of[0] == pytest.approx(kelvin, rel=0.01)
        assert light_of[1] == pytest.approx(-0.003, abs=5e-4)


def test_manifests_of_before_tell_the_temperature_of_the_white_that_is_shown(
    basis: MixBasis, layers: Floats32
) -> None:
    before = MixBasis.model_validate(
        basis.model_dump(exclude={"lamps": {"__all__": {"own_white"}}})
    )
    plain = one(before, layers)
    own = cct_duv(plain)
    assert own is not None

    found = one(before, layers, temperature_k=own[0], tint=-3000 * own[1])

    np.testing.assert_allclose(found, plain, rtol=5e-3)


def test_a_lamp_without_a_temperature_has_no_own_white(
    lamps_of: Callable[..., Lamps], model: Model
) -> None:
    lamps = lamps_of([[0.2, 1.0, 0.1], [0.9, 0.8, 0.4]])

    basis = mix_basis(np.ones((1, 1, 3), np.float32), np.inf, lamps, model)

    assert [lamp.own_white is None for lamp in basis.lamps] == [True, False]


def test_a_lamp_of_one_colour_can_still_have_a_temperature(basis: MixBasis) -> None:
    red = basis.lamps[0].model_copy(update={"white": (2.0, 1.0, -0.1)})
    odd = basis.model_copy(update={"lamps": [red, basis.lamps[1]]})
    mix = Mix(lamps=[LampMix(temperature_k=6500), LampMix()])

    assert np.abs(mix_matrices(odd, mix)).max() < 200


@pytest.mark.parametrize("peak_nm", [450, 455, 460, 470, 590])
@pytest.mark.parametrize(("kelvin", "tint"), [(2700.0, 0.0), (5000.0, 30.0)])
def test_a_lamp_without_a_white_to_adapt_from_gets_the_temperature_of_the_neutral_light(
    lamps_of: Callable[..., Lamps],
    model: Model,
    camera: Camera,
    peak_nm: int,
    kelvin: float,
    tint: float,
) -> None:
    """Of one wavelength by and large, and up to 455 nm of negative luminance by the camera."""
    s, band = camera.sensitivities, np.exp(-0.5 * ((WAVELENGTHS_NM - peak_nm) / 10) ** 2)
    matrix = best_matrix(s * find_light("xenon"), s * band)
    lamps = lamps_of(np.ones(3), matrices=matrix[None])
    card = np.array([[whites_of(lamps, model)[0]]], np.float32)
    basis = mix_basis(card, np.inf, lamps, model)

    def lit(**settings: Any) -> Floats64:
        mix = Mix(lamps=[LampMix(**settings)])
        return np.asarray(SRGB_TO_XYZ @ (mix_matrices(basis, mix)[0] @ card[0, 0]), np.float64)

    found = lit(temperature_k=kelvin, tint=tint)

    assert found[1] == pytest.approx(lit(neutral=True)[1], rel=2e-3)
    light = cct_duv(found)
    assert light is not None
    assert light[0] == pytest.approx(kelvin, rel=0.01)
    assert light[1] == pytest.approx(-tint / 3000, abs=5e-4)
    np.testing.assert_allclose(
        lit(temperature_k=kelvin, tint=tint, neutral=True), found, rtol=1e-12
    )
    own = np.array(basis.to_xyz) @ card[0, 0]
    np.testing.assert_allclose(lit(), own, atol=1e-6 * own.max())


def test_another_number_of_lamps_is_refused(basis: MixBasis) -> None:
    with pytest.raises(OptionError, match="settings for 1 lamp, and the photograph has 2"):
        mix_matrices(basis, Mix(lamps=[LampMix()]))


@pytest.mark.parametrize(
    "settings",
    [
        {"ev": 11},
        {"ev": float("nan")},
        {"temperature_k": 999},
        {"tint": 151},
        {"tint": 5},
        {"rgb": (1, 1)},
        {"rgb": (1, 1, -0.1)},
        {"gain": 2},
    ],
)
def test_settings_out_of_their_ranges_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        LampMix(**settings)


def test_the_lights_of_the_basis_are_as_bright_as_each_other(basis: MixBasis) -> None:
    """Else the brightness of a lamp would not be kept where its colour is adapted."""
    assert [basis.neutral[1], *(lamp.white[1] for lamp in basis.lamps)] == [1.0, 1.0, 1.0]


def test_the_basis_is_the_same_through_json(basis: MixBasis) -> None:
    assert MixBasis.model_validate_json(basis.model_dump_json()) == basis
    assert white_of(6504, 0.003) == pytest.approx(basis.neutral, abs=0.01)
