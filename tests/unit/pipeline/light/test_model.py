from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.spaces import D65_XY
from pipeline.colour.temperature import cct_duv
from pipeline.errors import OptionError
from pipeline.hui2018.invariant import light_coefficients
from pipeline.light.model import Model, build_model
from pipeline.spectra.cameras import Camera, named_camera, srgb_stand_in
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.matrices import best_matrix
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.angles import angles


def seen(camera: Camera, light: Floats64) -> Floats64:
    """Camera RGB (m, 3) of measured surfaces under a light."""
    return np.asarray(reflectance_spectra() @ (camera.sensitivities * light).T)


def test_lamp_matrix_of_one_lamp_and_of_many(model: Model, warm_to_cool: Floats64) -> None:
    many = model.lamp_matrix(warm_to_cool)

    assert many.shape == (3, 3, 3)
    for matrix, coefficients in zip(many, warm_to_cool, strict=True):
        np.testing.assert_allclose(model.lamp_matrix(coefficients), matrix)


def test_lamp_matrix_is_linear_in_the_coefficients(model: Model, warm_to_cool: Floats64) -> None:
    a, b, _ = warm_to_cool

    np.testing.assert_allclose(
        model.lamp_matrix(2 * a + 0.5 * b), 2 * model.lamp_matrix(a) + 0.5 * model.lamp_matrix(b)
    )


