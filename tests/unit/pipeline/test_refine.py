from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.refine import HOMOGRAPHY, SHIFT, TURN, agreement, log_detail, refine_motion

Image = NDArray[np.float32]
Array = NDArray[np.float64]
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


def seen(image: Image, matrix: Array) -> Image:
    """The picture after a motion: refine_motion is to find the matrix."""
    return np.asarray(
        cv2.warpPerspective(
            image, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        ),
        np.float32,
    )


def error(found: Array, true: Array) -> float:
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

    steps = [log_detail(image.astype(np.float32)) for image in (one, other)]
    found = refine_motion(steps[0], steps[1], np.eye(3), freedoms)

    assert error(np.eye(3), matrix) > 1
    assert error(found, matrix) < 0.05


def test_only_what_is_free_changes() -> None:
    matrix, _ = MOVED["turn"]
    steps = [log_detail(image) for image in (patches(), seen(patches(), matrix))]

    found = refine_motion(steps[0], steps[1], np.eye(3), SHIFT)

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
    even = log_detail(np.full((60, 60, 3), value, np.float32))

    found = refine_motion(even, even, np.eye(3), HOMOGRAPHY)

    np.testing.assert_allclose(found, np.eye(3), atol=1e-6)


def test_agreement_is_one_for_the_same_steps_and_falls_with_the_distance() -> None:
    steps = log_detail(patches())
    off = [np.array([[1, 0, pixels], [0, 1, 0], [0, 0, 1.0]]) for pixels in (0.0, 1.0, 3.0)]

    found = [agreement(steps, steps, matrix) for matrix in off]

    assert found[0] == pytest.approx(1)
    assert 0.6 < found[1] < 0.95
    assert found[2] < 0.5
