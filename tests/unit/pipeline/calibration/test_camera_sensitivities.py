from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.calibration.camera_sensitivities import estimate_camera, is_unlikely
from pipeline.calibration.patches import Patches
from pipeline.errors import OptionError, UnusablePairError
from pipeline.spectra.cameras import Camera, measured_cameras
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.angles import angles
from tests.evaluation.spectra import sensitivities
from tests.targets import other_colorchecker

XENON = find_light("xenon")
X, Y = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-0.6, 0.6, 4))
PLACES = np.stack([X.ravel(), Y.ravel()], axis=1)


def _unlike() -> Floats64:
    """A camera whose channels are the Nikon's, shifted, tinted and scaled."""
    base = sensitivities("Nikon D5100")
    moved = [
        np.interp(WAVELENGTHS_NM - shift, WAVELENGTHS_NM, channel) * gain
        for channel, shift, gain in zip(base, (6, -4, 5), (0.8, 1.0, 1.3), strict=True)
    ]
    tinted = np.array(moved) * np.exp(0.3 * np.sin(WAVELENGTHS_NM / 40.0))
    return np.asarray(tinted / tinted.max())


def _chart(s: Floats64, flash: Floats64, reflectances: Floats64) -> Patches:
    lit = reflectances @ (s * flash).T * np.exp(0.2 * PLACES[:, 1:])
    return Patches(lit, np.full(lit.shape, 1e-12), colorchecker_spectra(), PLACES)


@pytest.mark.parametrize("name", ["Nikon D5100", "Sigma SD1 Merrill"])
@pytest.mark.parametrize("brightness", [1.0, 0.01])
def test_a_known_camera_is_found(name: str, brightness: float) -> None:
    truth = sensitivities(name)
    patches = _chart(truth, brightness * XENON, colorchecker_spectra())
    found = estimate_camera(patches, {"xenon": XENON}, measured_cameras())
    assert (found.nearest, found.flash) == (name, "xenon")
    assert angles(found.sensitivities, truth) == pytest.approx(0.0, abs=1.5)
    assert found.sensitivities.max() == 1.0
    assert found.misfit < 0.001


def test_an_unknown_camera_is_found_nearer_than_any_known() -> None:
    truth = _unlike()
    patches = _chart(truth, XENON, other_colorchecker())
    found = estimate_camera(patches, {"xenon": XENON}, measured_cameras())
    before = angles(sensitivities("Nikon D5100"), truth)
    after = angles(found.sensitivities, truth)
    assert before.mean() > 6.0
    assert after.mean() < 0.7 * before.mean()
    white, seen = truth @ XENON, found.sensitivities @ XENON
    assert seen / seen[1] == pytest.approx(white / white[1], rel=0.02)


@pytest.mark.parametrize(
    ("unlike", "share"), [("tinted", 0.105), ("tailed", 0.476), ("moved", 0.507)]
)
def test_each_way_in_which_cameras_differ_is_allowed_for(unlike: str, share: float) -> None:
    """What is left of the angle to the known camera; what shifts is least to be told."""
    base = sensitivities("Nikon D5100")
    truth = {
        "tinted": base * np.exp(0.3 * np.sin(WAVELENGTHS_NM / 40.0)),
        "tailed": base
        + 0.03
        * base.max()
        * np.exp(-0.5 * ((WAVELENGTHS_NM - np.array([[450], [630], [600]])) / 30.0) ** 2),
        "moved": np.array(
            [
                np.interp(WAVELENGTHS_NM - shift, WAVELENGTHS_NM, channel)
                for channel, shift in zip(base, (4, -4, 4), strict=True)
            ]
        ),
    }[unlike]
    patches = _chart(truth / truth.max(), XENON, colorchecker_spectra())
    found = estimate_camera(patches, {"xenon": XENON}, measured_cameras())
    assert found.nearest == "Nikon D5100"
    left = angles(found.sensitivities, truth).mean() / angles(base, truth).mean()
    assert left == pytest.approx(share, abs=0.003)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_every_channel_tells_the_camera(channel: int) -> None:
    """By six patches, too few for the flash's fall-off, which all channels share."""
    truth, other = sensitivities("Nikon D5100"), sensitivities("Sigma SD1 Merrill")
    wrong = np.where(np.arange(3)[:, None] == channel, other, truth)
    known = [Camera(name, s, "measured") for name, s in (("wrong", wrong), ("right", truth))]
    lit = colorchecker_spectra()[:6] @ (truth * XENON).T
    patches = Patches(lit, np.full((6, 3), 1e-12), colorchecker_spectra()[:6], PLACES[:6])
    assert estimate_camera(patches, {"xenon": XENON}, known).nearest == "right"


