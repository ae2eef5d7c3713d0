"""What is written reads back as meant, in other people's readers, with the same bytes each time."""

from __future__ import annotations

import errno
import hashlib
import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import simplejpeg
import tifffile
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import ImageCms

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.colour.icc import linear_rec2020_profile
from pipeline.colour.spaces import SRGB_PRIMARIES, XYZ_TO_REC2020, XYZ_TO_SRGB, rgb_to_xyz
from pipeline.encode.exr import ExrFile, write_exr
from pipeline.encode.files import describe
from pipeline.encode.jpeg import JpegFile, check_jpeg_size, to_srgb8, write_jpeg
from pipeline.encode.png import NormalsPng, write_png8
from pipeline.encode.tiff import GrayTiffFile, TiffFile
from pipeline.errors import OptionError
from tests.strips import size_of, write_by_strips

Picture = Floats32
SRGB_TO_REC2020 = XYZ_TO_REC2020 @ np.linalg.inv(XYZ_TO_SRGB)


def codes_of(light: Floats) -> Floats64:
    """sRGB code values, 0 to 255, of linear light (IEC 61966-2-1)."""
    curve = 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    return np.asarray(255 * np.where(light <= 0.0031308, 12.92 * light, curve))


def test_tiff_holds_16_bit_linear_rec2020_with_its_profile(
    tmp_path: Path, picture: Picture
) -> None:
    path = tmp_path / "lamp1.tif"

    write_by_strips(TiffFile(path, size_of(picture), SRGB_TO_REC2020), picture)

    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        assert page.iccprofile == linear_rec2020_profile()
        values = page.asarray()
    expected = np.clip(picture @ SRGB_TO_REC2020.T, 0, 1) * 65535
    assert values.dtype == np.uint16
    assert np.abs(values - expected).max() < 0.6


def test_the_tiffs_profile_takes_its_values_to_the_right_colours(tmp_path: Path) -> None:
    """A colour management of its own, from the file's profile to sRGB, comes to the same."""
    patches = np.array([[[0.5, 0.5, 0.5], [0.6, 0.2, 0.1], [0.1, 0.4, 0.2], [0.1, 0.2, 0.5]]])
    path = tmp_path / "lamp1.tif"
    write_by_strips(TiffFile(path, size_of(patches), SRGB_TO_REC2020), patches.astype(np.float32))
    with tifffile.TiffFile(path) as file:
        values, profile = file.pages.first.asarray(), file.pages.first.iccprofile
    assert profile is not None
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()

    shown = imagecodecs.cms_transform(
        values, profile, srgb, colorspace="rgb", outcolorspace="rgb", outdtype="uint8"
    )

    assert np.abs(shown - codes_of(patches)).max() <= 1


def test_jpeg_is_srgb_with_its_profile_and_without_exif(tmp_path: Path) -> None:
    ramp = np.linspace(0, 1, 64)[None, :, None] * np.array([1.0, 0.8, 0.6])
    picture = np.broadcast_to(ramp, (48, 64, 3)).astype(np.float32)
    path = tmp_path / "lamp1.jpg"

    write_jpeg(path, picture)

    data = path.read_bytes()
    assert np.abs(simplejpeg.decode_jpeg(data).astype(int) - codes_of(picture)).max() < 5
    with PillowImage.open(io.BytesIO(data)) as image:
        assert not image.getexif()
        profile = ImageCms.ImageCmsProfile(io.BytesIO(image.info["icc_profile"]))
        assert "exif" not in image.info and "xmp" not in image.info
    assert ImageCms.getProfileDescription(profile).strip() == "sRGB"
    assert b"Exif" not in data and b"GPS" not in data


def test_jpeg_takes_pixels_through_the_matrix(tmp_path: Path) -> None:
    picture = np.full((16, 16, 3), (0.1, 0.2, 0.4), np.float32)
    swap = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])

    write_jpeg(tmp_path / "a.jpg", picture, swap)

    values = simplejpeg.decode_jpeg((tmp_path / "a.jpg").read_bytes())
    np.testing.assert_allclose(values[8, 8], codes_of(np.array([0.4, 0.2, 0.1])), atol=2)


