from __future__ import annotations

import io
import struct
from dataclasses import replace
from datetime import datetime
from fractions import Fraction

import numpy as np
import pytest
import tifffile
from PIL import Image

from drivers.exif import read_exposure
from drivers.sim import spectra
from drivers.sim.files import Shooting, write_dng, write_jpeg
from drivers.sim.sensor import BLACK, WHITE

SHOOTING = Shooting(
    time_s=Fraction(1, 50),
    f_number=Fraction(28, 5),
    iso=400,
    flash_fired=True,
    focal_35mm=85,
    taken=datetime(2024, 2, 29, 23, 59, 58),
)


def mosaic_of(
    rgb: tuple[float, float, float], side: int = 64
) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    raw = np.empty((side, side), np.uint16)
    levels = [round(BLACK + value * (WHITE - BLACK)) for value in rgb]
    raw[::2, ::2] = levels[0]
    raw[::2, 1::2] = raw[1::2, ::2] = levels[1]
    raw[1::2, 1::2] = levels[2]
    return raw


@pytest.mark.parametrize("fired", [True, False])
@pytest.mark.parametrize("write", [write_dng, write_jpeg])
def test_the_exposure_is_in_the_exif(write: type[object], fired: bool) -> None:
    data = write(mosaic_of((0.5, 0.5, 0.5)), replace(SHOOTING, flash_fired=fired))  # type: ignore[call-arg]
    assert isinstance(data, bytes)
    facts = read_exposure(data)
    assert (facts.time_s, facts.f_number, facts.iso) == (Fraction(1, 50), Fraction(28, 5), 400)
    assert facts.flash_fired is fired


def test_the_dng_is_a_sound_tiff_with_its_tags_in_order() -> None:
    raw = np.random.default_rng(0).integers(0, WHITE, (66, 100), np.uint16)
    data = write_dng(raw, SHOOTING)
    with tifffile.TiffFile(io.BytesIO(data)) as tiff:
        page = tiff.pages.first
        assert np.array_equal(page.asarray(), raw)
        tags = {tag.code: tag.value for tag in page.tags}
        codes = [tag.code for tag in page.tags]
    assert codes == sorted(codes)
    assert tags[34665]["FocalLength"] == (556, 10) or tags[34665]["FocalLength"] == (278, 5)
    assert tags[34665]["FocalLengthIn35mmFilm"] == 85
    assert tags[34665]["DateTimeOriginal"] == "2024:02:29 23:59:58"
    assert (tags[50714], tags[50717]) == (BLACK, WHITE)
    assert (tags[271], tags[272]) == ("NIKON CORPORATION", "NIKON D5100")
    assert struct.unpack_from("<2sH", data) == (b"II", 42)


def test_the_dngs_matrix_is_the_cameras() -> None:
    data = write_dng(mosaic_of((0.5, 0.5, 0.5)), SHOOTING)
    with tifffile.TiffFile(io.BytesIO(data)) as tiff:
        matrix = np.array(tiff.pages.first.tags[50721].value).reshape(9, 2)
        neutral = np.array(tiff.pages.first.tags[50728].value).reshape(3, 2)
    assert np.allclose(matrix[:, 0] / matrix[:, 1], spectra.xyz_to_camera().ravel(), atol=1e-4)
    assert np.allclose(neutral[:, 0] / neutral[:, 1], spectra.neutral(), atol=1e-4)
    white = np.array([0.9505, 1.0, 1.089])  # D65
    camera = spectra.xyz_to_camera() @ white
    assert np.allclose(camera / camera.max(), spectra.neutral(), atol=0.03)


def test_a_white_card_in_daylight_is_grey_in_the_jpeg() -> None:
    red, green, blue = (0.5 * spectra.neutral()).tolist()
    picture = Image.open(io.BytesIO(write_jpeg(mosaic_of((red, green, blue)), SHOOTING)))
    pixels = np.asarray(picture)[8:-8, 8:-8].astype(int)
    srgb_of_half = 188  # IEC 61966-2-1
    assert picture.size == (64, 64)
    assert np.abs(pixels - srgb_of_half).max() <= 1
    exif = picture.getexif()
    assert (exif[271], exif[272], exif[274]) == ("NIKON CORPORATION", "NIKON D5100", 1)


@pytest.mark.parametrize("channel", [0, 1, 2])
def test_colours_keep_their_place_in_the_jpeg(channel: int) -> None:
    light = [0.0, 0.0, 0.0]
    light[channel] = 0.6
    data = write_jpeg(mosaic_of((light[0], light[1], light[2])), SHOOTING)
    middle = np.asarray(Image.open(io.BytesIO(data)))[32, 32]
    assert int(np.argmax(middle)) == channel
