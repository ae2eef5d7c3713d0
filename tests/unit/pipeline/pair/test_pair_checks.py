from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.curves import linear_to_srgb, srgb_to_linear
from pipeline.errors import (
    InputError,
    PairMismatchError,
    SwappedPairError,
    UnreadableImageError,
    UnusablePairError,
)
from pipeline.images.frames import Frame
from pipeline.images.noise import Noise
from pipeline.pair.pair_checks import (
    check_belonging,
    check_colours,
    check_flash_adds,
    check_light,
    check_pair,
    check_sizes,
)
from tests.unit.pipeline.pair.pairs_of_frames import paired
from tests.unit.pipeline.separating import Files, codes, png, separated, tiff, turned

# files, by their headers


def test_sound_files_pass_the_check(files: Callable[..., Files]) -> None:
    check_pair(*files())
    check_pair(*files(write=png))


def test_the_bad_one_of_two_files_is_named(files: Callable[..., Files]) -> None:
    no_flash, flash = files()

    with pytest.raises(UnreadableImageError, match="photograph without the flash"):
        check_pair(b"nothing", flash)
    with pytest.raises(UnreadableImageError, match="photograph with the flash"):
        check_pair(no_flash, b"nothing")


def test_one_file_twice_is_refused(files: Callable[..., Files]) -> None:
    no_flash, _ = files()

    with pytest.raises(UnusablePairError, match="identical"):
        check_pair(no_flash, no_flash)


def test_tiny_pictures_are_refused() -> None:
    with pytest.raises(UnusablePairError, match="only 31 × 40 pixels"):
        check_pair(tiff(np.full((40, 31, 3), 0.3)), tiff(np.full((40, 31, 3), 0.4)))


@pytest.mark.parametrize(("no_flash", "flash"), [(1, 6), (8, 1), (1, 3), (6, 8)])
def test_a_camera_that_did_not_move_may_write_another_orientation(
    files: Callable[..., Files], tmp_path: Path, no_flash: int, flash: int
) -> None:
    """The layers are those of a pair of one orientation, and a warning tells of it."""
    before, after = files()
    first, second = turned(before, no_flash), turned(after, flash)

    assert check_pair(first, second) == no_flash
    manifest = separated((first, second), tmp_path / "differ")
    alike = separated((first, turned(after, no_flash)), tmp_path / "alike")

    assert manifest["lamps"] == alike["lamps"]
    assert codes(alike) == [code for code in codes(manifest) if code != "orientations_differ"]
    (warning,) = (w for w in manifest["warnings"] if w["code"] == "orientations_differ")
    assert warning["figures"] == {"no_flash": no_flash, "flash": flash}
    assert f"(orientation {flash})" in warning["message"]


def test_a_photograph_that_a_converter_has_turned_is_not_turned_again() -> None:
    light = np.full((40, 60, 3), 0.3)
    with pytest.raises(PairMismatchError, match="60 × 40 without the flash and 40 × 60 with it"):
        check_pair(tiff(light), tiff(np.full((60, 40, 3), 0.4)))
    upright = np.full((60, 40, 3), 0.4)
    assert check_pair(turned(tiff(light), 6), tiff(upright)) == 1


# frames that do not belong together


@pytest.mark.parametrize("size", [(96, 127), (95, 128), (128, 96)])
def test_other_sizes_are_refused(
    frames: Callable[..., tuple[Frame, Frame]],
    frame: Callable[..., Frame],
    size: tuple[int, int],
) -> None:
    before, _ = frames()

    with pytest.raises(PairMismatchError) as refused:
        paired((before, frame(np.full((*size, 3), 0.3))))

    assert f"128 × 96 without the flash and {size[1]} × {size[0]} with it" in str(refused.value)


@pytest.mark.parametrize(
    ("no_flash", "flash", "error"),
    [
        ((10, 20), (10, 21), PairMismatchError),
        ((31, 400), (31, 400), UnusablePairError),
        ((400, 1), (400, 1), UnusablePairError),
    ],
)
def test_sizes_are_checked_before_anything_is_decoded(
    no_flash: tuple[int, int], flash: tuple[int, int], error: type[InputError]
) -> None:
    with pytest.raises(error, match=r"\d+ × \d+"):
        check_sizes(no_flash, flash)


def test_the_smallest_size_is_32_pixels() -> None:
    check_sizes((32, 32), (32, 32))

    with pytest.raises(UnusablePairError, match="have only 32 × 31 pixels"):
        check_sizes((32, 31), (32, 31))


