from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.calibration.flash_spectrum import FAMILY, estimate_flash
from pipeline.calibration.patches import Patches
from pipeline.errors import UnusablePairError
from pipeline.spectra.colorchecker import colorchecker_spectra
from pipeline.spectra.lights import find_light
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.angles import angles
from tests.evaluation.spectra import sensitivities
from tests.targets import other_colorchecker

S = sensitivities("Nikon D5100")
X, Y = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-0.6, 0.6, 4))
PLACES = np.stack([X.ravel(), Y.ravel()], axis=1)


def _tinted(name: str) -> Floats64:
    """A light through a filter that no table has."""
    light = find_light(name) * np.exp(0.25 * np.sin(WAVELENGTHS_NM / 45.0))
    return np.asarray(light / light.sum())


def _chart(flash: Floats64, reflectances: Floats64, s: Floats64 = S) -> Patches:
    lit = reflectances @ (s * flash).T * np.exp(-0.2 * PLACES[:, :1])
    return Patches(lit, np.full(lit.shape, 1e-12), colorchecker_spectra(), PLACES)


def _card(flash: Floats64) -> Patches:
    lit = (S @ flash)[None]
    return Patches(lit, np.full(lit.shape, 1e-12), np.ones((1, 81)), np.zeros((1, 2)))


@pytest.mark.parametrize("name", ["xenon", "LED-B4", "LED-V1"])
def test_a_light_of_the_family_is_found_by_a_chart(name: str) -> None:
    found = estimate_flash(_chart(find_light(name), colorchecker_spectra()), S)
    assert found.nearest == name
    assert angles(found.spectrum, find_light(name)) < 4.0
    assert found.spectrum.sum() == pytest.approx(1.0)
    assert found.misfit < 0.002


def test_no_file_of_the_folder_changes_the_family(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    led = find_light("LED-B4")
    (tmp_path / "LED-B4.csv").write_text("wavelength_nm,power\n400,1\n700,9\n")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    found = estimate_flash(_chart(led, colorchecker_spectra()), S)
    assert found.nearest == "LED-B4"
    assert angles(found.spectrum, led) < 4.0


@pytest.mark.parametrize("name", ["xenon", "D50"])
def test_a_tinted_light_is_found_nearer_than_the_family_has_one(name: str) -> None:
    truth = _tinted(name)
    nearest = min(angles(find_light(one), truth) for one in FAMILY)
    chart = estimate_flash(_chart(truth, other_colorchecker()), S)
    card = estimate_flash(_card(truth), S)
    assert nearest > 8.0
    assert angles(chart.spectrum, truth) < 0.75 * nearest
    # what the camera sees of a white card
    seen, true = S @ np.array([chart.spectrum, card.spectrum]).T, S @ truth
    assert seen / seen[1] == pytest.approx(np.stack([true, true], axis=1) / true[1], rel=0.025)


@pytest.mark.parametrize("name", ["xenon", "HPS"])
def test_a_spectrum_is_never_negative(name: str) -> None:
    """Nor of a light that no flash is like."""
    deep = find_light(name) * np.exp((name == "xenon") * 1.2 * np.sin(WAVELENGTHS_NM / 30.0))
    patches = _chart(deep / deep.sum(), colorchecker_spectra())
    assert (estimate_flash(patches, S).spectrum >= 0).all()


def test_noise_is_believed_less() -> None:
    truth = _tinted("xenon")
    patches = _card(truth)
    loud = Patches(patches.flash, (0.1 * patches.flash) ** 2, patches.reflectances, patches.places)
    quiet_seen, loud_seen = (S @ estimate_flash(p, S).spectrum for p in (patches, loud))
    true = S @ truth
    quiet, loudly = (abs(x[0] / x[1] - true[0] / true[1]) for x in (quiet_seen, loud_seen))
    assert loudly > 1.5 * quiet


@pytest.mark.filterwarnings("ignore:invalid value")
def test_light_that_is_no_number_is_refused() -> None:
    with pytest.raises(UnusablePairError, match="No flash explains"):
        estimate_flash(_card(np.full(81, np.nan)), S)


def test_a_chart_that_no_flash_explains_is_refused() -> None:
    wrong = S[[2, 0, 1]]
    causes = "check the marks and the camera, and keep gloss and shadows off the patches"
    with pytest.raises(UnusablePairError, match=f"No flash explains the patches' .* {causes}"):
        estimate_flash(_chart(find_light("xenon"), colorchecker_spectra(), wrong), S)


@pytest.mark.parametrize(("part", "refused"), [(0.2, False), (0.3, True)])
def test_patches_may_be_off_by_less_than_a_seventh(part: float, refused: bool) -> None:
    """Channels that hold a part of others: of a camera a little unlike."""
    mixed = (1 - part) * S + part * S[[2, 0, 1]]
    patches = _chart(find_light("xenon"), colorchecker_spectra(), mixed)
    if refused:
        with pytest.raises(UnusablePairError, match="No flash explains the patches' colours"):
            estimate_flash(patches, S)
    else:
        assert estimate_flash(patches, S).misfit > 0.1
