from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.errors import Canceled, OptionError
from pipeline.images.frames import Exposure, Frame
from pipeline.images.noise import Noise
from pipeline.options import Options
from pipeline.pair.estimate_noise import estimate_noises
from pipeline.pair.motion import find_moved
from pipeline.pair.pair import make_pair
from pipeline.progress import Progress
from tests.unit.pipeline.pair.pairs_of_frames import paired

EXPOSURE = Exposure(time_s=1 / 60, iso=200, f_number=4)


def test_a_sound_pair_is_taken_without_a_word(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()

    pair = paired((before, after))

    np.testing.assert_array_equal(pair.no_flash, before.pixels)
    np.testing.assert_array_equal(pair.flash, after.pixels)
    assert pair.flash[:].dtype == np.float32
    assert pair.warnings == ()
    assert pair.exposure_ratio == 1
    assert not pair.flash_only
    assert not pair.unusable.any()
    assert not pair.alignment.applied
    assert pair.alignment.problem is None


def test_noise_is_that_of_each_photograph_on_the_common_scale(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames(scale=0.25)

    pair = paired((before, after), exposure_ratio=0.25, align=False)

    level = np.full(3, 0.2)
    as_given = [
        estimate_noises(one.pixels, other.pixels)[0]
        for one, other in ((before, after), (after, before))
    ]
    np.testing.assert_allclose(pair.no_flash_noise.variance(level), as_given[0].variance(level))
    np.testing.assert_allclose(
        pair.flash_noise.variance(level), 16 * as_given[1].variance(level / 4), rtol=1e-3
    )


def test_noise_is_told_beside_what_is_clipped(frames: Callable[..., tuple[Frame, Frame]]) -> None:
    """In one of them alone: what is of one value in both tells nothing by itself."""
    before, after = frames()
    assert isinstance(before.pixels, np.ndarray)
    before.pixels[:20] = 1.0
    before.saturated[:20] = True
    level = np.full(3, 0.2)

    pair = paired((before, after), align=False)

    beside, all_of_it = (
        estimate_noises(before.pixels, after.pixels, unusable)[0].variance(level)
        for unusable in (before.saturated, None)
    )
    np.testing.assert_array_equal(pair.no_flash_noise.variance(level), beside)
    assert (beside > 1.5 * all_of_it).all()


def test_what_compression_changed_is_noise_on_the_common_scale(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    changed = Noise(np.full(3, 1e-3), np.full(3, 1e-5), grain=2.0)
    before, after = frames(scale=0.25)
    options = {"exposure_ratio": 0.25, "align": False}

    plain = paired((before, after), **options)
    pair = paired((replace(before, compression=changed), after), **options)
    other = paired((before, replace(after, compression=changed)), **options)

    level = np.full(3, 0.2)
    added = pair.no_flash_noise.variance(level) - plain.no_flash_noise.variance(level)
    np.testing.assert_allclose(added, changed.variance(level))
    added = other.flash_noise.variance(level) - plain.flash_noise.variance(level)
    np.testing.assert_allclose(added, 16 * changed.variance(level / 4))


# ratio of the exposures


def test_the_ratio_follows_from_the_exif(frames: Callable[..., tuple[Frame, Frame]]) -> None:
    """Half the time, double the speed, one stop down: 0.5·2/2."""
    before, after = frames(scale=0.5)
    shorter = Exposure(time_s=1 / 120, iso=400, f_number=4 * np.sqrt(2))

    pair = paired((before, replace(after, exposure=shorter)))

    assert pair.exposure_ratio == pytest.approx(0.5)
    np.testing.assert_allclose(pair.flash[:], 2 * after.pixels[:], rtol=1e-5)
    assert pair.warnings == ()


def test_the_ratio_given_goes_before_the_exif(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames(scale=0.25)

    pair = paired((before, after), exposure_ratio=0.25)

    assert pair.exposure_ratio == 0.25
    np.testing.assert_allclose(pair.flash[:], 4 * after.pixels[:], rtol=1e-5)


@pytest.mark.parametrize(
    "unknown",
    [
        Exposure(),
        Exposure(time_s=1 / 60, iso=200),
        Exposure(time_s=1 / 60, f_number=4),
        Exposure(iso=200, f_number=4),
        Exposure(time_s=0.0, iso=200, f_number=4),
    ],
    ids=["nothing", "no f-number", "no speed", "no time", "no time but a zero"],
)
@pytest.mark.parametrize("which", [0, 1])
def test_equal_exposures_are_assumed_with_a_warning(
    frames: Callable[..., tuple[Frame, Frame]], unknown: Exposure, which: int
) -> None:
    both = list(frames())
    both[which] = replace(both[which], exposure=unknown)

    pair = paired((both[0], both[1]))

    assert pair.exposure_ratio == 1
    (warning,) = pair.warnings
    assert warning.message.startswith("The files do not say how they were exposed")


def test_a_flash_part_alone_needs_no_exposure(
    frames: Callable[..., tuple[Frame, Frame]],
    frame: Callable[..., Frame],
    light: tuple[Floats64, Floats64],
) -> None:
    before, _ = frames(exposure=Exposure())
    part = frame(light[1])

    pair = paired((before, part), flash_only=True)

    assert pair.flash_only
    assert pair.warnings == ()
    np.testing.assert_array_equal(pair.flash, part.pixels)


@pytest.mark.parametrize("time_s", [1e-5, 4000.0])
def test_an_absurd_ratio_is_refused(
    frames: Callable[..., tuple[Frame, Frame]], time_s: float
) -> None:
    before, after = frames()
    odd = replace(after, exposure=replace(EXPOSURE, time_s=time_s))

    with pytest.raises(OptionError, match=r"^The exposures in the files differ .* times: pass"):
        paired((before, odd))

    assert paired((before, odd), exposure_ratio=1.0).exposure_ratio == 1


def test_pixels_clipped_in_either_are_marked(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()
    before.saturated[:10] = True
    after.saturated[:, :5] = True

    pair = paired((before, after))

    assert pair.unusable[:10].all()
    assert pair.unusable[:, :5].all()
    assert not pair.unusable[10:, 5:].any()


def test_pixels_transparent_in_either_are_unusable_but_not_clipped(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()
    rows, columns = np.zeros((2, *before.saturated.shape), dtype=bool)
    rows[:10] = True
    columns[:, :5] = True

    pair = paired((replace(before, empty=rows), replace(after, empty=columns)))

    assert pair.unusable[rows | columns].all()
    assert not pair.unusable[10:, 5:].any()
    assert pair.clipped == 0.0


# alignment


def shifted(after: Frame) -> Frame:
    """The camera moved by four pixels; what came into view is grey."""
    moved = np.roll(after.pixels, 4, axis=1)
    moved[:, :4] = 0.2
    return replace(after, pixels=moved)


def test_a_moved_frame_is_laid_on_the_other_and_uncovered_pixels_are_out(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()

    pair = paired((before, shifted(after)))

    assert pair.alignment.applied
    assert pair.warnings == ()
    assert pair.unusable[:, -4:].mean() > 0.9
    assert pair.unusable[:, 4:-8].mean() < 0.05
    inner = (slice(8, -8), slice(8, -12))
    assert np.abs(pair.flash[:] - after.pixels[:])[inner].mean() < 0.01


def test_alignment_may_be_left_out(frames: Callable[..., tuple[Frame, Frame]]) -> None:
    before, after = frames()
    moved = shifted(after)

    pair = paired((before, moved), align=False)

    assert not pair.alignment.applied
    assert pair.alignment.correlation is None
    np.testing.assert_array_equal(pair.flash, moved.pixels)


def test_a_failed_alignment_is_a_warning(
    frames: Callable[..., tuple[Frame, Frame]], frame: Callable[..., Frame]
) -> None:
    before, _ = frames()
    rng = np.random.default_rng(5)
    other = cv2.GaussianBlur(rng.uniform(0, 1, (96, 128, 3)), (0, 0), 2) + 0.4

    pair = paired((before, frame(other, exposure=EXPOSURE)))

    assert not pair.alignment.applied
    assert any("could not be aligned" in warning.message for warning in pair.warnings)


@pytest.mark.parametrize("after_reports", [0, 1, 2, 3])
def test_cancel_is_heard_between_the_steps(
    frames: Callable[..., tuple[Frame, Frame]], after_reports: int
) -> None:
    reports: list[str] = []
    progress = Progress(
        lambda stage, _: reports.append(stage), lambda: len(reports) == after_reports
    )

    with pytest.raises(Canceled):
        make_pair(*frames(), Options(), progress)

    assert reports == ["align"] * after_reports


# what moved, and what the exposures are held against


def test_what_moved_is_unusable_and_told(
    frames: Callable[..., tuple[Frame, Frame]], frame: Callable[..., Frame]
) -> None:
    """A red thing that left: dark against the flash photograph's wall."""
    before, after = frames()
    moved = before.pixels[:].copy()
    moved[30:66, 40:80] = [0.5, 0.05, 0.05] * np.ones((36, 40, 3), np.float32)

    pair = paired((frame(moved, exposure=EXPOSURE), after))

    assert pair.unusable[34:62, 44:76].mean() > 0.8
    assert pair.unusable[:20].mean() < 0.02
    assert pair.moved == pytest.approx(pair.unusable.mean(), abs=1e-6)
    assert any(
        w.message.startswith("Something moved between the photographs") for w in pair.warnings
    )


@pytest.mark.parametrize(
    ("source", "code"), [("option", "exposure_mismatch"), ("exif", "light_changed")]
)
def test_places_that_a_wrong_ratio_darkens_have_not_moved(
    frames: Callable[..., tuple[Frame, Frame]],
    frame: Callable[..., Frame],
    source: str,
    code: str,
) -> None:
    """The flash casts a soft shadow, which a ratio of 1.5 makes darker than without any flash."""
    before, after = frames()
    y, x = np.mgrid[: before.pixels.shape[0], : before.pixels.shape[1]]
    shadow = np.clip(1.5 - np.hypot(y - 40, x - 60) / 20, 0, 1)[..., None]
    shadowed = before.pixels[:] + (1 - shadow) * (after.pixels[:] - before.pixels[:])
    longer = replace(EXPOSURE, time_s=1 / 40) if source == "exif" else EXPOSURE
    options = {"exposure_ratio": 1.5} if source == "option" else {}

    right = paired((before, frame(shadowed.astype(np.float32), exposure=EXPOSURE)))
    wrong = paired((before, frame(shadowed.astype(np.float32), exposure=longer)), **options)

    assert right.warnings == ()
    assert wrong.moved == 0
    assert not wrong.unusable.any()
    assert [w.code for w in wrong.warnings] == [code]
    if source == "option":
        message = wrong.warnings[0].message
        assert message.startswith("The exposure ratio given, 1.5, makes ")
        assert wrong.warnings[0].figures["ratio_at_most"] == pytest.approx(1.0, abs=0.15)


def test_what_is_only_darker_does_not_count_as_moved(frame: Callable[..., Frame]) -> None:
    """A sharp shadow of the flash, darkened by a wrong ratio, looks like a thing that came."""
    rng = np.random.default_rng(1)
    patches = rng.uniform(0.2, 0.9, (12, 16, 3)).repeat(20, 0).repeat(20, 1)
    albedo = cv2.GaussianBlur(patches, (0, 0), 0.8)
    u = np.linspace(0, 1, 320)[None, :, None]
    lamps = albedo * (0.15 + 0.5 * (1 - u)) * np.array([1.0, 0.7, 0.4])
    strip = np.zeros((240, 320))
    strip[:, 200:240] = 1
    shadow = cv2.GaussianBlur(strip, (0, 0), 1)[..., None]
    lit = lamps + 0.4 * albedo * (1 - shadow)
    before, after = (
        frame(light + rng.normal(size=light.shape) * 0.002, exposure=EXPOSURE)
        for light in (lamps, lit)
    )
    options = Options(exposure_ratio=2, align=False)
    unusable = np.zeros((240, 320), bool)
    darkened = after.pixels[:] / np.float32(2)
    noises = estimate_noises(before.pixels, darkened)
    assert find_moved(before.pixels, darkened, unusable, noises, rendered=False).mean() > 0.01

    pair = make_pair(before, after, options, Progress())

    assert pair.moved == 0
    assert not pair.unusable.any()
    assert [w.code for w in pair.warnings] == ["exposure_mismatch"]


def test_a_ratio_from_the_pixels_scales_the_flash_frame(
    frame: Callable[..., Frame],
    light: tuple[Floats64, Floats64],
) -> None:
    lamps, flash = light
    part = flash * np.array([0.6, 0.8, 1.0])
    part[:40] = 0
    rng = np.random.default_rng(1)
    grain = rng.normal(0, 0.001, (2, *lamps.shape))
    both = frame(lamps + grain[0]), frame(0.5 * (lamps + part) + grain[1])

    pair = paired(both, align=False)

    assert pair.exposure_source == "pixels"
    assert pair.exposure_ratio == pytest.approx(0.5, rel=0.02)
    scaled = both[1].pixels[:] / np.float32(pair.exposure_ratio)
    np.testing.assert_allclose(pair.flash[:], scaled, 1e-5)


def test_a_frame_that_was_moved_lies_beside_by_a_part_of_a_pixel(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()

    assert paired((before, after)).registration_px == 0
    assert 0.1 < paired((before, shifted(after))).registration_px < 1


@pytest.mark.parametrize(
    ("encoding", "rendered"), [("srgb", True), ("linear", False), ("raw", False)]
)
@pytest.mark.parametrize("flash_only", [False, True])
def test_a_rendered_pair_is_known_as_one(
    frames: Callable[..., tuple[Frame, Frame]],
    encoding: Any,
    rendered: bool,
    flash_only: bool,
) -> None:
    before, after = (replace(one, encoding=encoding) for one in frames())

    assert paired((before, after), flash_only=flash_only).rendered is rendered


@pytest.mark.parametrize(
    ("times", "cut", "encoding", "clipping"),
    [
        ((8, 8), (False, False), "linear", np.inf),
        ((8, 8), (True, True), "linear", 1.0),
        ((8, 8), (False, False), "raw", 1.0),
        ((1, 1), (False, False), "linear", 1.0),
        ((1, 8), (False, False), "linear", np.inf),
        ((1, 8), (True, False), "linear", 1.0),
        ((8, 8), (True, False), "linear", 1.0),
        ((8, 8), (False, True), "linear", np.inf),
        ((1, 8), (False, True), "linear", 1.0),
    ],
)
def test_floats_that_go_on_above_1_were_not_cut_off_there(
    frames: Callable[..., tuple[Frame, Frame]],
    times: tuple[float, float],
    cut: tuple[bool, bool],
    encoding: str,
    clipping: float,
) -> None:
    """It is the no-flash photograph of whose clipping the value tells."""
    before, after = (
        replace(one, pixels=one.pixels[:] * np.float32(by), encoding=encoding)
        for one, by in zip(frames(), times, strict=True)
    )
    before.saturated[:2, :2], after.saturated[:2, :2] = cut

    pair = paired((before, after), align=False, exposure_ratio=times[1] / times[0])

    assert pair.clipping == clipping
    np.testing.assert_array_equal(pair.no_flash, before.pixels)


@pytest.mark.parametrize(
    ("encoding", "times", "clipping"),
    [("raw", 1, 1.0), ("linear", 1, 1.0), ("linear", 8, np.inf)],
)
def test_a_flash_part_alone_does_not_tell_where_the_photograph_was_cut_off(
    frames: Callable[..., tuple[Frame, Frame]],
    frame: Callable[..., Frame],
    light: tuple[Floats64, Floats64],
    encoding: str,
    times: float,
    clipping: float,
) -> None:
    before, _ = frames()
    before = replace(before, pixels=before.pixels[:] * np.float32(times), encoding=encoding)
    part = frame(8 * light[1])

    assert paired((before, part), flash_only=True, align=False).clipping == clipping