@pytest.mark.parametrize("basis", ["wpca", "pca", "joint"])
def test_a_lamp_of_the_colour_of_the_flash_changes_nothing(camera: Camera, basis: str) -> None:
    flash = find_light("xenon")
    model = build_model(camera, flash, flash, basis)

    matrix = model.lamp_matrix(model.neutral)

    np.testing.assert_allclose(matrix / matrix[1, 1], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(
        model.flash_to_neutral, np.eye(3) * model.flash_to_neutral[1, 1], atol=1e-9
    )


@pytest.mark.parametrize("flash", ["xenon", "led", "FL11"])
def test_white_under_flash_and_neutral_light_has_green_one(camera: Camera, flash: str) -> None:
    light = find_light(flash)
    model = build_model(camera, light, find_light("D50"), "wpca")

    white = camera.sensitivities @ light
    np.testing.assert_allclose(model.flash_white, white / white[1])
    assert model.neutral[1] == pytest.approx(1)


def test_neutral_coefficients_are_the_camera_colour_of_a_white_card(
    model: Model, camera: Camera
) -> None:
    white = camera.sensitivities @ find_light("D65")

    assert angles(model.neutral, white) < 2


@pytest.mark.parametrize("flash", ["xenon", "led"])
@pytest.mark.parametrize("neutral", ["D65", "A", "FL2"])
def test_neutral_matrix_turns_a_white_card_under_flash_into_one_under_neutral(
    camera: Camera, flash: str, neutral: str
) -> None:
    light = find_light(neutral)
    model = build_model(camera, find_light(flash), light, "wpca")

    found = model.flash_to_neutral @ model.flash_white

    white = camera.sensitivities @ light
    np.testing.assert_allclose(found, white / white[1], rtol=1e-9)


def test_neutral_matrix_turns_measured_surfaces_into_those_under_neutral(
    model: Model, camera: Camera, surfaces: Floats64
) -> None:
    true = seen(camera, find_light("D65"))

    best = angles(surfaces @ model.flash_to_neutral.T, true)
    basis = angles(surfaces @ model.lamp_matrix(model.neutral).T, true)

    assert np.median(best) < 0.3
    assert np.median(best) < np.median(basis)


def test_neutral_matrix_errs_as_little_on_dark_surfaces_as_on_light_ones(
    model: Model, camera: Camera, surfaces: Floats64
) -> None:
    """Least squares of errors relative to brightness: none is left along colours but white's."""
    light = find_light("D65")
    true = seen(camera, light) / (camera.sensitivities @ light)[1]
    brightness = surfaces.sum(axis=1, keepdims=True)

    error = (surfaces @ model.flash_to_neutral.T - true) / brightness

    assert np.abs(error).max() > 1e-3
    beside_white = np.linalg.svd(model.flash_white[None])[2][1:]
    np.testing.assert_allclose(beside_white @ (surfaces / brightness).T @ error, 0, atol=1e-9)


def test_the_invariant_hardly_depends_on_the_surface(
    model: Model, camera: Camera, surfaces: Floats64
) -> None:
    for name in ("A", "D65", "LED-B1"):
        light = find_light(name)

        found = light_coefficients(seen(camera, light), surfaces, model.tensor)

        assert np.median(angles(found, np.median(found, axis=0))) < 2.5


def test_photographs_are_shown_with_white_of_the_display(model: Model, camera: Camera) -> None:
    white = camera.sensitivities @ find_light("D65")

    xyz = model.camera_to_xyz @ (white / white[1])

    assert xyz[1] == pytest.approx(1)
    assert tuple(xyz[:2] / xyz.sum()) == pytest.approx(D65_XY, abs=5e-4)


def test_pictures_under_the_neutral_light_keep_its_colour(camera: Camera) -> None:
    light = find_light("A")
    model = build_model(camera, find_light("xenon"), light, "wpca")
    white = camera.sensitivities @ light
    true = cie_1931() @ light

    found = model.neutral_to_xyz @ (white / white[1])

    np.testing.assert_allclose(found, true / true[1], rtol=1e-9)


def test_without_another_camera_there_is_no_response(model: Model) -> None:
    assert model.response is None


def test_response_of_the_same_camera_is_the_model_itself(camera: Camera) -> None:
    model = build_model(camera, find_light("xenon"), find_light("D65"), "wpca", camera)

    assert model.response is not None
    np.testing.assert_allclose(model.response.tensor, model.tensor, atol=1e-12)
    np.testing.assert_allclose(model.response.camera_to_xyz, model.camera_to_xyz)


def test_response_is_exposed_to_the_same_green_of_daylight(camera: Camera) -> None:
    """A camera of twice the sensitivity is exposed half as long."""
    other = srgb_stand_in()
    brighter = Camera("brighter", 2 * other.sensitivities, "file")
    flash, neutral = find_light("xenon"), find_light("D65")

    once = build_model(camera, flash, neutral, "wpca", other).response
    twice = build_model(camera, flash, neutral, "wpca", brighter).response

    assert once is not None
    assert twice is not None
    np.testing.assert_allclose(once.tensor, twice.tensor, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(once.camera_to_xyz, twice.camera_to_xyz, rtol=1e-9)


def test_the_scale_of_flash_and_neutral_light_does_not_matter(camera: Camera) -> None:
    flash, neutral = find_light("xenon"), find_light("D50")
    once = build_model(camera, flash, neutral, "wpca")
    bright = build_model(camera, 40 * flash, 0.1 * neutral, "wpca")

    for name in ("tensor", "flash_white", "neutral", "flash_to_neutral", "neutral_to_xyz"):
        np.testing.assert_allclose(
            getattr(bright, name), getattr(once, name), rtol=1e-9, atol=1e-12
        )


def test_learning_is_the_same_every_time(camera: Camera, model: Model) -> None:
    again = build_model(camera, find_light("xenon"), find_light("D65"), "wpca")

    np.testing.assert_array_equal(again.tensor, model.tensor)


def mixed(camera: Camera, matrix: Floats64) -> Camera:
    """A camera whose channels are mixtures of another's."""
    return Camera("odd", matrix @ camera.sensitivities, "file")


@pytest.mark.parametrize(
    "matrix",
    [
        np.ones((3, 3)),
        np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, 1]]),
        np.array([[1.0, 0, 0], [0, 1, 0], [0.5, 0.5, 1e-3]]),
    ],
    ids=["grey", "two colours", "nearly two colours"],
)
@pytest.mark.parametrize("as_response", [False, True])
def test_a_camera_without_three_colours_is_refused(
    camera: Camera, matrix: Floats64, as_response: bool
) -> None:
    odd = mixed(camera, matrix)
    cameras = (camera, odd) if as_response else (odd, None)

    with pytest.raises(OptionError, match=r"^The camera 'odd' does not tell three colours apart"):
        build_model(cameras[0], find_light("xenon"), find_light("D65"), "wpca", cameras[1])


def test_a_neutral_light_of_one_wavelength_is_refused(camera: Camera) -> None:
    """Low-pressure sodium, under which all surfaces have one colour."""
    with pytest.raises(
        OptionError,
        match=r"^Under the neutral light the camera 'Nikon D5100' does not tell three colours apart"
        r": choose a light of more wavelengths",
    ):
        build_model(camera, find_light("xenon"), find_light("LPS"), "wpca")


@pytest.mark.parametrize(
    ("dark", "name"), [("flash", "flash spectrum"), ("neutral", "neutral light")]
)
def test_light_that_the_camera_does_not_see_is_refused(
    camera: Camera, dark: str, name: str
) -> None:
    """Power at 380 nm alone, where green sees nothing."""
    cut = camera.sensitivities.copy()
    cut[:, :4] = 0
    violet = np.zeros(cut.shape[1])
    violet[0] = 1
    lights = {"flash": find_light("xenon"), "neutral": find_light("D65"), dark: violet}

    with pytest.raises(OptionError, match=f"sees no green in the {name}"):
        build_model(Camera("odd", cut, "file"), lights["flash"], lights["neutral"], "wpca")


