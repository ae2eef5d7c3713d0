"""Of a DNG that part is read that other programs show; of other RAW files all there is."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import rawpy
from numpy.typing import NDArray

from pipeline.decode import decode, read_header
from pipeline.decode.dng_crop import Part, shown_part
from pipeline.decode.samples import upright
from pipeline.decode.tiff import names_crop

Write = Callable[..., bytes]
X_TRANS = tuple(map(int, "110112112110201021112110110112021201"))
INNER = (slice(10, -10), slice(10, -10))
"""Where the edge of the crop changes nothing of how colours are interpolated."""


def crop(origin: tuple[int, int], size: tuple[int, int]) -> tuple[tuple[Any, ...], ...]:
    """Tags of a crop; origin, size: across and down."""
    return (50719, "I", 2, origin), (50720, "I", 2, size)


def noise(height: int, width: int) -> NDArray[np.uint16]:
    return np.random.default_rng(4).integers(600, 15000, (height, width), dtype=np.uint16)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_mosaic_is_cut_to_its_crop_however_turned(dng_file: Write, orientation: int) -> None:
    turn = (274, "H", 1, orientation)
    values = noise(64, 96)
    values[30, 50] = 16000  # clipped
    whole = decode(dng_file(values))
    data = dng_file(values, more=(turn, *crop((8, 4), (80, 50))))

    frame = decode(data)

    part = np.s_[4:54, 8:88]
    assert frame.size == read_header(data).size == ((80, 50) if orientation < 5 else (50, 80))
    expected = upright(whole.pixels[part], orientation)
    np.testing.assert_allclose(frame.pixels[INNER], expected[INNER], atol=2e-5)
    np.testing.assert_array_equal(frame.saturated, upright(whole.saturated[part], orientation))
    assert frame.saturated.any()


@pytest.mark.parametrize(
    ("origin", "more", "part"),
    [
        ((5, 3), (), np.s_[4:53, 6:85]),
        ((8, 4), ((50829, "I", 4, (2, 4, 64, 96)),), np.s_[4:54, 8:88]),
        ((9, 3), ((50829, "I", 4, (3, 5, 64, 96)),), np.s_[2:52, 8:88]),
    ],
    ids=["odd", "in an even area", "in an odd area"],
)
def test_crops_begin_alike_in_the_pattern(
    dng_file: Write, origin: tuple[int, int], more: tuple[Any, ...], part: Part
) -> None:
    """LibRaw leaves out what is before an even place; origins count from the active area."""
    values = noise(64, 96)
    whole = decode(dng_file(values, more=more))

    frame = decode(dng_file(values, more=(*more, *crop(origin, (80, 50)))))

    assert frame.pixels.shape == whole.pixels[part].shape
    np.testing.assert_allclose(frame.pixels[INNER], whole.pixels[part][INNER], atol=1e-6)


@pytest.mark.parametrize("orientation", [1, 6, 8])
def test_what_libraw_demosaics_is_cut_as_well(dng_file: Write, orientation: int) -> None:
    values = noise(516, 520)
    pattern = ((33421, "H", 2, (6, 6)), (33422, "B", 36, X_TRANS))
    turned = (*pattern, (274, "H", 1, orientation))
    whole = decode(dng_file(values, more=pattern))
    data = dng_file(values, more=(*turned, *crop((7, 12), (480, 471))))

    frame = decode(data)

    part = np.s_[12:483, 7:487]
    expected = upright(whole.pixels[part], orientation)
    np.testing.assert_array_equal(frame.pixels, expected)
    assert frame.size == read_header(data).size == expected.shape[1::-1]


def test_linear_dngs_are_cut_as_well(tiff_file: Write) -> None:
    version = ((50706, "B", 4, (1, 4, 0, 0)), (50708, "s", 0, "Unheard Of One"))
    values = np.stack([noise(64, 96)] * 3, axis=-1)

    def linear(*tags: tuple[Any, ...]) -> bytes:
        extra = [(*tag, True) for tag in (*version, *tags)]
        return tiff_file(values, photometric=34892, software=False, extratags=extra)

    frame = decode(linear(*crop((5, 3), (81, 50))))

    np.testing.assert_array_equal(frame.pixels, decode(linear()).pixels[3:53, 5:86])


@pytest.mark.parametrize(
    "tags",
    [
        crop((0, 0), (0, 0)),
        crop((8, 4), (96, 64)),
        crop((95, 63), (80, 50)),
        crop((8, 4), (2**31, 2**31)),
        ((50719, "H", 1, 8), (50720, "H", 1, 50)),
        ((50719, "s", 0, "here"), (50720, "s", 0, "there")),
    ],
    ids=["empty", "too large", "outside", "endless", "one number", "text"],
)
def test_a_crop_that_cannot_be_is_passed_over(
    dng_file: Write, tags: tuple[tuple[Any, ...], ...]
) -> None:
    values = noise(64, 96)
    data = dng_file(values, more=tags)

    frame = decode(data)

    assert frame.size == read_header(data).size == (96, 64)
    np.testing.assert_array_equal(frame.pixels, decode(dng_file(values)).pixels)


def opened(**sizes: Any) -> rawpy.RawPy:
    """What rawpy says of a file of 90 × 60 pixels with margins around them and in them a crop."""
    usual = {"height": 60, "width": 90, "iheight": 60, "iwidth": 90, "pixel_aspect": 1.0}
    margins = {"top_margin": 2, "left_margin": 4, "crop_top_margin": 6, "crop_left_margin": 10}
    crops = {"crop_height": 50, "crop_width": 80}
    return cast(
        rawpy.RawPy, SimpleNamespace(sizes=SimpleNamespace(**usual | margins | crops | sizes))
    )


@pytest.fixture
def cropped(dng_file: Write) -> bytes:
    return dng_file(noise(64, 96), more=crop((6, 4), (80, 50)))


def test_a_crop_counts_from_the_margins(cropped: bytes) -> None:
    assert shown_part(opened(), cropped) == np.s_[4:54, 6:86]


@pytest.mark.parametrize(
    ("sizes", "part"),
    [
        ({"crop_top_margin": 2, "crop_left_margin": 4}, np.s_[0:50, 0:80]),
        ({"crop_top_margin": 12, "crop_left_margin": 14}, np.s_[10:60, 10:90]),
    ],
)
def test_a_crop_may_lie_at_an_edge(cropped: bytes, sizes: dict[str, Any], part: Part) -> None:
    assert shown_part(opened(**sizes), cropped) == part


@pytest.mark.parametrize("side", ["crop_height", "crop_width"])
def test_a_crop_of_nothing_is_passed_over(cropped: bytes, side: str) -> None:
    assert shown_part(opened(**{side: 0}), cropped) is None


def test_crops_of_other_raw_files_are_passed_over(dng_file: Write) -> None:
    assert shown_part(opened(), dng_file(noise(64, 96))) is None
    assert shown_part(opened(), b"FUJIFILMCCD-RAW 0201") is None


@pytest.mark.parametrize(
    "sizes",
    [
        {"crop_top_margin": 1},
        {"crop_left_margin": 3},
        {"crop_top_margin": 13},
        {"crop_left_margin": 15},
        {"iwidth": 180},
        {"pixel_aspect": 2.0},
    ],
)
def test_crops_outside_and_of_stretched_pictures_are_passed_over(
    cropped: bytes, sizes: dict[str, Any]
) -> None:
    assert shown_part(opened(**sizes), cropped) is None


def test_only_a_dng_with_a_size_names_a_crop(cropped: bytes, dng_file: Write) -> None:
    assert names_crop(cropped)
    assert not names_crop(dng_file(noise(64, 96)))
    assert not any(map(names_crop, (b"", b"II*\0", cropped[:100], bytes(1000))))
