"""What is wholly transparent shows nothing: it is known as such, in the picture as it is shown."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import imagecodecs
import numpy as np
import pillow_heif
import pytest
from numpy.typing import NDArray
from PIL import Image as PillowImage

from pipeline.decode import decode
from pipeline.decode.samples import upright
from pipeline.errors import UnreadableImageError

Codes = NDArray[np.uint8]
Write = Callable[..., bytes]


@pytest.fixture
def cut_out(codes: Codes) -> Codes:
    """The picture (48, 64, 4) without its upper left corner, next to which it is half there."""
    codes = codes.copy()
    codes[:24, :32] = 255
    alpha = np.full(codes.shape[:2], 255, np.uint8)
    alpha[:24, :32] = 0
    alpha[:24, 32:40] = 128
    return np.dstack([codes, alpha])


@pytest.fixture
def corner() -> NDArray[np.bool_]:
    mask = np.zeros((48, 64), dtype=bool)
    mask[:24, :32] = True
    return mask


def heif(values: NDArray[Any], mode: str = "RGBA", **options: Any) -> bytes:
    file = io.BytesIO()
    image = pillow_heif.from_bytes(mode, (values.shape[1], values.shape[0]), values.tobytes())
    image.save(file, quality=-1, chroma=444, **options)
    return file.getvalue()


def test_what_is_transparent_is_empty_in_any_kind_and_depth(
    cut_out: Codes, corner: NDArray[np.bool_], tiff_file: Write
) -> None:
    deep = cut_out.astype(np.uint16) * 257
    floats = (cut_out / 255).astype(np.float32)
    planes = np.moveaxis(deep, 2, 0)
    files = [
        bytes(imagecodecs.png_encode(cut_out)),
        bytes(imagecodecs.png_encode(deep)),
        heif(cut_out),
        *(tiff_file(each, extrasamples=["unassalpha"]) for each in (cut_out, deep, floats)),
        tiff_file(planes, planarconfig="separate", extrasamples=["unassalpha"]),
    ]
    for data in files:
        frame = decode(data)

        assert frame.empty is not None
        np.testing.assert_array_equal(frame.empty, corner)
        np.testing.assert_array_equal(frame.unusable, corner | frame.saturated)
        assert not frame.saturated[:24, :32].any()
        assert (frame.pixels[:][corner] == 0).all()  # and not the white that lies below


@pytest.mark.parametrize("depth", [8, 10])
def test_heif_colours_multiplied_by_their_transparency_are_refused(
    cut_out: Codes, depth: int
) -> None:
    """Where nothing is transparent, they are those of the light."""
    values = cut_out if depth == 8 else cut_out.astype(np.uint16) * 257
    mode = "RGBa" if depth == 8 else "RGBa;16"

    with pytest.raises(UnreadableImageError, match="its colours are multiplied by that: save it"):
        decode(heif(values, mode))

    values[..., 3] = values.max()
    whole = heif(values[..., :3].copy(), mode.replace("a", ""))
    np.testing.assert_array_equal(decode(heif(values, mode)).pixels[:], decode(whole).pixels[:])


def test_the_transparent_colour_of_a_palette_is_empty() -> None:
    indices = np.zeros((48, 64), np.uint8)
    indices[:24] = 1
    image = PillowImage.fromarray(indices, "P")
    image.putpalette([10, 20, 30, 200, 100, 50])
    file = io.BytesIO()
    image.save(file, "PNG", transparency=1)

    empty = decode(file.getvalue()).empty

    assert empty is not None
    assert empty[:24].all()
    assert not empty[24:].any()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_what_is_empty_is_turned_with_the_picture(
    cut_out: Codes,
    corner: NDArray[np.bool_],
    exif_of: Callable[..., PillowImage.Exif],
    orientation: int,
) -> None:
    exif = exif_of({274: orientation}, {})
    file = io.BytesIO()
    PillowImage.fromarray(cut_out).save(file, "PNG", exif=exif)
    for data in (file.getvalue(), heif(cut_out, exif=exif.tobytes())):
        for turn in (None, 1, 6):
            empty = decode(data, orientation=turn).empty

            assert empty is not None
            np.testing.assert_array_equal(empty, upright(corner, turn or orientation))


def test_an_alpha_that_hides_all_or_nothing_or_is_none_says_nothing(
    cut_out: Codes, codes: Codes, tiff_file: Write
) -> None:
    hidden, shown = cut_out.copy(), cut_out.copy()
    hidden[..., 3], shown[..., 3] = 0, 1
    files = [
        bytes(imagecodecs.png_encode(hidden)),
        bytes(imagecodecs.png_encode(shown)),
        bytes(imagecodecs.png_encode(codes)),
        tiff_file(cut_out, extrasamples=["unspecified"]),
    ]
    for data in files:
        frame = decode(data)

        assert frame.empty is None
        assert frame.unusable is frame.saturated
