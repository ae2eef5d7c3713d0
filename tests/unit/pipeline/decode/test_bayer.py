"""Which mosaics are demosaiced by us, and on what scale; the others stay LibRaw's."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import rawpy
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.decode import decode, raw
from pipeline.decode.bayer import Mosaic, bayer_mosaic
from pipeline.decode.dng_levels import dng_levels
from pipeline.decode.samples import upright
from pipeline.decode.tiff import black_repeats

BLACK, WHITE = 600, 15892
PATTERNS = {"rggb": (0, 1, 1, 2), "grbg": (1, 0, 2, 1), "gbrg": (1, 2, 0, 1), "bggr": (2, 1, 1, 0)}
X_TRANS = "110112112110201021112110110112021201"
Dng = Callable[..., bytes]
Values = NDArray[np.uint16]


def scene(height: int, width: int) -> Floats64:
    y, x = np.mgrid[0:height, 0:width]
    waves = [
        0.2 + 0.1 * np.sin(x / 9),
        0.5 + 0.2 * np.sin(y / 11 + x / 20),
        0.3 + 0.1 * np.cos(y / 7),
    ]
    return np.stack(waves, axis=-1)


def mosaic(pattern: tuple[int, ...], height: int = 64, width: int = 96) -> Values:
    side = int(len(pattern) ** 0.5)
    places = np.ix_(*(np.arange(size) % side for size in (height, width)))
    channel = np.reshape(pattern, (side, side))[places]
    light = np.take_along_axis(scene(height, width), channel[..., None], axis=2)[..., 0]
    return np.asarray(np.rint(BLACK + light * (WHITE - BLACK)), np.uint16)


@pytest.fixture
def dng(tiff_file: Dng) -> Dng:
    """Write a mosaic as a DNG; tags (type, count, value) by number replace those of an RGGB one."""

    def write(values: Values, tags: dict[int, tuple[Any, ...]]) -> bytes:
        usual = {
            33421: ("H", 2, (2, 2)),
            33422: ("B", 4, (0, 1, 1, 2)),
            50706: ("B", 4, (1, 4, 0, 0)),
            50707: ("B", 4, (1, 1, 0, 0)),
            50708: ("s", 0, "Unheard Of One"),
            50714: ("H", 1, BLACK),
            50717: ("H", 1, WHITE),
        }
        extra = [(tag, *value, True) for tag, value in sorted((usual | tags).items())]
        return tiff_file(values, photometric="cfa", software=False, extratags=extra)

    return write


@pytest.fixture
def libraws(monkeypatch: pytest.MonkeyPatch) -> Callable[[bytes], Floats32]:
    """Decode with LibRaw's demosaicing whatever the sensor."""

    def read(data: bytes) -> Floats32:
        with monkeypatch.context() as patch:
            patch.setattr(raw, "bayer_mosaic", lambda *_those: None)
            return decode(data).pixels[:]

    return read


@pytest.fixture
def found() -> Iterator[Callable[[bytes], Mosaic | None]]:
    """Find the mosaic of a file, which stays open until the test ends."""
    files = []

    def find(data: bytes) -> Mosaic | None:
        files.append(rawpy.imread(io.BytesIO(data)))
        return bayer_mosaic(files[-1], black_repeats(data), dng_levels(data))

    yield find
    for file in files:
        file.close()


def assert_alike(ours: Floats32, theirs: Floats32) -> None:
    """On one scale, in the same place; LibRaw rounds to 16 bits, and both interpolate."""
    assert ours.shape == theirs.shape
    inner = (slice(6, -6), slice(6, -6))
    np.testing.assert_allclose(ours[inner], theirs[inner], atol=0.02)
    np.testing.assert_allclose(ours[inner].mean((0, 1)), theirs[inner].mean((0, 1)), atol=1e-3)


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("size", [(64, 96), (63, 95)])
def test_every_pattern_however_turned_is_on_libraws_scale(
    dng: Dng, libraws: Any, name: str, orientation: int, size: tuple[int, int]
) -> None:
    pattern = PATTERNS[name]
    tags = {33422: ("B", 4, pattern), 274: ("H", 1, orientation)}
    data = dng(mosaic(pattern, *size), tags)

    frame = decode(data)

    assert_alike(frame.pixels[:], libraws(data))
    turned = upright(scene(*size), orientation)
    np.testing.assert_allclose(frame.pixels[6:-6, 6:-6], turned[6:-6, 6:-6], atol=0.01)