def test_jpeg_keeps_the_border_of_two_colours_where_it_is(tmp_path: Path) -> None:
    """Two colours of one brightness, side by side: coarser colour would blend them."""
    picture = np.full((32, 32, 3), (0.5, 0.2, 0.2), np.float32)
    picture[:, 15:] = (0.2, 0.289, 0.2)

    write_jpeg(tmp_path / "a.jpg", picture)

    values = simplejpeg.decode_jpeg((tmp_path / "a.jpg").read_bytes())
    np.testing.assert_allclose(values[16, 14:16], codes_of(picture[16, 14:16]), atol=8)


def test_srgb8_is_exact_inside_the_gamut() -> None:
    light = np.random.default_rng(2).uniform(0, 1, (40, 30, 3)).astype(np.float32)

    codes = to_srgb8(light)

    assert np.abs(codes - codes_of(light)).max() < 0.52


@pytest.mark.parametrize(
    ("light", "code"),
    [((0, 0, 0), (0, 0, 0)), ((1, 1, 1), (255, 255, 255)), ((9, 9, 9), (255, 255, 255))],
)
def test_black_white_and_brighter_than_white(
    light: tuple[float, ...], code: tuple[int, ...]
) -> None:
    assert tuple(to_srgb8(np.array([[light]], np.float32))[0, 0]) == code


@pytest.mark.parametrize("light", [(1.4, 0.3, 0.1), (-0.2, 0.7, 0.1), (0.2, 0.1, 1.9)])
def test_colours_outside_the_gamut_keep_hue_and_brightness(light: tuple[float, ...]) -> None:
    weights = np.array([0.2126, 0.7152, 0.0722])
    color = np.array(light)

    value = to_srgb8(np.array([[light]], np.float32))[0, 0] / 255.0
    shown = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)

    away, shown_away = color - color @ weights, shown - shown @ weights
    cosine = away @ shown_away / np.linalg.norm(away) / np.linalg.norm(shown_away)
    assert shown @ weights == pytest.approx(color @ weights, abs=0.01)
    assert cosine > 0.999


