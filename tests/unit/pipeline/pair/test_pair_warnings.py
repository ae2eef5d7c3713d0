from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.frames import Exposure, Frame
from pipeline.options import Options
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.banding import Banding
from pipeline.pair.exposure import ExposureRatio
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.pair import make_pair
from pipeline.pair.pair_warnings import (
    blur_warnings,
    copy_warnings,
    darkening_warnings,
    flicker_warnings,
    moved_warnings,
    rendering_warnings,
    rows_are_columns,
    vignetting_warnings,
)
from pipeline.pair.ratios import Ratios
from pipeline.pair.relative_blur import RelativeBlur
from pipeline.pair.rendering import Rendering
from pipeline.pair.vignetting import Vignetting
from pipeline.progress import Progress
from pipeline.run_warnings import Code, RunWarning

EXPOSURE = Exposure(time_s=1 / 60, iso=200, f_number=4)


def warned(frames: tuple[Frame, Frame], ratio: float | None = None) -> tuple[RunWarning, ...]:
    return make_pair(*frames, Options(exposure_ratio=ratio), Progress()).warnings


def test_what_looks_like_the_photograph_over_again_is_warned_of(
    light: tuple[Floats64, Floats64], frame: Callable[..., Frame]
) -> None:
    """The same light, exposed for longer than the files say."""
    rng = np.random.default_rng(4)
    before = frame(light[0] + rng.normal(0, 1e-4, light[0].shape), exposure=EXPOSURE)
    after = frame(1.5 * light[0] + rng.normal(0, 1e-4, light[0].shape), exposure=EXPOSURE)

    (warning,) = warned((before, after))

    assert warning.message.startswith("What the flash added looks like the photograph without it")


@pytest.mark.parametrize("flash_only", [False, True])
@pytest.mark.parametrize(
    ("stops", "colours", "told"),
    [
        (0.7, (0.0, 0.0, 0.0), True),  # 0.35 between the quartiles
        (0.9, (0.0, 0.0, 0.0), False),
        (0.0, (0.15, 0.0, -0.05), True),  # 0.2
        (0.0, (0.2, 0.0, -0.1), False),  # a lamp that lights what the flash does, in its own colour
    ],
)
def test_a_flash_part_is_a_copy_within_its_spread_and_its_colours(
    stops: float, colours: tuple[float, ...], told: bool, flash_only: bool
) -> None:
    """stops: from edge to edge of the picture. colours: stops by channel."""
    before = np.full((64, 800, 3), 0.2)
    across = stops * np.linspace(-0.5, 0.5, 800)[None, :, None]
    part = 0.5 * before * 2 ** (across + np.array(colours))
    after = part if flash_only else before + part

    found = copy_warnings(before.astype(np.float32), after.astype(np.float32), flash_only)

    assert [warning.code for warning in found] == ["flash_like_lamps"] * told


def test_where_the_flash_adds_nothing_there_is_no_copy() -> None:
    before = np.full((4, 4, 3), 0.2, np.float32)

    assert copy_warnings(before, before, flash_only=False) == []


@pytest.mark.parametrize(
    ("colour", "said"),
    [((0.4, 0.4, 0.4), True), ((0.5, 0.4, 0.3), False), ((0.4, 0.4, 0.6), False)],
)
def test_a_wall_that_lamps_and_flash_light_evenly_is_no_copy(
    colour: tuple[float, float, float], said: bool
) -> None:
    """The flash has another colour than the lamps; what is the same light for longer has not."""
    rng = np.random.default_rng(4)
    wall = np.full((80, 120, 3), 0.2, np.float32)
    far = np.linspace(1.0, 0.8, 120, dtype=np.float32)[:, None]
    flash = (
        wall
        + far * np.array(colour, np.float32)
        + rng.normal(0, 2e-3, wall.shape).astype(np.float32)
    )

    assert bool(copy_warnings(wall, flash, flash_only=False)) is said


@pytest.mark.parametrize(
    ("ratio", "balanced", "said"),
    [
        (1.0, False, []),
        (1.0, True, ["The camera balanced the white of each photograph by itself"]),
        (0.5, False, ["The photographs were exposed differently (0.5 times) and rendered"]),
        (1.05, False, []),
    ],
)
def test_rendering_that_may_differ_is_warned_of(
    frames: Callable[..., tuple[Frame, Frame]], ratio: float, balanced: bool, said: list[str]
) -> None:
    warnings = warned(frames(scale=ratio, encoding="srgb", auto_white_balance=balanced), ratio)

    assert len(warnings) == len(said)
    for warning, start in zip(warnings, said, strict=True):
        assert warning.message.startswith(start)