@pytest.mark.parametrize("turned", [False, True])
def test_the_longest_shape_is_100_to_1(turned: bool) -> None:
    longest, longer = ((3200, 32), (3201, 32)) if not turned else ((32, 3200), (32, 3201))
    check_sizes(longest, longest)

    with pytest.raises(UnusablePairError, match=f"have {longer[0]} × {longer[1]} pixels, one side"):
        check_sizes(longer, longer)


@pytest.mark.parametrize(
    ("encodings", "words"),
    [
        (("raw", "srgb"), ("sensor values", "sRGB values")),
        (("srgb", "linear"), ("sRGB values", "linear values")),
        (("raw", "linear"), ("sensor values", "linear values")),
        (("linear", "raw"), ("linear values", "sensor values")),
    ],
)
def test_encodings_are_not_mixed(
    frames: Callable[..., tuple[Frame, Frame]],
    encodings: tuple[str, str],
    words: tuple[str, str],
) -> None:
    both = [replace(one, encoding=kind) for one, kind in zip(frames(), encodings, strict=True)]

    with pytest.raises(PairMismatchError) as refused:
        paired((both[0], both[1]))

    assert f"without the flash holds {words[0]}, the one with it {words[1]}" in str(refused.value)


def test_files_of_two_formats_go_together_where_their_values_are_of_one_kind(
    light: tuple[Floats64, Floats64], tmp_path: Path
) -> None:
    """A TIFF of floats and a PNG of 16 bits, both linear, are as good as two TIFFs."""
    lamps, flash = light
    before, both = (np.clip(one, 0, 1) for one in (0.5 * lamps, 0.5 * (lamps + flash)))
    values = np.round(65535 * both).astype(np.uint16)
    png_16 = cv2.imencode(".png", values[..., ::-1])[1].tobytes()

    mixed = separated((tiff(before), png_16), tmp_path / "mixed")
    alike = separated((tiff(before), tiff(values / 65535)), tmp_path / "alike")

    found, wanted = ([lamp["rgb"] for lamp in one["lamps"]] for one in (mixed, alike))
    np.testing.assert_allclose(found, wanted, atol=0.01)
    assert codes(mixed) == codes(alike)


@pytest.mark.parametrize(("encoding", "words"), [("linear", "linear"), ("raw", "sensor")])
@pytest.mark.parametrize("flash_only", [False, True])
def test_the_colours_of_a_profile_are_not_mixed_with_others(
    frames: Callable[..., tuple[Frame, Frame]], encoding: str, words: str, flash_only: bool
) -> None:
    before, after = frames()
    both = replace(before, encoding=encoding), replace(after, profiled=True)

    with pytest.raises(PairMismatchError) as refused:
        paired(both, flash_only=flash_only)

    assert (
        f"without the flash holds {words} values, the one with it linear values of a colour profile"
    ) in str(refused.value)


@pytest.mark.parametrize("encodings", [("raw", "linear"), ("linear", "raw")])
def test_the_flash_part_alone_may_be_computed_from_sensor_values(
    frames: Callable[..., tuple[Frame, Frame]], encodings: tuple[str, str]
) -> None:
    both = [replace(one, encoding=kind) for one, kind in zip(frames(), encodings, strict=True)]

    check_belonging(both[0], both[1], flash_only=True)