@pytest.mark.parametrize("light", [(-0.04, -0.13, 1.0), (0.0, -0.1, 0.99), (-2.0, 0.1, 0.5)])
def test_light_of_no_luminance_keeps_its_hue_and_half_of_what_is_lit(
    light: tuple[float, ...],
) -> None:
    """Deep blue lamps by a camera's matrix: Y is negative, or next to nothing."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    color = np.array(light)
    assert color @ weights < 1e-3

    value = to_srgb8(np.array([[light]], np.float32))[0, 0] / 255.0
    shown = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)

    grey = 0.5 * color.clip(min=0) @ weights
    away = color - grey
    np.testing.assert_allclose(shown, grey + away * grey / (grey - color.min()), atol=0.002)
    assert shown.max() > grey


def test_less_and_less_luminance_makes_no_step() -> None:
    """From a blue whose luminance is kept to one that has none, code by code."""
    green = np.linspace(0.1, -0.2, 601)
    light = np.stack([np.full_like(green, -0.04), green, np.ones_like(green)], axis=1)

    codes = to_srgb8(light[None].astype(np.float32))[0].astype(int)

    assert np.abs(np.diff(codes, axis=0)).max() <= 2
    assert codes[:, 2].min() > 100


def srgb8_by_numpy(linear: Picture, matrix: Floats64) -> NDArray[np.uint8]:
    """What to_srgb8 means, pixel by pixel at once; it works one by one, compiled."""
    rgb = linear @ matrix.T.astype(np.float32)
    weights = rgb_to_xyz(SRGB_PRIMARIES)[1].astype(np.float32)
    grey = np.maximum(rgb @ weights, 0.5 * np.maximum(rgb, 0) @ weights).clip(max=1.0)[..., None]
    away = rgb - grey
    room = np.where(away > 0, 1.0 - grey, grey)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.abs(away) > room, room / np.abs(away), 1.0).min(axis=2, keepdims=True)
    fitting = np.clip(grey + share * away, 0.0, 1.0)
    return np.round(codes_of(np.round(fitting * 65535) / 65535)).astype(np.uint8)


@pytest.mark.parametrize("scale", [0.02, 1.0, 30.0])
def test_the_compiled_srgb8_is_the_one_of_numpy(picture: Picture, scale: float) -> None:
    matrix = scale * np.array([[1.6, -0.5, -0.1], [-0.2, 1.4, -0.2], [0.0, -0.4, 1.4]])

    codes, expected = to_srgb8(picture, matrix), srgb8_by_numpy(picture, matrix)

    assert np.abs(codes.astype(int) - expected).max() <= 1
    assert (codes != expected).mean() < 1e-3
    np.testing.assert_array_equal(to_srgb8(picture[::2, ::3], matrix), codes[::2, ::3])


def test_what_is_no_light_is_black() -> None:
    assert not to_srgb8(np.full((2, 2, 3), np.nan, np.float32)).any()


def test_exr_has_named_channels_of_linear_values(tmp_path: Path, picture: Picture) -> None:
    names = ["lamp1.R", "lamp1.G", "lamp1.B", "lamp2.R", "lamp2.G", "lamp2.B", "R", "G", "B"]
    channels = {name: picture[..., i % 3] * (1 + i) for i, name in enumerate(names)}
    path = tmp_path / "layers.exr"

    write_exr(path, channels)

    read = OpenEXR.File(str(path), separate_channels=True).channels()
    assert set(read) == set(names)
    for name in names:
        assert read[name].pixels.dtype == np.float32
        np.testing.assert_array_equal(read[name].pixels, channels[name])


def test_exr_takes_pictures_as_they_lie(tmp_path: Path, picture: Picture) -> None:
    """Whole, turned or cut out: the file holds what they show."""
    turned = picture[::-1]
    path = tmp_path / "layers.exr"

    write_exr(path, {"RGB": picture, "lamp1": turned, "Z": picture[..., 1]})

    with OpenEXR.File(str(path), separate_channels=True) as file:
        read = {name: channel.pixels for name, channel in file.channels().items()}
        head = dict(file.header())
    assert head["compression"] == OpenEXR.NO_COMPRESSION
    assert head["pixelAspectRatio"] == 1.0
    for window in ("dataWindow", "displayWindow"):
        np.testing.assert_array_equal(head[window], [[0, 0], [19, 299]])
    expected = {name: picture[..., k] for k, name in enumerate("RGB")} | {"Z": picture[..., 1]}
    expected |= {f"lamp1.{name}": turned[..., k] for k, name in enumerate("RGB")}
    assert set(read) == set(expected)
    for name, plane in expected.items():
        np.testing.assert_array_equal(read[name], plane)


def test_exr_is_written_some_rows_at_a_time(tmp_path: Path, picture: Picture) -> None:
    path = tmp_path / "layers.exr"
    file = ExrFile(path, size_of(picture))

    for rows in (slice(0, 7), slice(7, 8), slice(8, 300)):
        file.write({"lamp1": picture[rows], "Z": picture[rows, :, 2]})
    file.close()

    read = OpenEXR.File(str(path), separate_channels=True).channels()
    assert set(read) == {"lamp1.R", "lamp1.G", "lamp1.B", "Z"}
    for name, k in (("lamp1.R", 0), ("lamp1.G", 1), ("lamp1.B", 2), ("Z", 2)):
        np.testing.assert_array_equal(read[name].pixels, picture[..., k])


def test_jpeg_is_the_same_whole_and_in_strips(tmp_path: Path, picture: Picture) -> None:
    write_jpeg(tmp_path / "a.jpg", picture, SRGB_TO_REC2020)

    write_by_strips(JpegFile(tmp_path / "b.jpg", size_of(picture), SRGB_TO_REC2020), picture)

    assert (tmp_path / "a.jpg").read_bytes() == (tmp_path / "b.jpg").read_bytes()


@pytest.mark.parametrize("size", [(300, 41), (85, 75), (9, 8), (40, 300), (33, 32)])
def test_jpeg_shows_what_an_encoder_of_whole_pictures_writes(size: tuple[int, int]) -> None:
    light = np.random.default_rng(3).random((*size[::-1], 3)).astype(np.float32)
    whole, file = io.BytesIO(), io.BytesIO()
    PillowImage.fromarray(to_srgb8(light)).save(whole, "JPEG", quality=92, subsampling="4:4:4")

    write_jpeg(file, light)

    expected = np.asarray(PillowImage.open(whole))
    np.testing.assert_array_equal(np.asarray(PillowImage.open(file)), expected)
    strict = simplejpeg.decode_jpeg(file.getvalue(), "RGB", strict=True)
    assert strict.shape == expected.shape
    assert np.abs(strict.astype(int) - expected).max() <= 1


@pytest.mark.parametrize("size", [(65501, 1), (1, 65501)])
def test_jpeg_refuses_what_its_readers_do_not_read(tmp_path: Path, size: tuple[int, int]) -> None:
    words = f"{size[0]} × {size[1]} pixels, as the format ends at 65,500 .* ask for TIFF"
    with pytest.raises(OptionError, match=words):
        JpegFile(tmp_path / "a.jpg", size)

    assert not list(tmp_path.iterdir())


def test_jpeg_takes_what_its_readers_read() -> None:
    check_jpeg_size((65500, 65500))


def test_grey_is_16_bit_linear(tmp_path: Path, picture: Picture) -> None:
    write_by_strips(GrayTiffFile(tmp_path / "a.tif", size_of(picture)), picture[..., 0])

    codes = tifffile.imread(tmp_path / "a.tif")
    assert codes.dtype == np.uint16
    assert np.abs(codes - 65535.0 * np.clip(picture[..., 0], 0, 1)).max() < 0.51


def test_exr_refuses_planes_of_two_sizes(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="one size"):
        write_exr(
            tmp_path / "a.exr", {"R": np.ones((2, 3), np.float32), "G": np.ones((3, 3), np.float32)}
        )


def test_normals_are_16_bit_opengl_without_profile(tmp_path: Path) -> None:
    normals = np.zeros((300, 5, 3), np.float32)
    normals[:, 0] = (0, 0, 1)  # to the viewer
    normals[:, 1] = (1, 0, 0)  # right
    normals[:, 2] = (0, 1, 0)  # up
    normals[:, 3] = np.nan  # no surface
    normals[299, 0] = (-0.6, 0.0, 0.8)
    path = tmp_path / "normals.png"

    write_by_strips(NormalsPng(path, size_of(normals)), normals)

    values = imagecodecs.png_decode(path.read_bytes())
    assert values.dtype == np.uint16 and values.shape == (300, 5, 3)
    np.testing.assert_array_equal(values[0, 0], (32768, 32768, 65535))
    np.testing.assert_array_equal(values[280, 1], (65535, 32768, 32768))
    np.testing.assert_array_equal(values[0, 2], (32768, 65535, 32768))
    np.testing.assert_array_equal(values[:, 3:], 0)
    np.testing.assert_array_equal(values[299, 0], (13107, 32768, 58982))
    assert b"iCCP" not in path.read_bytes() and b"sRGB" not in path.read_bytes()


def test_png8_keeps_code_values(tmp_path: Path) -> None:
    codes = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)

    write_png8(tmp_path / "gamma.png", codes)

    read = imagecodecs.png_decode((tmp_path / "gamma.png").read_bytes())
    np.testing.assert_array_equal(read, codes)


WRITERS: dict[str, Callable[[Path, Picture], None]] = {
    "a.tif": lambda path, picture: write_by_strips(TiffFile(path, size_of(picture)), picture),
    "a.jpg": write_jpeg,
    "a.exr": lambda path, picture: write_exr(path, {"R": picture[..., 0], "G": picture[..., 1]}),
    "normals.png": lambda path, picture: write_by_strips(
        NormalsPng(path, size_of(picture)), picture
    ),
    "gamma.png": lambda path, picture: write_png8(path, to_srgb8(picture)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_the_same_picture_gives_the_same_bytes(
    tmp_path: Path, picture: Picture, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    WRITERS[name](tmp_path / name, picture)
    first = (tmp_path / name).read_bytes()
    (tmp_path / "again").mkdir()
    monkeypatch.setenv("TZ", "Asia/Tokyo")

    WRITERS[name](tmp_path / "again" / name, picture.copy())

    assert (tmp_path / "again" / name).read_bytes() == first


@pytest.mark.parametrize("name", WRITERS)
def test_the_manifest_describes_the_file(tmp_path: Path, picture: Picture, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path, picture)

    assert describe(path, "16-bit", "Rec. 2020, linear") == {
        "name": name,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "encoding": "16-bit",
        "colour_space": "Rec. 2020, linear",
        "width": 20,
        "height": 300,
    }


@pytest.mark.parametrize("name", WRITERS)
def test_a_place_that_cannot_be_written_is_an_os_error(
    tmp_path: Path, picture: Picture, name: str
) -> None:
    with pytest.raises(OSError):
        WRITERS[name](tmp_path / "nowhere" / name, picture)


def test_a_full_disk_is_told_by_its_errno(picture: Picture) -> None:
    """By which a service knows that the job may go on when there is room again."""
    with pytest.raises(OSError) as raised:
        write_exr(Path("/dev/full"), {"RGB": picture})
    assert raised.value.errno == errno.ENOSPC


SHORT_OF_ROOM = """
import resource, sys
from pathlib import Path
import numpy as np
from pipeline.encode.exr import write_exr