@pytest.mark.parametrize("area", [(0, 0, 60, 90), (3, 5, 61, 90), (4, 7, 64, 96), (5, 2, 63, 95)])
def test_margins_are_left_out_and_shift_the_pattern(
    dng: Dng, libraws: Any, found: Any, area: tuple[int, ...]
) -> None:
    """The pattern of a DNG begins at its active area."""
    shifted = np.roll(np.reshape(PATTERNS["rggb"], (2, 2)), area[:2], (0, 1))
    data = dng(mosaic(tuple(shifted.ravel().tolist())), {50829: ("I", 4, area)})

    assert found(data) is not None
    assert_alike(decode(data).pixels[:], libraws(data))


def test_levels_of_black_belong_to_photosites(dng: Dng, libraws: Any, found: Any) -> None:
    levels = (600, 610, 620, 640)
    data = dng(mosaic(PATTERNS["rggb"]), {50713: ("H", 2, (2, 2)), 50714: ("H", 4, levels)})

    sensor = found(data)

    np.testing.assert_array_equal(sensor.black, np.reshape(levels, (2, 2)))
    assert sensor.white == WHITE - 600
    assert_alike(decode(data).pixels[:], libraws(data))


@pytest.mark.parametrize(
    "tags",
    [
        {50713: ("H", 2, (2, 1)), 50714: ("H", 2, (600, 700))},
        {50712: ("H", 16384, tuple(value * 3 // 4 + 150 for value in range(16384)))},
        {50719: ("I", 2, (4, 4)), 50720: ("I", 2, (80, 50))},
    ],
    ids=["black by rows", "table", "crop"],
)
def test_what_a_dng_says_of_its_values_is_heeded(
    dng: Dng, libraws: Any, found: Any, tags: dict[int, tuple[Any, ...]]
) -> None:
    data = dng(mosaic(PATTERNS["rggb"]), tags)

    assert found(data) is not None
    assert_alike(decode(data).pixels[:], libraws(data))


def test_values_are_not_rounded_and_noise_below_black_is_kept(dng: Dng) -> None:
    dark = np.full((64, 96), BLACK - 3, np.uint16)
    dark[::2, ::2] = BLACK + 1

    pixels = decode(dng(dark, {})).pixels

    np.testing.assert_allclose(pixels[8:-8:2, 8:-8:2, 0], 1 / (WHITE - BLACK), rtol=1e-5)
    np.testing.assert_allclose(pixels[8:-8:2, 9:-8:2, 1], -3 / (WHITE - BLACK), rtol=1e-5)


def test_values_above_white_are_white_and_clipped(dng: Dng) -> None:
    frame = decode(dng(np.full((64, 96), 20_000, np.uint16), {}))

    np.testing.assert_array_equal(frame.pixels, 1)
    assert frame.saturated.all()


@pytest.mark.parametrize("orientation", [1, 6])
def test_a_sensor_whose_greens_end_below_white_is_clipped_there(dng: Dng, orientation: int) -> None:
    """Dark but for a window, green photosites at most 15,000, those of red and blue 11,000."""
    values = mosaic(PATTERNS["rggb"])
    values[20:50, 30:60] = 11_000
    values[20:50:2, 31:60:2] = values[21:50:2, 30:60:2] = 15_000

    frame = decode(dng(values, {274: ("H", 1, orientation)}))

    expected = np.zeros(values.shape, bool)
    expected[18:52, 28:62] = True  # what was demosaiced from these
    expected[18, 28] = expected[51, 61] = False  # beside red and blue alone
    turned = expected if orientation == 1 else np.rot90(expected, -1)
    np.testing.assert_array_equal(frame.saturated, turned)


def test_an_x_trans_sensor_that_ends_below_white_is_clipped_there(dng: Dng) -> None:
    values = mosaic(tuple(map(int, X_TRANS)), 516, 520)
    values[200:260, 300:360] = 15_000

    frame = decode(
        dng(values, {33421: ("H", 2, (6, 6)), 33422: ("B", 36, tuple(map(int, X_TRANS)))})
    )

    assert frame.saturated[200:260, 300:360].all()
    assert not frame.saturated[:190].any() and not frame.saturated[:, 370:].any()


@pytest.mark.parametrize(
    "tags",
    [
        {33421: ("H", 2, (6, 6)), 33422: ("B", 36, tuple(map(int, X_TRANS)))},
        {50713: ("H", 2, (4, 4)), 50714: ("H", 16, tuple(range(600, 616)))},
        {50713: ("H", 2, (1, 4)), 50714: ("H", 4, (600, 610, 620, 640))},
        {50718: ("2I", 2, (2, 1, 1, 1))},
    ],
    ids=["X-Trans", "black 4 × 4", "black 1 × 4", "oblong pixels"],
)
def test_the_rest_is_libraws(
    dng: Dng, libraws: Any, found: Any, tags: dict[int, tuple[Any, ...]]
) -> None:
    pattern = tags[33422][2] if 33422 in tags else PATTERNS["rggb"]
    data = dng(mosaic(pattern, 516, 520), tags)  # LibRaw's X-Trans needs 512

    assert found(data) is None
    np.testing.assert_array_equal(decode(data).pixels, libraws(data))


@pytest.mark.parametrize(
    "tags",
    [
        {33422: ("B", 4, (3, 4, 5, 1))},
        {33422: ("B", 4, (1, 1, 1, 1))},
    ],
    ids=["four colours", "one colour"],
)
def test_no_mosaic_of_other_sensors_is_taken(
    dng: Dng, found: Any, tags: dict[int, tuple[Any, ...]]
) -> None:
    assert found(dng(mosaic(PATTERNS["rggb"]), tags)) is None


@pytest.mark.parametrize(
    "change",
    [
        {"raw_type": rawpy.RawType.Stack},
        {"num_colors": 4},
        {"color_desc": b"RGBE"},
        {"raw_image_visible": np.zeros((40, 41), np.uint16), "size": (40, 41)},
        {"size": (80, 120)},
        {"raw_pattern": None},
        {"white_level": 0},
    ],
    ids=[
        "picture",
        "four colours",
        "emerald",
        "on a corner",
        "other size",
        "no pattern",
        "no white above black",
    ],
)
def test_what_rawpy_says_of_other_sensors_is_understood(change: dict[str, Any]) -> None:
    height, width = change.pop("size", (64, 96))
    sizes = SimpleNamespace(
        iheight=height, iwidth=width, pixel_aspect=1.0, top_margin=0, left_margin=0, flip=0
    )
    usual = {
        "raw_type": rawpy.RawType.Flat,
        "num_colors": 3,
        "color_desc": b"RGBG",
        "raw_image_visible": np.zeros((64, 96), np.uint16),
        "raw_pattern": np.array([[0, 1], [3, 2]]),
        "raw_color": lambda y, x: [[0, 1], [3, 2]][y % 2][x % 2],
        "black_level_per_channel": [0, 0, 0, 0],
        "white_level": 4095,
        "sizes": sizes,
    }

    assert bayer_mosaic(cast(rawpy.RawPy, SimpleNamespace(**usual | change)), 1, None) is None


def test_a_pattern_that_rawpy_does_not_know_is_libraws() -> None:
    class Leaf:
        raw_type, num_colors, color_desc = rawpy.RawType.Flat, 3, b"RGBG"
        raw_image_visible = np.zeros((64, 96), np.uint16)
        sizes = SimpleNamespace(iheight=64, iwidth=96, pixel_aspect=1.0)

        @property
        def raw_pattern(self) -> None:
            raise NotImplementedError

    assert bayer_mosaic(cast(rawpy.RawPy, Leaf()), 1, None) is None


@pytest.mark.parametrize(("make", "ours"), [("Phase One A/S", False), ("ACME", True)])
def test_sensors_that_libraw_corrects_after_unpacking_are_left_to_it(
    dng: Dng, libraws: Any, make: str, ours: bool
) -> None:
    data = dng(mosaic(PATTERNS["rggb"]), {271: ("s", 0, make)})

    assert np.array_equal(decode(data).pixels, libraws(data)) != ours


@pytest.mark.parametrize(("repeats", "expected"), [((2, 2), 2), ((1, 4), 4), ((6, 1), 6)])
def test_a_dng_says_after_how_many_photosites_black_repeats(
    dng: Dng, repeats: tuple[int, int], expected: int
) -> None:
    count = repeats[0] * repeats[1]
    tags = {50713: ("H", 2, repeats), 50714: ("H", count, (600,) * count)}

    assert black_repeats(dng(mosaic(PATTERNS["rggb"]), tags)) == expected


def test_files_that_say_nothing_of_it_have_one_level(dng: Dng) -> None:
    assert black_repeats(dng(mosaic(PATTERNS["rggb"]), {})) == 1


@pytest.mark.parametrize("data", [b"", b"text", b"II*\x00\x08\x00\x00\x00"])
def test_other_bytes_have_one_level(data: bytes) -> None:
    assert black_repeats(data) == 1
