from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.decode import decode
from pipeline.spectra.lights import find_light
from tests.evaluation.capture import Balance, Contrast, Sensor, capture, capture_jpeg
from tests.evaluation.scenes import RenderedScene, render_scene, scenes
from tests.evaluation.spectra import sensitivities

SMALL = (64, 48)


@pytest.fixture(scope="module")
def rendered() -> RenderedScene:
    return render_scene(scenes("two", "report")[0], SMALL)


def flat(rendered: RenderedScene, value: float) -> RenderedScene:
    """Two lamps and a flash of one value everywhere, on 200 × 200 pixels."""
    grey = np.full((200, 200, 3), value, np.float32)
    return replace(rendered, lamps=np.stack([grey / 2, grey / 2]), flash=0 * grey, flash_frame=grey)


def test_exact_files_give_back_the_light(rendered: RenderedScene) -> None:
    shot = capture(rendered)

    before, after = (decode(data, shot.encoding) for data in (shot.no_flash, shot.flash))

    np.testing.assert_array_equal(before.pixels, rendered.lamps.sum(axis=0))
    np.testing.assert_array_equal(after.pixels, rendered.flash_frame)
    np.testing.assert_array_equal(shot.truth, rendered.lamps)
    assert before.encoding == "linear"


@pytest.mark.parametrize("value", [0.01, 0.2, 0.8])
@pytest.mark.parametrize("exposure", [1.0, 0.125])
def test_noise_is_that_of_photons_reading_and_steps(
    rendered: RenderedScene, value: float, exposure: float
) -> None:
    shot = capture(flat(rendered, value), Sensor(), exposure)

    pixels = decode(shot.no_flash, shot.encoding).pixels[:].astype(np.float64)

    light = value * exposure
    variance = light / 20_000 + (5 / 20_000) ** 2 + (1 / 16_383) ** 2 / 12
    assert pixels.mean() == pytest.approx(light, abs=4 * np.sqrt(variance / pixels.size))
    assert pixels.var() == pytest.approx(variance, rel=0.03)
    np.testing.assert_allclose(shot.truth.sum(axis=0), light, rtol=1e-6)


def test_noise_is_the_same_each_time_and_new_in_each_photograph(rendered: RenderedScene) -> None:
    scene = flat(rendered, 0.3)
    first, second = capture(scene, Sensor()), capture(scene, Sensor())
    assert (first.no_flash, first.flash) == (second.no_flash, second.flash)

    before, after = (decode(data, "linear").pixels[:] for data in (first.no_flash, first.flash))
    correlation = np.corrcoef(before.ravel(), after.ravel())[0, 1]
    assert abs(correlation) < 0.02


def test_black_and_white_are_where_the_sensor_ends(rendered: RenderedScene) -> None:
    bright = decode(capture(flat(rendered, 1.5), Sensor()).no_flash, "linear")
    dark = decode(capture(flat(rendered, 0.0), Sensor()).no_flash, "linear")

    assert bright.pixels[:].min() == 1
    assert bright.saturated.all()
    assert dark.pixels[:].min() == 0
    assert 0 < dark.pixels[:].mean() < 5 / 20_000


def test_jpegs_hold_the_truth_as_nearly_as_eight_bits_can(rendered: RenderedScene) -> None:
    shot = capture_jpeg(rendered)

    before = decode(shot.no_flash, shot.encoding)
    after = decode(shot.flash, shot.encoding)

    assert before.encoding == "srgb"
    held = np.clip(shot.truth.sum(axis=0), 0, 1)
    assert np.abs(before.pixels - held).mean() < 0.05 * held.mean()
    assert abs(np.mean(before.pixels - held)) < 0.005 * held.mean()
    assert 0.85 < np.percentile(after.pixels[:].max(axis=2), 99.9) < 0.95


@pytest.mark.parametrize(
    ("contrast", "light", "times"), [("strong", 0.121, 1.92), ("s-curve", 0.0497, 0.65)]
)
def test_a_cameras_contrast_bends_what_is_shown(
    rendered: RenderedScene, contrast: Contrast, light: float, times: float
) -> None:
    """A quarter of the codes is .05 darker by the S: light .0497 is shown as .0326."""
    plain, bent = capture_jpeg(rendered), capture_jpeg(rendered, contrast)

    seen, shown = (decode(shot.no_flash, "auto").pixels[:] for shot in (plain, bent))

    np.testing.assert_array_equal(plain.truth, bent.truth)
    near = np.abs(seen / light - 1) < 0.1
    assert near.any()
    assert np.median(shown[near] / seen[near]) == pytest.approx(times, abs=0.06)


@pytest.mark.parametrize("power", [0.2, 0.4])
def test_local_tone_mapping_divides_even_light_by_a_power_of_itself(
    rendered: RenderedScene, power: float
) -> None:
    """A half that is four times as bright is 4 to the rest of the power brighter."""
    scene = flat(rendered, 0.1)
    lamps, frame = scene.lamps.copy(), scene.flash_frame.copy()
    lamps[:, :, 100:] *= 4
    frame[:, 100:] *= 4

    shot = capture_jpeg(replace(scene, lamps=lamps, flash_frame=frame), mapping=power)

    held = decode(shot.no_flash, "auto").pixels[:]
    truth = shot.truth.sum(axis=0)
    for light, within in ((truth, 1e-3), (held, 0.05)):
        ratio = light[:, 150:].mean() / light[:, :50].mean()
        assert ratio == pytest.approx(4 ** (1 - power), rel=within)
    assert np.abs(held - truth).mean() < 0.03 * truth.mean()


@pytest.mark.parametrize(("balance", "light"), [("daylight", "D65"), ("bulbs", "A")])
def test_a_card_under_the_light_a_jpeg_is_balanced_for_is_white(
    rendered: RenderedScene, balance: Balance, light: str
) -> None:
    shot = capture_jpeg(rendered, balance=balance)

    seen, shown = (values.reshape(-1, 3) for values in (rendered.lamps, shot.truth))
    to_srgb = np.linalg.lstsq(seen, shown, rcond=None)[0]
    card = sensitivities(rendered.scene.camera) @ find_light(light) @ to_srgb
    np.testing.assert_allclose(card / card[1], 1, atol=0.01)
    held = decode(shot.no_flash, "auto").pixels[:]
    assert np.abs(held - np.clip(shot.truth.sum(axis=0), 0, 1)).mean() < 0.06 * held.mean()