def band(first: float, last: float) -> Floats64:
    """Light of equal power between two wavelengths in nm."""
    return np.interp(WAVELENGTHS_NM, [first - 1, first, last, last + 1], [0.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize(
    "flash",
    [find_light("LPS"), band(440, 460), band(550, 550), band(640, 700)],
    ids=["sodium", "blue", "a line", "red"],
)
def test_a_flash_of_one_colour_is_refused(camera: Camera, flash: Floats64) -> None:
    """Under which surfaces differ in brightness alone, and lamps cannot be told apart."""
    with pytest.raises(
        OptionError,
        match=r"^Under the flash spectrum the camera 'Nikon D5100' does not tell three colours "
        r"apart: check the spectrum",
    ):
        build_model(camera, flash, find_light("D65"), "wpca")


@pytest.mark.parametrize("name", ["HP1", "HPS", "FL2", "led"])
def test_a_flash_of_few_wavelengths_still_gives_a_finite_model(camera: Camera, name: str) -> None:
    model = build_model(camera, find_light(name), find_light("D65"), "wpca")

    assert np.isfinite(model.tensor).all()
    assert np.isfinite(model.flash_to_neutral).all()


def best_of(model: Model, light: Floats64) -> Floats64:
    """A lamp's matrix as it is fitted at best."""
    s = model.camera.sensitivities
    return best_matrix(s * model.flash, s * light)


def white_of_lamp(model: Model, light: Floats64) -> tuple[float, float] | None:
    return cct_duv(model.lamp_white(best_of(model, light)))


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    flash, neutral = find_light("xenon"), find_light("D65")
    return {
        name: build_model(named_camera(name), flash, neutral, "wpca")
        for name in ("Nikon D5100", "Sigma SD1 Merrill")
    }


@pytest.mark.parametrize("camera", ["Nikon D5100", "Sigma SD1 Merrill"])
@pytest.mark.parametrize(
    ("light", "kelvin", "duv"),
    [
        ("A", 2856, 0.0),
        ("D65", 6504, 0.0032),
        ("FL2", 4224, 0.0018),
        ("FL11", 3999, 0.0001),
        ("LED-B3", 4103, -0.0006),
    ],
)
def test_the_white_of_a_lamp_is_that_of_its_spectrum(
    models: dict[str, Model], camera: str, light: str, kelvin: float, duv: float
) -> None:
    """By a matrix for daylight the Duv of A, FL2 and FL11 is off by 0.0036 to 0.0113."""
    found = white_of_lamp(models[camera], find_light(light))

    assert found is not None
    assert 1e6 / found[0] == pytest.approx(1e6 / kelvin, abs=14)
    assert found[1] == pytest.approx(duv, abs=0.0026)


@pytest.mark.parametrize("camera", ["Nikon D5100", "Sigma SD1 Merrill"])
def test_gels_are_told(models: dict[str, Model], camera: str) -> None:
    """No measured lamp has any: light that is estimated by them alone would be nearly white."""
    model, nm = models[camera], WAVELENGTHS_NM
    taken = 0.6 * np.exp(-0.5 * ((nm - 620) / 40) ** 2) + 0.5 * np.exp(
        -0.5 * ((nm - 450) / 30) ** 2
    )
    greenish = find_light("LED-B3") * (1 - taken)
    green = find_light("A") * np.exp(-0.5 * ((nm - 530) / 35) ** 2)

    found, true = white_of_lamp(model, greenish), cct_duv(cie_1931() @ greenish)
    assert found is not None and true is not None
    assert found[1] == pytest.approx(true[1], abs=0.0105)
    assert true[1] > 0.03
    assert white_of_lamp(model, green) is None


def test_the_white_of_a_lamp_has_no_sign(models: dict[str, Model]) -> None:
    model = models["Nikon D5100"]
    matrix = best_of(model, find_light("FL2"))

    np.testing.assert_allclose(model.lamp_white(-3 * matrix), model.lamp_white(matrix), rtol=1e-9)


def test_the_white_of_a_lamp_in_a_rendered_picture_is_its_own_colour() -> None:
    model = build_model(srgb_stand_in(), find_light("xenon"), find_light("D65"), "wpca")
    matrix = best_of(model, find_light("FL2"))

    np.testing.assert_allclose(
        model.lamp_white(matrix), model.camera_to_xyz @ matrix @ model.flash_white, rtol=1e-12
    )
