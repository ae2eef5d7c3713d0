"""Photographs of the simulated camera, decoded, against the light that was there."""

from __future__ import annotations

import numpy as np
import pytest

from drivers import CapturedPair, capture_pair, open_camera, simulated_truth
from drivers.truth import SimulatedTruth
from pipeline.arrays import Floats
from pipeline.decode import decode, raw
from pipeline.images.frames import Exposure, Frame
from pipeline.spectra.cameras import find_camera

ADDRESS = "sim://studio?lights=2&width=360&height=240&format=both"


@pytest.fixture(scope="module")
def pair() -> CapturedPair:
    with open_camera(ADDRESS) as camera:
        return capture_pair(camera)


@pytest.fixture(scope="module")
def truth() -> SimulatedTruth:
    return simulated_truth(ADDRESS)


@pytest.fixture(scope="module")
def frames(pair: CapturedPair) -> tuple[Frame, Frame]:
    return decode(pair.no_flash.files["dng"]), decode(pair.flash.files["dng"])


def snr_db(estimate: Floats, true: Floats) -> float:
    error = np.square(estimate - true, dtype=np.float64).sum()
    return float(10 * np.log10(np.square(true, dtype=np.float64).sum() / error))


def test_raw_frames_hold_the_light_of_the_scene(
    frames: tuple[Frame, Frame], truth: SimulatedTruth
) -> None:
    """On one scale for both, with no gain to be found: sensor noise and mosaic are all."""
    light = truth.layers.sum(0)
    for frame, true in zip(frames, (light, light + truth.flash), strict=True):
        assert frame.encoding == "raw"
        assert frame.size == (360, 240)
        assert snr_db(frame.pixels[:], true) > 34
        gain = (frame.pixels * true).sum() / np.square(true).sum()
        assert gain == pytest.approx(1.0, abs=0.003)


def test_demosaicing_is_no_worse_than_libraws(
    pair: CapturedPair, truth: SimulatedTruth, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In dB, of both photographs and of the ratio that lamps are told by."""
    light = truth.layers.sum(0)
    files = [shot.files["dng"] for shot in (pair.no_flash, pair.flash)]
    lit = [light, light + truth.flash]

    ours = [decode(file).pixels[:] for file in files]
    monkeypatch.setattr(raw, "bayer_mosaic", lambda *_: None)
    libraws = [decode(file).pixels[:] for file in files]

    for one, other, true in zip(ours, libraws, lit, strict=True):
        assert snr_db(one, true) > snr_db(other, true) - 0.5
    bright = (light > 0.02).all(2)
    ratios = [np.log(a[bright] / b[bright]) for a, b in (ours, libraws, lit)]
    assert snr_db(ratios[0], ratios[2]) > snr_db(ratios[1], ratios[2])


def test_the_flash_part_is_their_difference(
    frames: tuple[Frame, Frame], truth: SimulatedTruth
) -> None:
    assert snr_db(frames[1].pixels[:] - frames[0].pixels[:], truth.flash) > 30


@pytest.mark.parametrize("kind", ["dng", "jpeg"])
def test_exif_says_how_the_pair_was_taken(
    pair: CapturedPair, truth: SimulatedTruth, kind: str
) -> None:
    no_flash, flash = decode(pair.no_flash.files[kind]), decode(pair.flash.files[kind])

    assert (no_flash.flash_fired, flash.flash_fired) == (False, True)
    assert no_flash.exposure == flash.exposure
    assert no_flash.exposure.time_s == float(pair.no_flash.exposure.time_s)
    assert no_flash.exposure == Exposure(time_s=1 / 50, iso=100, f_number=8)
    assert no_flash.focal_px == pytest.approx(truth.focal_px)
    assert f"{no_flash.make} {no_flash.model}" == truth.camera


def test_raw_gets_the_measured_camera_and_jpeg_the_stand_in(pair: CapturedPair) -> None:
    raw, rendered = (decode(pair.no_flash.files[kind]) for kind in ("dng", "jpeg"))

    assert find_camera(None, raw).source == "measured"
    assert find_camera(None, rendered).source == "stand-in"
    assert raw.xyz_to_camera is not None
    assert rendered.xyz_to_camera is None


def test_jpeg_shows_the_same_scene_in_srgb(pair: CapturedPair, frames: tuple[Frame, Frame]) -> None:
    """A matrix from the sensor's values to the JPEG's explains nearly all of them."""
    rendered = decode(pair.no_flash.files["jpeg"]).pixels[:].reshape(-1, 3)
    sensor = frames[0].pixels[:].reshape(-1, 3)
    inside = (rendered > 0.002).all(1) & (rendered < 0.9).all(1)

    matrix = np.linalg.lstsq(sensor[inside], rendered[inside], rcond=None)[0]

    assert inside.mean() > 0.5
    assert snr_db(sensor[inside] @ matrix, rendered[inside]) > 25