width, height, path = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
planes = {"Z": np.ones((height, width), np.float32)}
write_exr(path, planes)
needed = path.stat().st_size
_, most = resource.getrlimit(resource.RLIMIT_FSIZE)
for missing in (0, *map(int, sys.argv[4:])):
    path.unlink()
    resource.setrlimit(resource.RLIMIT_FSIZE, (needed - missing, most))
    try:
        write_exr(path, planes)
        print(missing, "whole")
    except OSError as error:
        print(missing, error.errno)
"""


@pytest.mark.parametrize(
    ("size", "missing"),
    [((20, 300), [1, 2, 100, 1000, 2000, 5000, 20_000]), ((20, 10), [1, 100, 880, 1000])],
    ids=["more than a buffer", "less than a buffer"],
)
def test_an_exr_whose_last_bytes_cannot_be_written_is_an_os_error(
    tmp_path: Path, size: tuple[int, int], missing: list[int]
) -> None:
    told = [str(errno.ENOSPC), str(errno.EFBIG)]

    run = subprocess.run(
        [sys.executable, "-c", SHORT_OF_ROOM, *map(str, (*size, tmp_path / "a.exr", *missing))],
        capture_output=True,
        text=True,
        check=True,
    )

    first, *others = (line.split() for line in run.stdout.splitlines())
    assert first == ["0", "whole"]
    assert [int(found) for found, _ in others] == missing
    assert all(number in told for _, number in others)
    assert run.stderr == ""


def test_an_exr_is_not_ended_before_its_last_row(tmp_path: Path) -> None:
    file = ExrFile(tmp_path / "a.exr", (20, 30))
    file.write({"Z": np.ones((29, 20), np.float32)})
    with pytest.raises(ValueError, match="of 30 rows was given 29"):
        file.close()


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("nowhere/a.exr", errno.ENOENT),
        ("folder", errno.EISDIR),
        ("file/a.exr", errno.ENOTDIR),
        (f"{'x' * 300}.exr", errno.ENAMETOOLONG),
    ],
)
def test_where_an_exr_cannot_be_written_is_told_by_its_errno(
    tmp_path: Path, picture: Picture, name: str, number: int
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(OSError) as raised:
        write_exr(tmp_path / name, {"RGB": picture})
    assert raised.value.errno == number


def test_other_faults_of_an_exr_stay_as_they_are(tmp_path: Path, picture: Picture) -> None:
    loop = tmp_path / "loop.exr"
    loop.symlink_to(loop)
    with pytest.raises(OSError, match="Too many levels of symbolic links"):
        write_exr(loop, {"RGB": picture})
