"""What other programs, and the pipeline's own reader, find in the simulated camera's files."""

from __future__ import annotations

import io

import exifread
import numpy as np
import pytest
import rawpy
import tifffile
from PIL import Image

import drivers
from drivers.clock import Clock
from drivers.sim.backend import open_camera
from drivers.sim.sensor import BLACK, WHITE
from drivers.sim.studio import mosaic
from pipeline.decode import decode


def take(clock: Clock, query: str) -> drivers.CapturedPair:
    with open_camera(f"sim://studio?{query}", clock) as camera:
        return drivers.capture_pair(camera, clock=clock)


@pytest.mark.parametrize("size", ["width=64&height=64", "width=302&height=198"])
def test_libraw_reads_every_number_as_written(clock: Clock, size: str) -> None:
    for shot in (pair := take(clock, size)).no_flash, pair.flash:
        with tifffile.TiffFile(io.BytesIO(shot.best)) as tiff:
            written = tiff.pages.first.asarray()
        with rawpy.imread(io.BytesIO(shot.best)) as raw:
            assert np.array_equal(raw.raw_image, written)
            assert raw.raw_image_visible.shape == written.shape
            assert raw.black_level_per_channel == [BLACK] * 4
            assert raw.white_level == WHITE
            assert raw.color_desc == b"RGBG"
            assert np.array(raw.raw_pattern).tolist() == [[0, 1], [3, 2]]  # 3 is the second green
            assert raw.sizes.flip == 0


def test_the_numbers_are_the_truths(clock: Clock) -> None:
    query = "width=302&height=198&noise=off&lights=3"
    pair, truth = take(clock, query), drivers.simulated_truth(f"sim://studio?{query}")
    lamps = truth.layers.sum(0)
    for shot, light in ((pair.no_flash, lamps), (pair.flash, lamps + truth.flash)):
        with rawpy.imread(io.BytesIO(shot.best)) as raw:
            numbers = raw.raw_image.astype(float)
        expected = BLACK + mosaic(light) * (WHITE - BLACK)
        assert np.abs(numbers - expected).max() <= 0.51


@pytest.mark.parametrize("kind", ["dng", "jpeg"])
def test_the_exif_tells_how_it_was_taken(clock: Clock, kind: str) -> None:
    pair = take(clock, "width=64&height=64&format=both")
    for shot, flash in ((pair.no_flash, 0x10), (pair.flash, 0x09)):
        tags = exifread.process_file(io.BytesIO(shot.files[kind]), details=False)
        told = {
            name: tags[name].values[0] if tags[name].field_type != 2 else tags[name].values
            for name in tags
            if name.startswith(("EXIF", "Image"))
        }
        assert float(told["EXIF ExposureTime"]) == 0.02
        assert float(told["EXIF FNumber"]) == 8
        assert told["EXIF ISOSpeedRatings"] == 100
        assert told["EXIF Flash"] == flash
        assert float(told["EXIF FocalLength"]) == pytest.approx(55.6)
        assert told["EXIF FocalLengthIn35mmFilm"] == 85
        assert told["EXIF DateTimeOriginal"] == "2024:02:29 23:59:58"
        assert told["Image Make"] == "NIKON CORPORATION"
        assert told["Image Model"] == "NIKON D5100"
        assert told["Image Orientation"] == 1


def test_the_pipeline_reads_the_dng(clock: Clock) -> None:
    query = "width=302&height=198&noise=off"
    pair, truth = take(clock, query), drivers.simulated_truth(f"sim://studio?{query}")
    no_flash, flash = decode(pair.no_flash.best), decode(pair.flash.best)
    assert no_flash.size == flash.size == (302, 198)
    assert (no_flash.encoding, no_flash.make, no_flash.model) == (
        "raw",
        "NIKON CORPORATION",
        "NIKON D5100",
    )
    assert (no_flash.flash_fired, flash.flash_fired) == (False, True)
    assert (no_flash.exposure.time_s, no_flash.exposure.iso, no_flash.exposure.f_number) == (
        0.02,
        100,
        8,
    )
    assert no_flash.focal_px == pytest.approx(truth.focal_px, rel=0.01)  # not quite 3:2
    assert not flash.saturated.any()
    expected = truth.layers.sum(0)
    inner = np.s_[4:-4, 4:-4]
    assert np.median(np.abs(no_flash.pixels - expected)[inner]) < 1e-3
    assert np.abs(no_flash.pixels - expected)[inner].mean() < 5e-3


def test_the_jpeg_shows_the_scene(clock: Clock) -> None:
    pair = take(clock, "width=302&height=198&noise=off&format=both")
    frame = decode(pair.flash.files["jpeg"])
    assert frame.size == (302, 198)
    assert (frame.encoding, frame.flash_fired) == ("srgb", True)
    raw, jpeg = decode(pair.flash.best).pixels[..., 1], frame.pixels[..., 1]
    assert np.corrcoef(raw.ravel(), jpeg.ravel())[0, 1] > 0.95
    assert Image.open(io.BytesIO(pair.flash.files["jpeg"])).mode == "RGB"


def test_noise_is_on_unless_switched_off(clock: Clock) -> None:
    noisy = decode(take(clock, "width=302&height=198").no_flash.best).pixels[:]
    clean = decode(take(clock, "width=302&height=198&noise=off").no_flash.best).pixels[:]
    spread = (noisy - clean)[4:40, 4:60, 1].std()  # on the wall
    level = clean[4:40, 4:60, 1].mean()
    shot_noise = float(np.sqrt(level / 40_000))
    assert 0.4 * shot_noise < spread < 1.1 * shot_noise  # demosaicing averages
    assert abs((noisy - clean)[4:40, 4:60, 1].mean()) < 5 * shot_noise / 40
