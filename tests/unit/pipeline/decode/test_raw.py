"""Sensor values: linear, on one scale, black at 0."""

from __future__ import annotations

import io
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import rawpy
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.arrays import Floats64
from pipeline.decode import decode, read_header
from pipeline.decode.metadata import Metadata
from pipeline.decode.raw import preview_metadata
from pipeline.errors import UnreadableImageError
from pipeline.spectra.cameras import find_camera

BLACK, WHITE = 600, 15892


def mosaic(rgb: Floats64) -> NDArray[np.uint16]:
    """Sample (H, W, 3), 1.0 = white, through an RGGB filter to the numbers of the sensor."""
    raw = np.empty(rgb.shape[:2])
    raw[0::2, 0::2] = rgb[0::2, 0::2, 0]
    raw[0::2, 1::2] = rgb[0::2, 1::2, 1]
    raw[1::2, 0::2] = rgb[1::2, 0::2, 1]
    raw[1::2, 1::2] = rgb[1::2, 1::2, 2]
    return np.rint(BLACK + raw * (WHITE - BLACK)).astype(np.uint16)


def ramp(height: int = 64, width: int = 96) -> Floats64:
    x = np.linspace(0.02, 0.5, width)[None, :, None]
    y = np.linspace(1.0, 0.6, height)[:, None, None]
    return np.asarray(x * y * np.array([0.55, 1.0, 0.8]))


def test_values_are_shares_of_the_white_level(dng_file: Callable[..., bytes]) -> None:
    truth = ramp()

    frame = decode(dng_file(mosaic(truth)))

    assert frame.encoding == "raw"
    assert frame.pixels[:].dtype == np.float32
    assert np.abs(frame.pixels - truth)[4:-4, 4:-4].max() < 0.002
    assert not frame.saturated.any()


def test_two_frames_of_different_brightness_keep_one_scale(dng_file: Callable[..., bytes]) -> None:
    dark, bright = (decode(dng_file(mosaic(ramp() * share))) for share in (0.45, 1.8))

    inner = (slice(4, -4), slice(4, -4))
    ratio = bright.pixels[inner].sum((0, 1)) / dark.pixels[inner].sum((0, 1))

    np.testing.assert_allclose(ratio, 4.0, rtol=0.002)


def test_no_white_balance_is_applied(dng_file: Callable[..., bytes]) -> None:
    neutral = (50728, "2I", 3, (1, 2, 1, 1, 1, 3))  # AsShotNeutral
    grey = np.full((32, 32, 3), 0.3)

    frame = decode(dng_file(mosaic(grey), more=(neutral,)))

    np.testing.assert_allclose(frame.pixels[8:-8, 8:-8], 0.3, atol=0.0002)


def test_black_is_0_and_clipped_values_are_marked(dng_file: Callable[..., bytes]) -> None:
    scene = np.zeros((64, 64, 3))
    scene[:, 40:] = 1.2

    frame = decode(dng_file(np.minimum(mosaic(scene), WHITE)))

    assert frame.pixels[:, :32].max() == 0
    np.testing.assert_allclose(frame.pixels[8:-8, 48:-8], 1.0, atol=1e-4)
    assert frame.saturated[:, 41:].all()
    assert not frame.saturated[:, :32].any()


@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, -1), (8, 1)])
def test_orientation_is_applied(
    dng_file: Callable[..., bytes], orientation: int, turns: int
) -> None:
    upright = decode(dng_file(mosaic(ramp()))).pixels
    data = dng_file(mosaic(ramp()), more=((274, "H", 1, orientation),))

    frame = decode(data)

    np.testing.assert_allclose(frame.pixels, np.rot90(upright, turns), atol=0.01)
    assert frame.size == read_header(data).size == np.rot90(upright, turns).shape[1::-1]


def test_the_matrix_of_the_camera_is_the_dngs(dng_file: Callable[..., bytes]) -> None:
    matrix = np.array([[0.9, -0.3, -0.1], [-0.4, 1.2, 0.2], [-0.1, 0.2, 0.7]])
    numbers = [part for value in matrix.ravel() for part in (round(value * 10_000), 10_000)]
    tags = ((50721, "2i", 9, numbers), (50778, "H", 1, 21))  # ColorMatrix1, D65

    frame = decode(dng_file(mosaic(ramp()), more=tags))

    assert frame.xyz_to_camera is not None
    np.testing.assert_allclose(frame.xyz_to_camera, matrix, atol=1e-4)
    assert decode(dng_file(mosaic(ramp()))).xyz_to_camera is None


