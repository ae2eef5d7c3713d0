from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.pair.align import NOT_ATTEMPTED, Alignment
from pipeline.pair.flow import _MOST_SIDE, residual_flow, warp_along

Image = Floats32
HEIGHT, WIDTH = 240, 320


def patches(seed: int) -> Floats64:
    """Surfaces of many colours, (240, 320, 3)."""
    rng = np.random.default_rng(seed)
    canvas = np.full((HEIGHT, WIDTH, 3), 0.4)
    for _ in range(300):
        center = (int(rng.integers(0, WIDTH)), int(rng.integers(0, HEIGHT)))
        box = cv2.boxPoints((center, (int(rng.integers(6, 30)), 12), float(rng.uniform(0, 90))))
        colour = rng.uniform(0.1, 0.9, 3).tolist()
        cv2.fillConvexPoly(canvas, box.astype(np.int32), colour, cv2.LINE_AA)
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.8))


NEAR = np.zeros((HEIGHT, WIDTH), bool)
NEAR[60:180, 100:220] = True


def two_depths(x: float, y: float) -> tuple[Image, Image, Image]:
    """Photographs without and with the flash of a near thing that moves before a wall.

    Third is the flash photograph as it is when nothing moves.
    """
    wall, thing = patches(1), patches(2)
    move = np.array([[1, 0, x], [0, 1, y]], dtype=float)
    size = (WIDTH, HEIGHT)
    thing_moved = cv2.warpAffine(thing, move, size, flags=cv2.INTER_CUBIC)
    where = cv2.warpAffine(NEAR.astype(np.float64), move, size)[..., None]
    light = np.linspace(0.9, 0.2, WIDTH)[None, :, None] * np.array([1.0, 0.7, 0.4])
    both = 0.6 * light + 0.5 * np.array([0.7, 0.9, 1.0])
    still = np.where(NEAR[..., None], thing, wall)
    rng = np.random.default_rng(3)
    grain = rng.normal(0, 0.002, (2, HEIGHT, WIDTH, 3))
    no_flash = 0.6 * light * still + grain[0]
    flash = both * (wall * (1 - where) + thing_moved * where) + grain[1]
    one, other, true = (np.asarray(i, np.float32) for i in (no_flash, flash, both * still))
    return one, other, true


def test_what_lies_still_has_no_flow() -> None:
    no_flash, flash, _ = two_depths(0, 0)

    assert residual_flow(no_flash, flash) is None