def test_a_rendered_flash_part_alone_does_not_go_with_sensor_values(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()

    with pytest.raises(PairMismatchError, match="holds sensor values, the one with it sRGB values"):
        paired((replace(before, encoding="raw"), replace(after, encoding="srgb")), flash_only=True)


@pytest.mark.parametrize(
    "cameras",
    [(("Nikon", "D1"), ("Canon", "EOS")), (("Nikon", "D1"), ("Nikon", "D2"))],
    ids=["makes", "models"],
)
def test_photographs_of_two_cameras_are_refused(
    frames: Callable[..., tuple[Frame, Frame]], cameras: tuple[tuple[str, str], tuple[str, str]]
) -> None:
    both = [
        replace(one, make=make, model=model)
        for one, (make, model) in zip(frames(), cameras, strict=True)
    ]

    with pytest.raises(PairMismatchError) as refused:
        paired((both[0], both[1]))

    first, second = (" ".join(camera) for camera in cameras)
    assert f"without the flash is of a {first}, the one with it of a {second}" in str(refused.value)


@pytest.mark.parametrize(
    "camera", [(" NIKON ", "d1 "), ("", "D2"), ("Canon", ""), ("", "")], ids=repr
)
def test_one_camera_may_be_spelt_in_two_ways_or_be_unknown(
    frames: Callable[..., tuple[Frame, Frame]], camera: tuple[str, str]
) -> None:
    before, after = frames()
    make, model = camera

    check_belonging(
        replace(before, make="Nikon", model="D1"), replace(after, make=make, model=model), False
    )


@pytest.mark.parametrize("same", ["file", "pixels"])
def test_identical_photographs_are_refused(
    frames: Callable[..., tuple[Frame, Frame]], same: str
) -> None:
    before, after = frames()
    twin = replace(after, sha256=before.sha256) if same == "file" else replace(before, sha256="x")

    with pytest.raises(UnusablePairError, match=r"^The two photographs are identical: send one"):
        paired((before, twin))


def test_an_exposure_ratio_that_was_given_is_named_where_the_light_is_missing(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    with pytest.raises(
        SwappedPairError,
        match=r"^With the exposure ratio given, 100, the photograph with the flash is darker than "
        r"the one without it: pass the flash frame's exposure divided by the other's, or swap ",
    ):
        paired(frames(), exposure_ratio=100)


def test_a_flash_that_exif_does_not_know_of_is_no_reason_to_refuse(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    """A radio trigger: the camera fired no flash of its own, and the light is there."""
    before, after = frames(flash_fired=False)

    assert paired((before, after)).warnings == ()


# photographs without light


@pytest.mark.parametrize(
    ("value", "share", "black"),
    [
        ((1.9e-4, 1.9e-4, 1.9e-4), 1.0, True),
        ((2.1e-4, 2.1e-4, 2.1e-4), 1.0, False),
        ((0.0, 0.0, 2.1e-4), 1.0, False),
        ((0.5, 0.5, 0.5), 0.02, False),
        ((0.5, 0.5, 0.5), 0.005, True),
    ],
)
@pytest.mark.parametrize("which", [0, 1])
def test_black_is_what_the_hundredth_brightest_pixel_is(
    frame: Callable[..., Frame],
    value: tuple[float, float, float],
    share: float,
    black: bool,
    which: int,
) -> None:
    pixels = np.zeros((800, 40, 3))
    pixels[: round(800 * share)] = value
    both = [frame(np.full((800, 40, 3), 0.5))] * 2
    both[which] = frame(pixels)

    if black:
        with pytest.raises(UnusablePairError, match=f"{('without', 'with')[which]} the flash is b"):
            check_light(both[0], both[1])
    else:
        check_light(both[0], both[1])


@pytest.mark.parametrize(
    ("part", "share", "rest", "words"),
    [
        (3.2, 0.025, 0.0, None),
        (3.2, 0.01, 0.0, "adds too little light"),
        (2.8, 1.0, 0.0, "adds too little light"),
        (-2.2, 0.65, 100.0, "is darker than the one without it"),
        (-2.2, 0.55, 100.0, None),
        (-1.8, 1.0, 0.0, "adds too little light"),
        (-3.2, 0.04, 0.0, "adds too little light"),
        (-3.2, 0.07, 0.0, "is darker than the one without it"),
        (-2.8, 0.55, 0.0, "adds too little light"),
    ],
)
@pytest.mark.parametrize("clipped", [-100.0, 100.0])
def test_the_flash_part_is_measured_by_its_noise(
    part: float, share: float, rest: float, words: str | None, clipped: float
) -> None:
    """In deviations of a pixel's difference, of which each photograph has its own share.

    Nothing is told by clipped pixels, here the lower half.
    """
    deviation = np.sqrt(3 * (1e-6 + 3e-6))
    noises = Noise(np.zeros(3), np.full(3, 1e-6)), Noise(np.zeros(3), np.full(3, 3e-6))
    unusable = np.zeros((800, 80), bool)
    unusable[400:] = True
    deviations = np.full((800, 80, 1), rest)
    deviations[: round(400 * share)] = part
    deviations[400:] = clipped
    before = np.full((800, 80, 3), 0.5, np.float32)
    after = (before + deviations * deviation / 3).astype(np.float32)

    if words is None:
        check_flash_adds(before, after, unusable, noises)
    else:
        with pytest.raises(UnusablePairError, match=words):
            check_flash_adds(before, after, unusable, noises)


@pytest.mark.parametrize(("which", "name"), [(0, "without"), (1, "with")])
def test_black_photographs_are_refused(
    frames: Callable[..., tuple[Frame, Frame]],
    frame: Callable[..., Frame],
    which: int,
    name: str,
) -> None:
    both = list(frames())
    both[which] = frame(np.random.default_rng(2).normal(0, 3e-5, (96, 128, 3)))

    with pytest.raises(UnusablePairError, match=rf"^The photograph {name} the flash is black"):
        paired((both[0], both[1]), exposure_ratio=1.0)


def test_a_dark_photograph_is_not_black(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    """A hundredth of the light: told to be darker, since it is the one with the flash."""
    before, _ = frames()
    dim = replace(before, pixels=before.pixels[:] * np.float32(0.01), sha256="another")

    with pytest.raises(UnusablePairError, match=r"^The photograph with the flash is darker"):
        paired((before, dim))


def test_a_flash_that_adds_nothing_is_refused(
    light: tuple[Floats64, Floats64], frame: Callable[..., Frame]
) -> None:
    rng = np.random.default_rng(3)
    before, after = (frame(light[0] + rng.normal(0, 0.004, light[0].shape)) for _ in range(2))

    with pytest.raises(UnusablePairError, match=r"^The flash adds too little light to measure"):
        paired((before, after))


@pytest.mark.parametrize("which", [0, 1])
def test_pairs_clipped_everywhere_are_refused(
    frames: Callable[..., tuple[Frame, Frame]], which: int
) -> None:
    both = list(frames())
    both[which] = replace(both[which], saturated=np.ones((96, 128), bool))

    with pytest.raises(UnusablePairError, match=r"^Every pixel is clipped in one of the"):
        paired((both[0], both[1]))


def test_photographs_that_differ_in_their_last_row_alone_are_two() -> None:
    first = Frame(np.full((600, 40, 3), 0.2, np.float32), np.zeros((600, 40), bool), "raw", "a")
    pixels = first.pixels[:].copy()
    pixels[-1, -1, 2] = 0.3

    check_belonging(first, replace(first, pixels=pixels, sha256="b"), False)

    with pytest.raises(UnusablePairError, match="identical"):
        check_belonging(first, replace(first, pixels=first.pixels[:].copy(), sha256="b"), False)


# photographs without colour


def greyed(frame: Frame, apart: float, **more: Any) -> Frame:
    """All channels alike, but for one pixel whose channels are so far apart."""
    pixels = np.repeat(np.clip(frame.pixels[..., 1:2], 0.05, 0.9), 3, axis=2)
    if more.get("encoding") == "srgb":
        pixels = linear_to_srgb(pixels)
    pixels[1, 1, 0] += apart
    if more.get("encoding") == "srgb":
        pixels = srgb_to_linear(pixels)
    return replace(frame, pixels=pixels, **more)


@pytest.mark.parametrize(("encoding", "code"), [("srgb", 1 / 255), ("linear", 1 / 65535)])
@pytest.mark.parametrize(("codes", "grey"), [(0, True), (2, True), (3, False)])
def test_grey_photographs_saved_in_colour_are_refused(
    frames: Callable[..., tuple[Frame, Frame]],
    encoding: str,
    code: float,
    codes: int,
    grey: bool,
) -> None:
    both = [greyed(one, codes * code, encoding=encoding) for one in frames()]

    if grey:
        with pytest.raises(UnusablePairError, match="are grey, but lamps are told apart by their"):
            paired((both[0], both[1]))
    else:
        check_colours(both[0], both[1])


@pytest.mark.parametrize("which", [0, 1])
def test_one_photograph_without_colour_is_no_reason_to_refuse(
    frames: Callable[..., tuple[Frame, Frame]], which: int
) -> None:
    """A grey wall under light that the camera takes as white."""
    both = list(frames())
    both[which] = greyed(both[which], 0.0)

    check_colours(both[0], both[1])


def test_sensor_values_are_never_taken_as_grey(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    both = [greyed(one, 0.0, encoding="raw") for one in frames()]

    check_colours(both[0], both[1])


def test_clipped_pixels_have_no_colour_to_tell(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    """A clipped pixel does not make grey photographs coloured, and clipped ones are not grey."""
    both = [greyed(one, 0.5) for one in frames()]
    some, every = np.zeros((96, 128), bool), np.ones((96, 128), bool)
    some[1, 1] = True

    with pytest.raises(UnusablePairError, match="are grey"):
        check_colours(replace(both[0], saturated=some), replace(both[1], saturated=some))
    check_colours(replace(both[0], saturated=every), replace(both[1], saturated=every))