def test_facts_come_from_the_raw_files_own_directories(dng_file: Callable[..., bytes]) -> None:
    tags = (
        (271, "s", 0, "ACME"),
        (272, "s", 0, "ACME One"),
        (33434, "2I", 1, (1, 60)),  # ExposureTime
        (33437, "2I", 1, (4, 1)),  # FNumber
        (34855, "H", 1, 200),  # ISOSpeedRatings
    )

    frame = decode(dng_file(mosaic(ramp()), more=tags))

    assert (frame.make, frame.model) == ("ACME", "ACME One")
    assert frame.exposure.time_s == pytest.approx(1 / 60)
    assert (frame.exposure.f_number, frame.exposure.iso) == (4, 200)


def test_the_baseline_of_a_dng_is_known_and_not_applied(dng_file: Callable[..., bytes]) -> None:
    truth = ramp()

    frame = decode(dng_file(mosaic(truth), more=((50730, "2i", 1, (-3, 2)),)))

    assert frame.baseline_ev == -1.5
    np.testing.assert_array_equal(frame.pixels, decode(dng_file(mosaic(truth))).pixels)


def test_linear_dngs_are_read(tiff_file: Callable[..., bytes]) -> None:
    truth = ramp()
    values = np.rint(truth * 65535).astype(np.uint16)
    tags: list[tuple[Any, ...]] = [
        (50706, "B", 4, (1, 4, 0, 0), True),
        (50708, "s", 0, "Unheard Of One", True),
        (50717, "H", 3, (65535, 65535, 65535), True),
    ]

    frame = decode(tiff_file(values, photometric="linear_raw", extratags=tags))

    assert frame.encoding == "raw"
    np.testing.assert_allclose(frame.pixels, truth, atol=2e-4)


@pytest.mark.parametrize("white", [None, 1, 2])
def test_floats_above_white_are_refused(tiff_file: Callable[..., bytes], white: int | None) -> None:
    """LibRaw would give each of such files a scale of its own."""
    levels = [] if white is None else [(50717, "H", 1, white, True)]
    tags = [(50706, "B", 4, (1, 4, 0, 0), True), (50708, "s", 0, "Unheard Of One", True), *levels]
    limit = white or 1

    def file(brightest: float) -> bytes:
        values = np.full((64, 96, 3), 0.25 * limit, np.float32)
        values[5, 6, 1] = brightest
        return tiff_file(values, photometric=34892, extratags=tags)

    np.testing.assert_allclose(decode(file(limit)).pixels[20:, 20:], 0.25, atol=2e-4)
    with pytest.raises(UnreadableImageError, match="floats with values above its white level"):
        decode(file(1.5 * limit))


def test_the_preview_gives_the_facts_that_the_raw_file_lacks(
    pillow_file: Callable[..., bytes], exif_of: Callable[..., PillowImage.Exif]
) -> None:
    """Older Canons' CRW has none."""
    grey = np.full((64, 64, 3), 90, np.uint8)
    jpeg = pillow_file(grey, "JPEG", exif=exif_of({271: "FUJI"}, {0x8827: 800}))
    with_preview = SimpleNamespace(extract_thumb=lambda: SimpleNamespace(data=jpeg))
    with_bitmap = SimpleNamespace(extract_thumb=lambda: SimpleNamespace(data=grey))

    facts = preview_metadata(cast(rawpy.RawPy, with_preview))

    assert (facts.make, facts.exposure.iso) == ("FUJI", 800)
    assert preview_metadata(cast(rawpy.RawPy, with_bitmap)) == Metadata()


@pytest.mark.parametrize(
    "error",
    [
        rawpy.LibRawNoThumbnailError(),
        NotImplementedError("thumb type: 4"),
        OSError(22, "Invalid argument"),
    ],
)
def test_a_preview_that_cannot_be_read_has_no_facts(error: Exception) -> None:
    """Which is no reason to refuse the photograph that it is one of."""

    def extract_thumb() -> None:
        raise error

    raw = SimpleNamespace(extract_thumb=extract_thumb)
    assert preview_metadata(cast(rawpy.RawPy, raw)) == Metadata()


def test_a_raw_file_without_preview_has_no_facts(dng_file: Callable[..., bytes]) -> None:
    with rawpy.imread(io.BytesIO(dng_file(mosaic(ramp())))) as raw:
        assert preview_metadata(raw) == Metadata()


@pytest.mark.parametrize(
    "rationals",
    [
        [1, 0] * 9,
        [0, 1] * 9,
        [0, 0] * 9,
        [9, 10, 3, 10, 1, 10] * 3,
        [1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 20_000],
        [1, 0, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1],
    ],
    ids=["infinite", "zero", "no numbers", "of rank 1", "nearly of rank 2", "one infinite"],
)
def test_a_matrix_that_tells_no_three_colours_apart_counts_as_unknown(
    dng_file: Callable[..., bytes], rationals: list[int]
) -> None:
    tags = ((50721, "2i", 9, rationals), (50778, "H", 1, 21))

    frame = decode(dng_file(mosaic(ramp()), more=tags))

    assert frame.xyz_to_camera is None
    assert find_camera(None, frame).source == "stand-in"