def test_cameras_that_noise_does_not_tell_apart_are_averaged() -> None:
    known = measured_cameras()
    patches = _chart(known[0].sensitivities, XENON, colorchecker_spectra())
    noisy = replace(patches, variance=patches.variance + 1e8)
    found = estimate_camera(noisy, {"xenon": XENON}, known)
    ways = [angles(found.sensitivities, camera.sensitivities).mean() for camera in known]
    apart = angles(known[0].sensitivities, known[1].sensitivities).mean()
    assert ways == pytest.approx([apart / 2, apart / 2], rel=0.2)
    assert found.sensitivities.max() == 1.0


def test_the_likeliest_flash_is_taken_where_it_is_not_told() -> None:
    light = find_light("LED-B4")
    patches = _chart(sensitivities("Nikon D5100"), light, colorchecker_spectra())
    flashes = {name: find_light(name) for name in ("xenon", "LED-B4", "D50")}
    assert estimate_camera(patches, flashes, measured_cameras()).flash == "LED-B4"


OTHERS = [find_light(name) for name in ("LED-B5", "xenon", "Luxeon WW 2880")]


@pytest.mark.parametrize(
    ("told", "unlikely"), [("A", True), ("LED-B1", True), ("D65", False), ("xenon", False)]
)
def test_patches_speak_against_a_flash_far_from_the_one_that_shone(
    told: str, unlikely: bool
) -> None:
    """Though the camera is a little unlike all that are known, and the pigments are others."""
    patches = _chart(_unlike(), XENON, other_colorchecker())
    assert is_unlikely(find_light(told), patches, OTHERS, measured_cameras()) is unlikely


def test_patches_speak_for_a_flash_unlike_all_others() -> None:
    """Behind a green gel."""
    gelled = XENON * np.exp(-0.5 * ((WAVELENGTHS_NM - 530) / 40.0) ** 2)
    patches = _chart(sensitivities("Nikon D5100"), gelled, other_colorchecker())
    assert not is_unlikely(gelled, patches, OTHERS, measured_cameras())


def test_curves_are_never_negative() -> None:
    patches = _chart(_unlike(), XENON, other_colorchecker())
    found = estimate_camera(patches, {"xenon": XENON}, measured_cameras())
    assert (found.sensitivities >= 0).all()


@pytest.mark.parametrize(("off", "misfit"), [(0.2, 0.147), (0.21, None)])
def test_light_may_be_off_by_three_twentieths(off: float, misfit: float | None) -> None:
    """From what the likeliest camera predicts, which follows errors (24, 3) a little."""
    patches = _chart(sensitivities("Nikon D5100"), XENON, colorchecker_spectra())
    errors = 1 + off * np.random.default_rng(1).choice([-1, 1], patches.flash.shape)
    wrong = replace(patches, flash=patches.flash * errors)
    if misfit is None:
        with pytest.raises(UnusablePairError, match="which stay off by 15%"):
            estimate_camera(wrong, {"xenon": XENON}, measured_cameras())
    else:
        found = estimate_camera(wrong, {"xenon": XENON}, measured_cameras())
        assert found.misfit == pytest.approx(misfit, abs=0.001)


def test_a_chart_that_no_camera_explains_is_refused() -> None:
    blind = Camera("blind", np.ones((3, 81)) * [[1.0], [0.9], [0.8]], "measured")
    shuffled = colorchecker_spectra()[np.random.default_rng(1).permutation(24)]
    patches = _chart(sensitivities("Nikon D5100"), XENON, shuffled)
    with pytest.raises(UnusablePairError, match=r"No camera explains .* gloss and shadows"):
        estimate_camera(patches, {"xenon": XENON}, [blind])


def test_a_flash_that_no_camera_sees_is_refused() -> None:
    """One sees a little noise of it, of which nothing can be made."""
    infrared = np.where(WAVELENGTHS_NM >= 700, 1 / 17, 0.0)
    patches = _chart(sensitivities("Nikon D5100"), XENON, colorchecker_spectra())
    nikon, sigma = measured_cameras()
    with pytest.raises(OptionError, match="No known camera sees red, green and blue in the flash"):
        estimate_camera(patches, {"infrared": infrared}, [sigma])
    with pytest.raises(
        UnusablePairError, match=r"stay off by \d+%: check the corners and the flash"
    ):
        estimate_camera(patches, {"infrared": infrared}, [nikon, sigma])
    assert (
        estimate_camera(patches, {"infrared": infrared, "xenon": XENON}, [nikon, sigma]).flash
        == "xenon"
    )


@pytest.mark.filterwarnings("ignore:invalid value")
def test_light_that_is_no_number_is_refused() -> None:
    patches = _chart(sensitivities("Nikon D5100"), XENON, colorchecker_spectra())
    few = Patches(
        np.full((1, 3), np.nan),
        *(part[:1] for part in (patches.variance, patches.reflectances, patches.places)),
    )
    with pytest.raises(UnusablePairError, match=r"No camera explains .* check"):
        estimate_camera(few, {"xenon": XENON}, measured_cameras())