def test_dngs_that_may_be_scaled_are_warned_of_unless_a_ratio_is_given(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    no_flash, flash = frames(encoding="raw")
    flash = replace(flash, baseline_ev=1.0)

    (warning,) = warned((no_flash, flash))

    assert warning.code == "exposure_mismatch"
    assert warning.figures == {"ratio": 1.0, "ratio_by_baseline": 0.5}
    assert warning.message.startswith("By their BaselineExposure the two DNGs are shown")
    assert warned((no_flash, flash), 1.0) == ()
    assert warned((replace(no_flash, baseline_ev=1.0), flash)) == ()


@pytest.mark.parametrize("which", [0, 1])
def test_white_that_was_balanced_in_one_alone_is_warned_of(
    frames: Callable[..., tuple[Frame, Frame]], which: int
) -> None:
    both = list(frames(encoding="srgb", auto_white_balance=False))
    both[which] = replace(both[which], auto_white_balance=True)

    (warning,) = warned((both[0], both[1]), 1.0)

    assert warning.code == "auto_white_balance"
    assert warning.message.startswith("The camera balanced the white of one photograph by itself")


@pytest.mark.parametrize("balanced", [None, True])
def test_a_balance_that_was_found_to_differ_is_warned_of_with_its_gains(
    frames: Callable[..., tuple[Frame, Frame]], balanced: bool | None
) -> None:
    both = frames(encoding="srgb", auto_white_balance=balanced)

    (warning,) = rendering_warnings(*both, 1.0, Rendering(balance=BalanceChange(1.304, 0.7512)))

    assert warning.code == "auto_white_balance"
    assert "red times 1.30, blue times 0.75" in warning.message
    assert "lock the white balance, or send RAW" in warning.message
    assert warning.figures == {"red": 1.304, "blue": 0.751}


def test_a_local_tone_mapping_that_was_found_is_warned_of_with_its_factors(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    both = frames(encoding="srgb", auto_white_balance=False)
    mapping = LocalToneMapping(np.log([[0.9, 1.333]]), 8, 0.25)

    (warning,) = rendering_warnings(*both, 1.0, Rendering(mapping=mapping))

    assert warning.code == "local_tone_mapping"
    assert "were multiplied by 0.90 to 1.33" in warning.message
    assert "switch HDR and the like off, or send RAW" in warning.message
    assert warning.figures == {"power": 0.25, "least": 0.9, "most": 1.333}


@pytest.mark.parametrize(("which", "name"), [(0, "without"), (1, "with")])
def test_one_photograph_without_colour_is_told(
    frames: Callable[..., tuple[Frame, Frame]], which: int, name: str
) -> None:
    both = list(frames(encoding="srgb"))
    green = np.asarray(both[which].pixels[..., 1:2])
    both[which] = replace(both[which], pixels=np.repeat(green, 3, axis=2))

    warnings = rendering_warnings(both[0], both[1], 1.0, Rendering())

    assert [warning.code for warning in warnings] == ["one_grey"]
    assert warnings[0].message.startswith(f"The photograph {name} the flash is grey, the other")
    assert rendering_warnings(both[which], both[which], 1.0, Rendering()) == []


def test_linear_values_may_be_exposed_as_they_like(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    assert warned(frames(scale=0.5, auto_white_balance=True), 0.5) == ()


def banded(rows: int, columns: int, down: bool) -> Ratios:
    """Blocks whose ratio has twelve waves of 5 %, down the rows of the picture or across them."""
    y, x = np.mgrid[:rows, :columns] / np.array([rows, columns])[:, None, None]
    waves = 0.05 * np.sin(2 * np.pi * 12 * (y if down else x))
    logs = np.repeat(waves[..., None], 3, axis=2)
    usable = np.ones((rows, columns), bool)
    return Ratios(np.ones_like(logs), logs, np.full_like(logs, 1e-3), usable, 1)


@pytest.mark.parametrize(
    ("size", "orientation", "down"),
    [
        ((150, 200), 1, True),
        ((150, 200), 3, True),
        ((200, 150), 6, False),
        ((200, 150), 8, False),
        ((200, 150), 1, False),
        ((180, 180), 1, True),
        ((180, 180), 5, False),
        ((180, 180), 7, False),
    ],
)
def test_bands_run_along_the_rows_of_the_sensor(
    size: tuple[int, int], orientation: int, down: bool
) -> None:
    """Of an upright picture they are columns, whether its file says that it was turned or not."""
    by_columns = rows_are_columns(size, orientation)

    (warning,) = flicker_warnings(banded(*size, down), None, by_columns)

    assert warning.code == "flicker"
    assert warning.figures["height"] == pytest.approx(0.05, rel=0.1)
    assert "mains. Expose for a multiple of 1/100 s" in warning.message
    assert flicker_warnings(banded(*size, not down), None, by_columns) == []


def test_bands_that_were_taken_off_are_told_with_their_height() -> None:
    """What is left of them is not."""
    banding = Banding(100.0, np.array([0.0, 0.2, 0.0, 0.0]), by_columns=False)

    (warning,) = flicker_warnings(banded(150, 200, True), banding, False)

    assert warning.code == "flicker"
    assert warning.message.startswith("Bands of 20.0% of the light run across the picture: a lamp")
    assert "it was taken off as far as a pair tells: expose for a multiple" in warning.message
    assert warning.figures == {"height": pytest.approx(0.2)}


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        (-0.25, "The corners of the photograph with the flash are 25% darker than those of the ph"),
        (0.25, "The corners of the photograph without the flash are 20% darker than those of the"),
    ],
)
def test_the_photograph_with_the_darker_corners_is_told(corners: float, said: str) -> None:
    (warning,) = vignetting_warnings(Vignetting(corners))

    assert warning.code == "vignetting"
    assert warning.message.startswith(said)
    assert "use one aperture" in warning.message
    assert warning.figures == {"corners": corners}
    assert vignetting_warnings(None) == []


def test_lamps_that_flicker_are_told_of_an_upright_pair(frame: Callable[..., Frame]) -> None:
    rng = np.random.default_rng(6)
    surfaces = rng.uniform(0.2, 0.8, (12, 16, 3)).repeat(16, 0).repeat(16, 1)
    y = np.arange(192)[:, None, None] / 192
    lamps = 0.5 * surfaces * [1.0, 0.7, 0.4]
    one, other = (lamps * (1 + 0.15 * np.sin(2 * np.pi * (9 * y + phase))) for phase in (0.1, 0.45))
    lying = [light + rng.normal(0, 1e-3, light.shape) for light in (one, other + 0.3 * surfaces)]
    given = {"exposure": EXPOSURE, "orientation": 6, "written_orientation": 6}
    before, after = (frame(np.rot90(light, -1), **given) for light in lying)

    assert [warning.code for warning in warned((before, after))] == ["flicker"]


@pytest.mark.parametrize(
    ("source", "share", "code"),
    [
        ("option", 0.0019, None),
        ("option", 0.0021, "exposure_mismatch"),
        ("exif", 0.0021, None),
        ("exif", 0.0099, None),
        ("exif", 0.0101, "light_changed"),
    ],
)
def test_a_ratio_that_people_give_is_doubted_sooner_than_the_light(
    source: str, share: float, code: str | None
) -> None:
    found = darkening_warnings(ExposureRatio(1.0, source), banded(40, 40, True), share)

    assert [warning.code for warning in found] == [code] * (code is not None)
    assert all(warning.figures["share"] == share for warning in found)


@pytest.mark.parametrize(("moved", "told"), [(0.002, False), (0.0021, True)])
def test_motion_is_told_of_in_more_than_a_500th_of_the_picture(moved: float, told: bool) -> None:
    found = moved_warnings(moved)

    assert [(warning.code, warning.figures) for warning in found] == [
        ("moved", {"share": moved})
    ] * told


def test_each_photograph_that_is_less_sharp_is_told_by_name() -> None:
    """A hand may shake along another direction in each."""
    shaken = np.array([[9.0, 0.0], [0.0, 4.0]])

    first, second = blur_warnings(RelativeBlur(shaken, np.diag([1.0, 4.16]), np.zeros(2)))

    assert first.code == second.code == Code.BLURRED
    assert first.figures == {"no_flash_px": pytest.approx(3.0)}
    assert "photograph without the flash is less sharp than the other, by a blur of 3 pixels" in (
        first.message
    )
    assert second.figures == {"flash_px": pytest.approx(2.04, abs=1e-3)}
    assert "photograph with the flash is less sharp than the other, by a blur of 2 pixels" in (
        second.message
    )