@pytest.mark.parametrize(("x", "y"), [(1.5, -0.5), (3.0, 1.0), (8.0, -3.0)])
def test_parallax_is_found_within_half_a_pixel(x: float, y: float) -> None:
    no_flash, flash, _ = two_depths(x, y)

    found = residual_flow(no_flash, flash)

    assert found is not None
    inside = cv2.erode(NEAR.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    outside = cv2.dilate(NEAR.astype(np.uint8), np.ones((41, 41), np.uint8)) == 0
    assert np.linalg.norm(found[inside] - [x, y], axis=1).mean() < 0.5
    assert np.linalg.norm(found[outside], axis=1).mean() < 0.1


def test_parallax_is_taken_away_from_the_flash_photograph() -> None:
    no_flash, flash, still = two_depths(3.0, 1.0)
    flow = residual_flow(no_flash, flash)
    assert flow is not None

    found, bad = warp_along(flash, np.zeros((HEIGHT, WIDTH), bool), NOT_ATTEMPTED, flow)

    inside = cv2.erode(NEAR.astype(np.uint8), np.ones((25, 25), np.uint8)) > 0
    assert np.abs(found - still)[inside].mean() < 0.2 * np.abs(flash - still)[inside].mean()
    assert bad.mean() < 0.01


@pytest.mark.parametrize("turn_deg", [30.0, 40.0, 50.0])
def test_where_light_ends_on_balls_is_not_taken_for_motion(turn_deg: float) -> None:
    """Balls in the dark, lit from the side and then from the front."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    lit = np.zeros((2, HEIGHT, WIDTH, 3))
    aside = np.array([np.sin(np.radians(turn_deg)), -0.4, np.cos(np.radians(turn_deg))])
    for center_x, center_y in ((80, 120), (230, 110)):
        across, down = (x - center_x) / 70, (y - center_y) / 70
        toward = np.sqrt(np.clip(1 - across**2 - down**2, 0, None))
        ball = toward > 0
        normal = np.stack([across, down, toward], axis=-1)
        for i, direction in enumerate((aside, np.array([0.05, 0.0, 1.0]))):
            shading = np.clip(normal @ direction, 0, None) * ball
            lit[i] += shading[..., None] * np.array([0.6, 0.5, 0.3])
    no_flash, flash_part = (
        cv2.GaussianBlur(lit[0], (0, 0), 0.6),
        cv2.GaussianBlur(lit[1], (0, 0), 0.6),
    )

    found = residual_flow(no_flash.astype(np.float32), (no_flash + flash_part).astype(np.float32))

    assert found is None


@pytest.mark.parametrize("value", [0.0, 0.4])
def test_pictures_without_edges_have_no_flow(value: float) -> None:
    even = np.full((64, 64, 3), value, np.float32)

    assert residual_flow(even, even + np.float32(0.1)) is None


@pytest.mark.parametrize("shape", [(32, 2120), (2120, 32)])
def test_the_narrowest_pictures_have_no_flow(shape: tuple[int, int]) -> None:
    """Of 15 pixels at the working size, which the search cannot be asked for."""
    long = np.resize(patches(1), (*shape, 3)).astype(np.float32)

    assert residual_flow(long, long + np.float32(0.1)) is None


@pytest.mark.parametrize("turned", [False, True])
def test_the_largest_pictures_have_no_flow(turned: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    pair = [photograph.swapaxes(0, 1) if turned else photograph for photograph in two_depths(3, 1)]
    monkeypatch.setattr("pipeline.pair.flow._MOST_SIDE", WIDTH)
    assert residual_flow(pair[0], pair[1]) is not None

    monkeypatch.setattr("pipeline.pair.flow._MOST_SIDE", WIDTH - 1)
    assert residual_flow(pair[0], pair[1]) is None


@pytest.mark.parametrize("turned", [False, True])
def test_the_largest_pictures_that_have_a_flow_can_be_resampled(turned: bool) -> None:
    shape = (_MOST_SIDE, 8) if turned else (8, _MOST_SIDE)
    picture = np.random.default_rng(3).random((*shape, 3)).astype(np.float32)
    by_one = np.zeros((2, 2, 2), np.float32)
    by_one[..., int(turned)] = 1

    found, _ = warp_along(picture, np.zeros(shape, bool), NOT_ATTEMPTED, by_one)

    expected = np.roll(picture, -1, axis=1 - turned)
    np.testing.assert_allclose(found[2:-2, 2:-2], expected[2:-2, 2:-2], atol=1e-3)


@pytest.mark.parametrize("grid", [(120, 160), (60, 80)])
def test_homography_and_flow_are_applied_in_one(grid: tuple[int, int]) -> None:
    """Two pixels by the matrix and three by a flow on a coarser grid are five."""
    picture = patches(4).astype(np.float32)
    clipped = np.zeros((HEIGHT, WIDTH), bool)
    clipped[100, 200] = True
    matrix = np.array([[1, 0, 2.0], [0, 1, 0], [0, 0, 1]])
    flow = np.zeros((*grid, 2), np.float32)
    flow[..., 0] = 3.0

    found, bad = warp_along(picture, clipped, Alignment(True, matrix, 0.9), flow)

    np.testing.assert_allclose(found[:, :-6], picture[:, 5:-1], atol=1e-4)
    np.testing.assert_array_equal(np.argwhere(bad[:, :-5]), [[100, 195]])
    assert bad[:, -5:].all()


def test_pictures_larger_than_a_strip_have_no_seams() -> None:
    tall = np.ascontiguousarray(np.tile(patches(5).astype(np.float32), (3, 1, 1)))
    flow = np.full((90, 40, 2), 1.25, np.float32)

    found, _ = warp_along(tall, np.zeros(tall.shape[:2], bool), NOT_ATTEMPTED, flow)

    y, x = np.mgrid[: tall.shape[0], :WIDTH].astype(np.float32) + np.float32(1.25)
    expected = cv2.remap(tall, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_nothing_from_beyond_the_border_reaches_usable_pixels() -> None:
    even = np.full((HEIGHT, WIDTH, 3), 0.4, np.float32)
    flow = np.full((30, 40, 2), 1.5, np.float32)

    found, bad = warp_along(even, np.zeros((HEIGHT, WIDTH), bool), NOT_ATTEMPTED, flow)

    assert not bad[:-2, :-2].any()
    np.testing.assert_allclose(found[~bad], 0.4, atol=1e-5)
