from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.pair import refine
from pipeline.pair.refine import (
    HOMOGRAPHY,
    SHIFT,
    TURN,
    agreement,
    better_share,
    finish_motion,
    log_detail,
    products,
    pyramid,
    refine_motion,
)

Image = Floats32
HEIGHT, WIDTH = 160, 200


def patches(seed: int = 0) -> Image:
    """Surfaces with slanted edges, (160, 200, 3), 0.1…0.9."""
    rng = np.random.default_rng(seed)
    canvas = np.full((HEIGHT, WIDTH, 3), 0.4)
    for _ in range(120):
        center = (int(rng.integers(0, WIDTH)), int(rng.integers(0, HEIGHT)))
        box = cv2.boxPoints((center, (int(rng.integers(8, 50)), 15), float(rng.uniform(0, 90))))
        colour = rng.uniform(0.1, 0.9, 3).tolist()
        cv2.fillConvexPoly(canvas, box.astype(np.int32), colour, cv2.LINE_AA)
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.8), np.float32)


def seen(image: Image, matrix: Floats64) -> Image:
    """The picture after a motion: refine_motion is to find the matrix."""
    return np.asarray(
        cv2.warpPerspective(
            image, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float32,
    )


def error(found: Floats64, true: Floats64) -> float:
    """Largest distance in pixels on a grid of points."""
    y, x = np.mgrid[20 : HEIGHT - 20 : 30, 20 : WIDTH - 20 : 30]
    points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    one, other = (matrix @ points for matrix in (found, true))
    return float(np.hypot(*(one[:2] / one[2] - other[:2] / other[2])).max())


MOVED = {
    "shift": (np.array([[1, 0, 1.3], [0, 1, -0.7], [0, 0, 1]]), SHIFT),
    "turn": (np.array([[1, -0.012, 1.5], [0.012, 1, -1.4], [0, 0, 1]]), TURN),
    "tilt": (np.array([[1.01, 0.004, 0.5], [0, 0.99, 1], [5e-5, -4e-5, 1]]), HOMOGRAPHY),
}


@pytest.mark.parametrize("kind", MOVED)
def test_motions_are_found_within_a_twentieth_of_a_pixel(kind: str) -> None:
    """Under light of another colour from another side."""
    matrix, freedoms = MOVED[kind]
    light = np.linspace(0.2, 1.0, WIDTH)[None, :, None] * np.array([1.0, 0.7, 0.4])
    one, other = patches() * light, seen(patches(), matrix) * light[:, ::-1, ::-1]

    steps = [pyramid(log_detail(image.astype(np.float32))) for image in (one, other)]
    near = refine_motion(steps[0], steps[1], np.eye(3), freedoms)
    found = finish_motion(steps[0], steps[1], near, freedoms)

    assert error(np.eye(3), matrix) > 1
    assert error(near, matrix) < 0.15
    assert error(found, matrix) < 0.05


def test_only_what_is_free_changes() -> None:
    matrix, _ = MOVED["turn"]
    steps = [log_detail(image) for image in (patches(), seen(patches(), matrix))]

    found = refine_motion(pyramid(steps[0]), pyramid(steps[1]), np.eye(3), SHIFT)

    np.testing.assert_allclose(found[:2, :2], np.eye(2), atol=1e-9)
    np.testing.assert_allclose(found[2], [0, 0, 1], atol=1e-12)


def test_steps_do_not_depend_on_the_light() -> None:
    """Where it is smooth: 5 % of the steps under four times the light, sloping the other way."""
    light = 4 * np.linspace(0.3, 1.0, WIDTH)[None, :, None] * np.array([0.5, 0.8, 1.0])

    one, other = log_detail(patches()), log_detail((patches() * light).astype(np.float32))

    inner = (slice(8, -8), slice(8, -8))
    assert np.abs(one - other)[inner].mean() < 0.05 * np.abs(one)[inner].mean()


@pytest.mark.parametrize("value", [0.0, 0.5])
def test_an_even_picture_leaves_the_motion_as_it_is(value: float) -> None:
    even = pyramid(log_detail(np.full((60, 60, 3), value, np.float32)))

    found = refine_motion(even, even, np.eye(3), HOMOGRAPHY)

    np.testing.assert_allclose(found, np.eye(3), atol=1e-6)


def test_agreement_is_one_for_the_same_steps_and_falls_with_the_distance() -> None:
    steps = log_detail(patches())
    off = [np.array([[1, 0, pixels], [0, 1, 0], [0, 0, 1.0]]) for pixels in (0.0, 1.0, 3.0)]

    found = [agreement(products(steps, steps, matrix)) for matrix in off]

    assert found[0] == pytest.approx(1)
    assert 0.6 < found[1] < 0.95
    assert found[2] < 0.5


def step_by_numpy(reference: Image, sample: Image, matrix: Floats64) -> Floats64:
    """One round of the refinement, as its source has it: the compiled one is to give the same."""
    size = (WIDTH, HEIGHT)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    warped = cv2.warpPerspective(sample, matrix, size, flags=flags)
    x, y, depth = (
        row[0] * np.arange(WIDTH) + row[1] * np.arange(HEIGHT)[:, None] + row[2] for row in matrix
    )
    u, v = x / depth, y / depth
    used = (u >= 3) & (u <= WIDTH - 4) & (v >= 3) & (v <= HEIGHT - 4)
    used[:6] = used[-6:] = used[:, :6] = used[:, -6:] = False
    normal, right = np.zeros((8, 8)), np.zeros(8)
    unit = TO_UNIT[0, 0]
    for channel in range(3):
        both = 0.5 * (reference[..., channel] + warped[..., channel])
        gx = cv2.Sobel(both, -1, 1, 0, scale=0.125) / unit
        gy = cv2.Sobel(both, -1, 0, 1, scale=0.125) / unit
        strength = np.hypot(gx, gy)
        telling = used & (strength > np.quantile(strength[used], 0.85))
        y, x = np.nonzero(telling)
        gx, gy = gx[telling], gy[telling]
        difference = (reference[..., channel] - warped[..., channel])[telling].astype(np.float64)
        scale = 1.4826 * np.median(np.abs(difference)) + 1e-9
        weight = np.square(np.maximum(1.0 - np.square(difference / (4.685 * scale)), 0.0))
        weight /= scale**2
        x, y = x * unit + TO_UNIT[0, 2], y * unit + TO_UNIT[1, 2]
        along = gx * x + gy * y
        jacobian = np.stack([gx * x, gx * y, gx, gy * x, gy * y, gy, -along * x, -along * y])
        normal += (jacobian * weight) @ jacobian.T
        right += (jacobian * weight) @ difference
    solution = np.linalg.solve(normal, right)
    return np.asarray(np.eye(3) + np.append(solution, 0.0).reshape(3, 3))


TO_UNIT = np.array([[0.01, 0, -1.0], [0, 0.01, -0.8], [0, 0, 1]])


@pytest.mark.parametrize("kind", MOVED)
@pytest.mark.parametrize("start", ["still", "near"])
def test_the_compiled_round_is_the_one_of_the_source(kind: str, start: str) -> None:
    matrix, _ = MOVED[kind]
    rng = np.random.default_rng(4)
    noise = rng.normal(0, 0.01, (2, HEIGHT, WIDTH, 3)).astype(np.float32)
    images = (patches() + noise[0], seen(patches(), matrix) + noise[1])
    reference, sample = (log_detail(image) for image in images)
    before = np.eye(3) if start == "still" else matrix

    step = refine._step(reference, sample, before, TO_UNIT, HOMOGRAPHY, cv2.INTER_CUBIC)

    expected = step_by_numpy(reference, sample, before)
    assert np.abs(expected - np.eye(3)).max() > (1e-3 if start == "still" else 1e-6)
    assert step is not None
    np.testing.assert_allclose(step, expected, atol=1e-5)


def test_a_round_by_some_of_the_rows_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thresholds of a large picture are those of a part of its pixels."""
    matrix, _ = MOVED["shift"]
    steps = [log_detail(image) for image in (patches(), seen(patches(), matrix))]
    full = refine._step(steps[0], steps[1], np.eye(3), TO_UNIT, SHIFT, cv2.INTER_CUBIC)
    monkeypatch.setattr(refine, "ENOUGH", WIDTH * HEIGHT // 4)

    step = refine._step(steps[0], steps[1], np.eye(3), TO_UNIT, SHIFT, cv2.INTER_CUBIC)

    assert full is not None
    assert step is not None
    np.testing.assert_allclose(step, full, atol=0.05 * np.abs(full - np.eye(3)).max())


@pytest.mark.parametrize(("covered", "farthest"), [(0.5, 2.0), (1.0, 1.0), (0.2, 3.0), (-0.1, 3.0)])
def test_a_step_is_as_long_as_the_one_before_fell_short(covered: float, farthest: float) -> None:
    """Rounds that cover half of the way each: the second is doubled, and arrives."""
    way, gone = np.diag([4.0, 2.0, 0.0]), np.diag([0.6, 0.3, 0.0])

    first = refine._lengthened(covered * way, np.zeros((3, 3)), np.zeros((3, 3)))
    second = refine._lengthened(covered * (way - gone), covered * way, gone)

    np.testing.assert_allclose(first, covered * way)
    np.testing.assert_allclose(second, farthest * covered * (way - gone))


def test_two_rounds_that_go_short_make_a_motion_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix, freedoms = MOVED["tilt"]
    steps = [pyramid(log_detail(image)) for image in (patches(), seen(patches(), matrix))]
    near = refine_motion(steps[0], steps[1], np.eye(3), freedoms)
    step_of = refine._step

    def short(*given: Any) -> Floats64:
        step = step_of(*given)
        assert step is not None
        return np.asarray(0.5 * (np.eye(3) + step))

    monkeypatch.setattr(refine, "_step", short)

    found = finish_motion(steps[0], steps[1], near, freedoms)

    assert error(found, matrix) < 0.02


@pytest.mark.parametrize("pixels", [WIDTH, WIDTH - 11])
def test_a_round_with_too_few_pixels_finds_nothing(pixels: int) -> None:
    """A motion that leaves no pixel in both photographs, and one that leaves two columns."""
    steps = log_detail(patches())
    away = np.array([[1, 0, pixels], [0, 1, 0], [0, 0, 1.0]])

    assert refine._step(steps, steps, away, TO_UNIT, HOMOGRAPHY, cv2.INTER_CUBIC) is None


def test_agreement_is_the_correlation_where_both_are_seen() -> None:
    steps = [log_detail(image) for image in (patches(), patches(1) + patches())]
    matrix = np.array([[1, 0, 3.0], [0, 1, 2.0], [0, 0, 1]])

    found = agreement(products(steps[0], steps[1], matrix))

    one, other = steps[0][:-3, :-4].astype(float), steps[1][2:-1, 3:-1].astype(float)
    expected = (one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum())
    assert found == pytest.approx(expected, abs=1e-5)


def test_a_motion_is_better_in_the_blocks_that_it_lays_right() -> None:
    steps = log_detail(patches())
    moved = steps.copy()
    moved[:, WIDTH // 2 :] = np.roll(steps, 3, axis=1)[:, WIDTH // 2 :]
    three = np.array([[1, 0, 3.0], [0, 1, 0], [0, 0, 1]])

    still, shifted = products(steps, moved, np.eye(3)), products(steps, moved, three)

    assert better_share(shifted, still) == pytest.approx(0.5, abs=0.13)
    assert better_share(shifted, still) + better_share(still, shifted) == pytest.approx(1)
    assert better_share(still, still) == 0


def test_blocks_without_steps_tell_nothing() -> None:
    found, other = np.ones((2, 6, 8, 3))
    other[..., 2] = 0.5
    other[:, 2:, :] *= 1e-3
    found[:, 2:, 2] = -1.0

    assert better_share(found, other) == 1
    assert better_share(found, np.zeros_like(other)) == 0


def test_large_photographs_agree_as_their_bands_do(monkeypatch: pytest.MonkeyPatch) -> None:
    steps = [log_detail(image) for image in (patches(), patches(1) + patches())]
    matrix = np.array([[1, 0, 3.0], [0, 1, 2.0], [0, 0, 1]])
    monkeypatch.setattr(refine, "_LARGE", 1)
    monkeypatch.setattr(refine, "_BAND", 10)

    found = agreement(products(steps[0], steps[1], matrix))

    bands = [row for row in range(HEIGHT - 3) if row % 30 < 10]
    one, other = steps[0][:, :-4].astype(float), steps[1][:, 3:-1].astype(float)
    one, other = one[bands], other[np.array(bands) + 2]
    expected = (one * other).sum() / np.sqrt((one**2).sum() * (other**2).sum())
    assert found == pytest.approx(expected, abs=1e-5)


def test_steps_are_logarithms_less_their_local_mean() -> None:
    image = patches() - np.float32(0.15)
    smooth = cv2.GaussianBlur(np.maximum(image, 0.0), (0, 0), 0.5)
    dark = 0.01 * np.percentile(smooth.reshape(-1, 3), 95, axis=0) + 1e-9
    logarithm = np.log(smooth + dark.astype(np.float32))

    expected = logarithm - cv2.GaussianBlur(logarithm, (0, 0), 2.0)

    np.testing.assert_allclose(log_detail(image), expected, atol=1e-5)
