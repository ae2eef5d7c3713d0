"""Values of a DNG are (v − black) / (white − black), by the levels of each photosite and colour."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import rawpy
import tifffile
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.decode import decode
from pipeline.decode.dng_levels import Levels, dng_levels
from pipeline.decode.dng_linear import scaled
from tests.refusal import refusal

Write = Callable[..., bytes]
Tags = tuple[tuple[Any, ...], ...]
REPEAT, BLACK, BY_COLUMN, BY_ROW, WHITE = 50713, 50714, 50715, 50716, 50717
AREA, MASKED, SCALE = 50829, 50830, 50718
HEIGHT, WIDTH = 64, 96
INNER = (slice(8, -8), slice(8, -8))
COLOURS = np.array([0.25, 0.5, 0.375])
RGGB = np.array([[0, 1], [1, 2]])
X_TRANS = tuple(map(int, "110112112110201021112110110112021201"))


def light() -> Floats64:
    """Each colour from black to white, which some reach."""
    x = np.linspace(0, 1.2, WIDTH)[None, :, None]
    y = np.linspace(1, 0.6, HEIGHT)[:, None, None]
    return np.asarray(np.minimum(x * y * [0.7, 1.0, 0.9], 1))


def codes(light: NDArray[Any], black: Any, white: Any) -> NDArray[np.uint16]:
    exact = black + light * (np.asarray(white) - black)
    return np.asarray(np.rint(exact), np.uint16)


def each(*values: int) -> list[int]:
    """Signed rationals of whole numbers."""
    return [part for value in values for part in (value, 1)]


@pytest.mark.parametrize(
    ("black", "tag"),
    [
        ((0,) * 3, ()),
        ((2000,) * 3, ((BLACK, "H", 1, 2000),)),
        ((2000,) * 3, ((REPEAT, "H", 2, (1, 1)), (BLACK, "I", 1, 2000))),
        ((2000,) * 3, ((REPEAT, "H", 2, (2, 2)), (BLACK, "I", 4, (2000,) * 4))),
        ((2000,) * 3, ((BLACK, "H", 3, (2000,) * 3),)),
        ((1000, 2000, 3000), ((BLACK, "H", 3, (1000, 2000, 3000)),)),
        ((2000.5,) * 3, ((BLACK, "2I", 1, (4001, 2)),)),
        ((2000.25, 10.75, 0.5), ((BLACK, "2I", 3, (8001, 4, 43, 4, 1, 2)),)),
    ],
    ids=["none", "one", "a pattern", "four", "alike", "unlike", "a fraction", "fractions"],
)
@pytest.mark.parametrize(
    ("white", "kind"),
    [(None, None), (60000, 1), (60000, 3), ((50000, 60000, 55000), 3), ((60000, 52000, 50000), 3)],
    ids=["none", "one", "alike", "unlike", "first most"],
)
def test_every_colour_of_a_linear_dng_has_its_levels(
    dng: Write, black: Any, tag: Tags, white: Any, kind: int | None
) -> None:
    """LibRaw takes one black twice from several whites, and has one white for all colours."""
    most = np.broadcast_to(65535 if white is None else white, 3)
    told = np.unique(most).tolist() if kind == 1 else most.tolist()
    tags = (*tag, (WHITE, "I", kind, told)) if kind else tag

    frame = decode(dng(codes(light(), np.array(black), most), *tags))

    np.testing.assert_allclose(frame.pixels, light(), atol=3e-5)
    assert frame.saturated[(light() == 1).any(axis=2)].all()
    assert not frame.saturated[:, :70].any()


@pytest.mark.parametrize("area", [None, (3, 5, 61, 90), (2, 4, 64, 96)])
def test_levels_of_linear_dngs_repeat_and_differ_by_rows_and_columns(dng: Write, area: Any) -> None:
    top, left, bottom, right = area or (0, 0, HEIGHT, WIDTH)
    repeated = np.arange(12).reshape(2, 2, 3) * 50 + 1000
    by_row, by_column = np.arange(bottom - top) % 7 * 10, np.arange(right - left) % 5 * -10
    black = np.tile(repeated, (32, 48, 1))[: bottom - top, : right - left]
    black = black + by_row[:, None, None] + by_column[:, None]
    span = 60000 - (repeated.max((0, 1)) + by_row.max() + by_column.max())
    values = np.zeros((HEIGHT, WIDTH, 3), np.uint16)
    inner = light()[top:bottom, left:right]
    values[top:bottom, left:right] = np.rint(black + inner * span)
    tags = [
        (REPEAT, "H", 2, (2, 2)),
        (BLACK, "H", 12, repeated.ravel().tolist()),
        (BY_COLUMN, "2i", right - left, each(*map(int, by_column))),
        (BY_ROW, "2i", bottom - top, each(*map(int, by_row))),
        (WHITE, "H", 1, 60000),
    ]

    frame = decode(dng(values, *tags, *([(AREA, "I", 4, area)] if area else [])))

    np.testing.assert_allclose(frame.pixels, inner, atol=3e-5)


@pytest.mark.parametrize(
    "tags",
    [
        (),
        ((BLACK, "H", 1, 2000), (WHITE, "H", 1, 60000)),
        ((BLACK, "H", 3, (2000,) * 3), (WHITE, "H", 1, 60000)),
        ((BLACK, "H", 3, (2000,) * 3), (WHITE, "H", 3, (60000,) * 3)),
        ((REPEAT, "H", 2, (2, 2)), (BLACK, "H", 12, (2000,) * 12), (WHITE, "H", 3, (60000,) * 3)),
    ],
)
def test_levels_that_libraw_follows_are_left_to_it(dng: Write, tags: Tags) -> None:
    data = dng(codes(light(), 2000, 60000), *tags)
    levels = dng_levels(data)
    assert levels is not None

    with rawpy.imread(io.BytesIO(data)) as raw:
        assert raw.raw_image_visible.shape == (HEIGHT, WIDTH, 4)
        assert scaled(raw, levels) is None


def test_oblong_pixels_of_such_levels_are_refused(dng: Write) -> None:
    tags = ((BLACK, "H", 1, 2000), (WHITE, "I", 3, (60000,) * 3), (SCALE, "2I", 2, (2, 1, 1, 1)))

    assert "oblong pixels (DefaultScale)" in refusal(dng(codes(light(), 2000, 60000), *tags))


def flat(black: Any, white: float = 60000, shape: tuple[int, int] = (HEIGHT, WIDTH)) -> Any:
    """RGGB mosaic of one colour, of which values between whole numbers come out by chance."""
    pattern = np.tile(RGGB, (shape[0] // 2, shape[1] // 2))
    exact = black + COLOURS[pattern] * (white - np.max(black))
    noise = np.random.default_rng(0).random(shape)
    return np.floor(exact + noise).astype(np.uint16)


def assert_flat(pixels: Floats32, atol: float) -> None:
    np.testing.assert_allclose(pixels[INNER].mean((0, 1)), COLOURS, atol=atol)


@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.9])
def test_black_of_a_mosaic_is_no_whole_number(dng: Write, fraction: float) -> None:
    """LibRaw cuts it off, which is a tenth of the light in shadows of 10 bits."""
    black = 60 + fraction
    level = (BLACK, "2I", 1, (round(black * 10), 10))

    frame = decode(dng(flat(black, 1023), level, (WHITE, "H", 1, 1023)))

    assert_flat(frame.pixels[:], 8e-5)


def test_black_of_each_photosite_is_no_whole_number(dng: Write) -> None:
    levels = np.array([[60.9, 61.4], [60.6, 60.1]])
    rationals = [part for level in levels.ravel() for part in (round(level * 10), 10)]
    tags = ((REPEAT, "H", 2, (2, 2)), (BLACK, "2I", 4, rationals), (WHITE, "H", 1, 1023))
    values = flat(np.tile(levels, (32, 48)), 1023)

    frame = decode(dng(values, *tags))

    expected = COLOURS * (1023 - 61.4) / (1023 - 60.1)  # white is measured from the least
    np.testing.assert_allclose(frame.pixels[INNER].mean((0, 1)), expected, atol=8e-5)


@pytest.mark.parametrize("orientation", [1, 3, 6])
@pytest.mark.parametrize("corner", [(0, 0), (3, 5), (2, 5), (4, 4)])
@pytest.mark.parametrize("repeat", [(2, 2), (1, 2), (2, 1)])
def test_levels_of_photosites_begin_at_the_active_area(
    dng: Write, repeat: tuple[int, int], corner: tuple[int, int], orientation: int
) -> None:
    """Where it begins at an odd place LibRaw leaves out a row or column, and mistakes them."""
    levels = 1000 + 400 * np.arange(repeat[0] * repeat[1]).reshape(repeat)
    area = (*corner, HEIGHT, WIDTH)
    black = np.tile(levels, (HEIGHT, WIDTH))[:HEIGHT, :WIDTH]
    values = np.roll(flat(black), corner, (0, 1))
    tags = (
        (REPEAT, "H", 2, repeat),
        (BLACK, "H", levels.size, levels.ravel().tolist()),
        (WHITE, "H", 1, 60000),
        (AREA, "I", 4, area),
        (274, "H", 1, orientation),
    )

    frame = decode(dng(values, *tags))

    expected = COLOURS * (60000 - levels.max()) / (60000 - levels.min())
    np.testing.assert_allclose(frame.pixels[INNER].mean((0, 1)), expected, atol=8e-5)


@pytest.mark.parametrize(
    ("by_row", "by_column"),
    [
        (np.zeros(HEIGHT, int), np.arange(WIDTH) * 40),
        (np.arange(HEIGHT) * -20, np.zeros(WIDTH, int)),
        (np.arange(HEIGHT) % 3 * 100, np.arange(WIDTH) % 2 * 300),
        (np.full(HEIGHT, 50), np.zeros(WIDTH, int)),
        (np.full(HEIGHT, -50), np.full(WIDTH, 30)),
    ],
    ids=["columns", "rows", "both", "all rows alike", "all alike"],
)
def test_black_of_rows_and_columns_is_taken_away(
    dng: Write, by_row: NDArray[Any], by_column: NDArray[Any]
) -> None:
    """LibRaw takes away their mean, and leaves a ramp."""
    black = 5000 + by_row[:, None] + by_column
    tags = (
        (BLACK, "H", 1, 5000),
        (BY_COLUMN, "2i", WIDTH, each(*map(int, by_column))),
        (BY_ROW, "2i", HEIGHT, each(*map(int, by_row))),
        (WHITE, "H", 1, 60000),
    )

    pixels = decode(dng(flat(black), *tags)).pixels[:]

    assert_flat(pixels, 8e-5)
    np.testing.assert_allclose(pixels[INNER], np.broadcast_to(COLOURS, (48, 80, 3)), atol=4e-5)


@pytest.mark.parametrize("byteorder", ["<", ">"])
def test_black_of_many_rows_is_read_to_the_last(dng: Write, byteorder: str) -> None:
    by_row = np.arange(1500) % 1400
    values = np.tile(by_row[:, None, None], (1, 24, 3)).astype(np.uint16) + 1000
    tag = (BY_ROW, "2i", 1500, each(*map(int, by_row)))

    frame = decode(dng(values, tag, byteorder=byteorder))

    np.testing.assert_allclose(frame.pixels[:], 1000 / (65535 - 1399), atol=1e-5)


def test_levels_that_repeat_later_begin_at_the_active_area(dng: Write) -> None:
    """From an even place on LibRaw makes the picture, see test_bayer."""
    levels = 1000 + 100 * np.arange(16).reshape(4, 4)
    values = np.roll(flat(np.tile(levels, (16, 24))), (3, 5), (0, 1))
    tags = (
        (REPEAT, "H", 2, (4, 4)),
        (BLACK, "H", 16, levels.ravel().tolist()),
        (WHITE, "H", 1, 60000),
        (AREA, "I", 4, (3, 5, HEIGHT, WIDTH)),
    )

    assert_flat(decode(dng(values, *tags)).pixels[:], 8e-5)


def test_masked_photosites_tell_black(dng: Write) -> None:
    """As the specification allows, LibRaw measures it."""
    values = flat(2000)
    values[:, :8] = 2000
    tags = (
        (BLACK, "H", 1, 1500),
        (WHITE, "H", 1, 60000),
        (AREA, "I", 4, (0, 8, HEIGHT, WIDTH)),
        (MASKED, "I", 4, (0, 0, HEIGHT, 8)),
    )

    assert_flat(decode(dng(values, *tags)).pixels[:], 8e-5)


@pytest.mark.parametrize(
    ("tags", "reason"),
    [
        (((BLACK, "H", 4, (600,) * 4),), "4 levels of black (BlackLevel) where there must be 1"),
        (((BLACK, "H", 3, (600,) * 3),), "3 levels of black (BlackLevel) where there must be 1"),
        (
            ((REPEAT, "H", 2, (2, 2)), (BLACK, "H", 1, 600)),
            "1 levels of black (BlackLevel) where there must be 4",
        ),
        (((BLACK, "H", 1, 600), (WHITE, "H", 1, 600)), "white (WhiteLevel) is no brighter"),
        (((WHITE, "H", 1, 0),), "white (WhiteLevel) is no brighter"),
        (((BY_ROW, "2i", 3, each(1, 2, 3)),), "black for other rows or columns than it has"),
        (((BY_COLUMN, "2i", 3, each(1, 2, 3)),), "black for other rows or columns than it has"),
    ],
)
def test_levels_of_other_photosites_are_refused(dng: Write, tags: Tags, reason: str) -> None:
    """LibRaw passes them over, or takes what it likes."""
    sentence = refusal(dng(flat(600), *tags))

    assert reason in sentence
    assert "save it anew as a DNG, or as a TIFF of 16 bits." in sentence


@pytest.mark.parametrize(
    ("tags", "reason"),
    [
        (((BLACK, "H", 4, (600,) * 4),), "4 levels of black (BlackLevel) where there must be 3"),
        (((WHITE, "H", 2, (60000,) * 2),), "2 levels of white (WhiteLevel) where there must be 3"),
    ],
)
def test_levels_of_other_colours_are_refused(dng: Write, tags: Tags, reason: str) -> None:
    assert reason in refusal(dng(codes(light(), 600, 60000), *tags))


def test_rows_that_differ_in_what_libraw_demosaics_are_refused(dng: Write) -> None:
    by_row = [part for row in range(516) for part in (row, 1)]
    pattern = ((33421, "H", 2, (6, 6)), (33422, "B", 36, X_TRANS))
    values = np.full((516, 520), 3000, np.uint16)

    sentence = refusal(dng(values, *pattern, (BLACK, "H", 1, 600), (BY_ROW, "2i", 516, by_row)))

    assert "levels of black by rows or columns (BlackLevelDeltaV" in sentence


def test_levels_are_those_of_the_largest_picture() -> None:
    """A smaller linear one beside a mosaic says nothing of it."""
    tags = [
        (33421, "H", 2, (6, 6), True),
        (33422, "B", 36, X_TRANS, True),
        (50706, "B", 4, (1, 7, 0, 0), True),
        (50708, "s", 0, "Unheard Of One", True),
        (REPEAT, "H", 2, (6, 6), True),
        (BLACK, "H", 36, tuple(range(600, 636)), True),
    ]
    mosaic = np.random.default_rng(1).integers(700, 60000, (516, 520)).astype(np.uint16)

    def written(*others: NDArray[Any]) -> bytes:
        file = io.BytesIO()
        with tifffile.TiffWriter(file) as tiff:
            tiff.write(mosaic, photometric="cfa", extratags=tags, metadata=None)
            for other in others:
                tiff.write(other, photometric="linear_raw", metadata=None)
        return file.getvalue()

    frame = decode(written(np.full((64, 96, 3), 9000, np.uint16)))

    np.testing.assert_array_equal(frame.pixels[:], decode(written()).pixels[:])


def test_levels_beside_a_preview_are_those_of_the_picture() -> None:
    """Of the first directory where its own has none, and its own where both have."""
    version = [(50706, "B", 4, (1, 7, 0, 0), True), (50708, "s", 0, "Unheard Of One", True)]
    first = [(BLACK, "H", 1, 600, True), (WHITE, "I", 1, 50000, True)]
    preview = np.full((16, 24, 3), 90, np.uint8)

    def written(*own: tuple[Any, ...]) -> bytes:
        file = io.BytesIO()
        with tifffile.TiffWriter(file) as tiff:
            common = dict[str, Any](metadata=None, software=False)
            tags = version + first
            tiff.write(
                preview, photometric="rgb", subfiletype=1, subifds=1, extratags=tags, **common
            )
            values = np.full((HEIGHT, WIDTH, 3), 25300, np.uint16)
            tiff.write(values, photometric="linear_raw", extratags=own, **common)
        return file.getvalue()

    own = (WHITE, "I", 3, (60000, 50000, 40000), True)
    others = [(25300 - 600) / (white - 600) for white in (60000, 50000, 40000)]

    np.testing.assert_allclose(decode(written()).pixels[:], 0.5, atol=2e-5)
    pixels = decode(written(own)).pixels[:]
    np.testing.assert_allclose(pixels, np.broadcast_to(others, pixels.shape), atol=2e-5)


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize(
    ("black", "white", "tags"),
    [
        (0, 60000, ((WHITE, "H", 1, 60000),)),
        (2000, 60000, ((BLACK, "H", 1, 2000), (WHITE, "H", 1, 60000))),
        (2000, 60000, ((BLACK, "H", 3, (2000,) * 3), (WHITE, "H", 3, (60000,) * 3))),
    ],
)
def test_floats_of_whole_levels_that_are_alike_are_read(
    dng: Write, black: int, white: int, tags: Tags, kind: type
) -> None:
    frame = decode(dng((black + light() * (white - black)).astype(kind), *tags))

    np.testing.assert_allclose(frame.pixels, light(), atol=6e-4)


@pytest.mark.parametrize(
    "tags",
    [
        ((BLACK, "2I", 3, (1, 10) * 3), (WHITE, "H", 3, (1,) * 3)),
        ((BLACK, "H", 1, 10), (WHITE, "H", 3, (100,) * 3)),
        ((BLACK, "H", 3, (10, 10, 11)), (WHITE, "H", 3, (100,) * 3)),
        ((WHITE, "H", 3, (2, 1, 1)),),
        ((BLACK, "H", 1, 10), (WHITE, "H", 1, 100), (BY_ROW, "2i", HEIGHT, (1, 1) * HEIGHT)),
    ],
    ids=["a fraction", "one black of several whites", "unlike", "unlike whites", "by rows"],
)
def test_other_levels_of_floats_are_refused(dng: Write, tags: Tags) -> None:
    values = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)

    assert "is a DNG of floats whose levels of black or white" in refusal(dng(values, *tags))


def test_a_fraction_of_black_of_a_mosaic_of_floats_is_refused(dng: Write) -> None:
    values = np.full((HEIGHT, WIDTH), 0.5, np.float32)

    sentence = refusal(dng(values, (BLACK, "2I", 1, (1, 10)), (WHITE, "H", 1, 1)))

    assert "is a DNG of floats whose levels of black or white" in sentence


@pytest.mark.parametrize("data", [b"", b"text", b"II*\x00\x08\x00\x00\x00"])
def test_other_bytes_have_no_levels(data: bytes) -> None:
    assert dng_levels(data) is None


def test_other_raw_files_have_no_levels(tiff_file: Write) -> None:
    """What makers write under the same numbers may mean something else."""
    tags = [(33421, "H", 2, (2, 2), True), (33422, "B", 4, (0, 1, 1, 2), True)]
    level = [(BLACK, "H", 3, (9, 9, 9), True)]

    assert dng_levels(tiff_file(flat(0), photometric="cfa", extratags=tags + level)) is None


def test_levels_that_are_no_numbers_are_for_libraw_to_judge(dng: Write) -> None:
    assert dng_levels(dng(flat(0), (BLACK, "s", 0, "dark"))) is None


@pytest.mark.parametrize(
    ("place", "begins"),
    [((1, 2), True), ((3, 6), True), ((2, 2), False), ((1, 3), False), ((1, 4), False)],
)
def test_black_repeats_from_the_active_area_on(place: tuple[int, int], begins: bool) -> None:
    none = np.zeros(1)
    levels = Levels((1, 2), np.zeros((2, 4, 1)), none, none, np.ones(1))

    assert levels.repeats_from(*place) is begins
