from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.pair.estimate_noise import estimate_noises
from pipeline.pair.motion import find_moved

HEIGHT, WIDTH = 240, 320
NOTHING = np.zeros((HEIGHT, WIDTH), bool)


def wall() -> Floats64:
    """Patches of 20 pixels, (240, 320, 3)."""
    rng = np.random.default_rng(1)
    values = rng.uniform(0.2, 0.9, (HEIGHT // 20, WIDTH // 20, 3))
    return np.asarray(cv2.GaussianBlur(values.repeat(20, 0).repeat(20, 1), (0, 0), 0.8))


def person(x: int) -> Floats64:
    """Where an ellipse stands, (240, 320, 1)."""
    plane = np.zeros((HEIGHT, WIDTH))
    cv2.ellipse(plane, (x, 130), (28, 60), 0, 0, 360, 1.0, -1, cv2.LINE_AA)
    return plane[..., None]


def photographs(
    albedos: tuple[Floats64, Floats64], lamp_shadow: bool = False, flash_shadow: bool = False
) -> tuple[Floats32, Floats32]:
    """Without and with the flash, of what stands there then; noise of a sensor."""
    u = np.linspace(0, 1, WIDTH)[None, :, None]
    lamps = (0.15 + 0.5 * (1 - u)) * np.array([1.0, 0.7, 0.4]) * np.ones((HEIGHT, 1, 1))
    flash = np.full((HEIGHT, WIDTH, 3), 0.4)
    if lamp_shadow:
        lamps[80:160, 60:140] *= 0.3
    if flash_shadow:
        flash[80:160, 180:260] = 0
    rng = np.random.default_rng(2)
    exact = lamps * albedos[0], (lamps + flash) * albedos[1]
    noisy = [light + rng.normal(size=light.shape) * np.sqrt(light / 2e4 + 1e-7) for light in exact]
    return noisy[0].astype(np.float32), noisy[1].astype(np.float32)


def moved_in(
    pair: tuple[Floats32, Floats32],
    unusable: NDArray[np.bool_] = NOTHING,
    rendered: bool = False,
    brightened: float = 1.0,
) -> NDArray[np.bool_]:
    noises = estimate_noises(*pair)
    return find_moved(*pair, unusable, noises, rendered, brightened)


@pytest.mark.parametrize("lamp_shadow", [False, True])
@pytest.mark.parametrize("flash_shadow", [False, True])
@pytest.mark.parametrize("rendered", [False, True])
def test_still_scenes_have_nothing_that_moved(
    lamp_shadow: bool, flash_shadow: bool, rendered: bool
) -> None:
    """Shadows of lamps and of the flash are in one photograph alone, and no motion."""
    pair = photographs((wall(), wall()), lamp_shadow, flash_shadow)

    assert not moved_in(pair, rendered=rendered).any()


@pytest.mark.parametrize(
    ("colour", "least"), [((0.5, 0.35, 0.3), 0.85), ((0.6, 0.1, 0.08), 0.85), ((0.9,) * 3, 0.7)]
)
def test_a_person_who_moved_is_marked_in_both_places(
    colour: tuple[float, float, float], least: float
) -> None:
    albedos = [wall() * (1 - p) + p * np.array(colour) for p in (person(120), person(175))]

    found = moved_in(photographs((albedos[0], albedos[1])))

    there = ((person(120) + person(175)) > 0.5)[..., 0]
    around = cv2.dilate(there.astype(np.uint8), np.ones((31, 31), np.uint8)) > 0
    assert found[there].mean() > least
    assert found[~around].mean() < 0.005


def test_a_lamp_that_became_weaker_is_no_motion() -> None:
    before, after = photographs((wall(), wall()))
    u = np.linspace(0, 1, WIDTH)[None, :, None]

    dimmed = after - 0.6 * before * (u < 0.4)  # more than the flash adds, on the left

    assert moved_in((before, dimmed.astype(np.float32))).mean() < 0.01


@pytest.mark.parametrize("brightened", [1.5, 3.0])
def test_a_person_who_moved_is_marked_in_a_brightened_photograph_too(brightened: float) -> None:
    red = np.array([0.5, 0.1, 0.1])
    albedos = [wall() * (1 - person(x)) + red * person(x) for x in (120, 200)]
    before, after = photographs((albedos[0], albedos[1]))
    plain = moved_in((before, after))

    found = moved_in((before, after), brightened=brightened)

    assert np.mean(found & plain) > 0.7 * plain.mean()


def test_places_that_are_darker_alone_are_gone_in_a_brightened_photograph() -> None:
    """As the flash's shadows are where the ratio of the exposures is wrong."""
    before, after = photographs((wall(), wall()))
    pool = cv2.GaussianBlur(person(160)[..., 0], (0, 0), 6)[..., None]
    darker = before * pool / 1.5 + after * (1 - pool)
    pair = before, darker.astype(np.float32)

    assert moved_in(pair).mean() > 0.01
    assert not moved_in(pair, brightened=1.5).any()
    # the same light in units of its own
    np.testing.assert_array_equal(
        moved_in(pair, brightened=1.5),
        moved_in((before, (1.5 * darker).astype(np.float32))),
    )


@pytest.mark.parametrize("radius", [12, 16, 20])
def test_pools_of_the_flashs_light_are_no_motion(radius: float) -> None:
    """As a mirror or a shiny thing throws them on a wall, where no light of the lamps changes."""
    before, after = photographs((np.full((HEIGHT, WIDTH, 3), 0.6),) * 2)
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    pool = np.exp(-((u - 200) ** 2 + (v - 90) ** 2) / (2 * radius**2))[..., None]

    assert not moved_in((before, after + (0.96 * pool).astype(np.float32))).any()


@pytest.mark.parametrize("soft", [0.0, 3.0])
def test_a_thing_that_comes_out_of_focus_is_no_pool(soft: float) -> None:
    there = person(175)[..., 0]
    if soft:
        there = np.asarray(cv2.GaussianBlur(there, (0, 0), soft), np.float64)
    wall_behind = np.full((HEIGHT, WIDTH, 3), 0.6)
    with_it = wall_behind * (1 - there[..., None]) + 0.9 * there[..., None]

    found = moved_in(photographs((wall_behind, with_it)))

    assert found[there > 0.5].mean() > 0.95


def test_half_a_pixel_of_misalignment_is_no_motion() -> None:
    before, after = photographs((wall(), wall()))
    off = cv2.warpAffine(after, np.array([[1, 0, 0.5], [0, 1, 0.3]]), (WIDTH, HEIGHT), flags=2)

    assert moved_in((before, off.astype(np.float32))).mean() < 0.01


def test_unusable_pixels_tell_of_no_motion() -> None:
    before, after = photographs((wall(), wall()))
    clipped = NOTHING.copy()
    clipped[60:200, 60:200] = True
    after[clipped] = 0.05

    assert not moved_in((before, after), clipped).any()


def test_large_pictures_are_marked_in_full_size() -> None:
    """Four times as large, not a multiple of the block the test works on."""
    albedos = [wall() * (1 - p) + p * 0.4 for p in (person(120), person(175))]
    size = (4 * WIDTH + 1, 4 * HEIGHT + 3)
    pair = photographs((albedos[0], albedos[1]))
    large = [cv2.resize(i, size).astype(np.float32) for i in pair]

    found = moved_in((large[0], large[1]), np.zeros(size[::-1], bool))

    assert found.shape == size[::-1]
    there = cv2.resize(((person(120) + person(175)) > 0.5).astype(np.uint8), size) > 0
    assert found[there].mean() > 0.8


@pytest.mark.parametrize("size", [(32, 32), (33, 200)])
def test_the_smallest_pictures_are_taken(size: tuple[int, int]) -> None:
    even = np.full((*size, 3), 0.3, np.float32)

    found = moved_in((even, 2 * even), np.zeros(size, bool))

    assert found.shape == size
    assert not found.any()
