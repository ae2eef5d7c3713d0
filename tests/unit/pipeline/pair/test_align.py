from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.pair import align
from pipeline.pair.align import NOT_ATTEMPTED, Alignment, _to_size, estimate_alignment, warp

Image = Floats32

HEIGHT, WIDTH, MARGIN = 240, 320, 60


def surfaces(seed: int = 0) -> Image:
    """Discs and bars of many sizes and colours, with a margin for the camera to move in."""
    rng = np.random.default_rng(seed)
    canvas = np.full((HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, 3), 0.3)
    for _ in range(260):
        center = (
            int(rng.integers(0, WIDTH + 2 * MARGIN)),
            int(rng.integers(0, HEIGHT + 2 * MARGIN)),
        )
        colour = rng.uniform(0.05, 0.9, 3).tolist()
        if rng.uniform() < 0.5:
            cv2.circle(canvas, center, int(rng.integers(3, 30)), colour, -1, cv2.LINE_AA)
        else:
            size = (int(rng.integers(4, 70)), int(rng.integers(4, 40)))
            box = cv2.boxPoints((center, size, float(rng.uniform(0, 90))))
            cv2.fillConvexPoly(canvas, box.astype(np.int32), colour, cv2.LINE_AA)
    return np.asarray(cv2.GaussianBlur(canvas, (0, 0), 0.7), dtype=np.float32)


def moved(canvas: Image, matrix: Floats) -> Image:
    """What the camera sees of the canvas: pixel x shows the canvas where matrix @ x lies."""
    into = np.array([[1, 0, MARGIN], [0, 1, MARGIN], [0, 0, 1.0]]) @ matrix
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(canvas, into, (WIDTH, HEIGHT), flags=flags), np.float32)


def by_lamps(picture: Image, seed: int = 1) -> Image:
    """Warm light from the left, with noise."""
    light = np.linspace(0.9, 0.15, WIDTH)[None, :, None] * np.array([1.0, 0.7, 0.4])
    drawn = np.random.default_rng(seed).normal(0, 0.004, picture.shape)
    return np.asarray(0.6 * picture * light + drawn, dtype=np.float32)


def by_flash(picture: Image) -> Image:
    """Cold light from the middle, on top of what the lamps give."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    falloff = 1.0 / (1.0 + ((x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2) / WIDTH**2)
    return by_lamps(picture, 2) + np.asarray(
        0.7 * picture * falloff[..., None] * np.array([0.7, 0.9, 1.0]), dtype=np.float32
    )


def about_the_middle(matrix: Floats64) -> Floats64:
    """The motion around the middle of the picture."""
    there = np.array([[1, 0, WIDTH / 2], [0, 1, HEIGHT / 2], [0, 0, 1.0]])
    return np.asarray(there @ matrix @ np.linalg.inv(there))


def turn(degrees: float, x: float = 0.0, y: float = 0.0) -> Floats64:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return about_the_middle(np.array([[c, -s, x], [s, c, y], [0, 0, 1]]))


SHIFT = turn(0, 7.4, -4.2)
TURN = turn(1.5, 3.0, 2.0)
TILT = about_the_middle(np.array([[1.01, 0.012, 4], [-0.008, 0.99, -3], [1.2e-4, -9e-5, 1]]))


def where(matrix: Floats64) -> Floats64:
    """Where the matrix takes a grid of points, (n, 2)."""
    y, x = np.mgrid[20 : HEIGHT - 20 : 40, 20 : WIDTH - 20 : 40]
    points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1) @ matrix.T
    return np.asarray(points[:, :2] / points[:, 2:])


@pytest.mark.parametrize(
    "motion",
    [SHIFT, TURN, TILT, turn(0, 40, -30), turn(2.6, 5, -8), turn(-3.3, -20, 10)],
    ids=["shift", "turn", "tilt", "far shift", "wide turn", "far and wide"],
)
def test_known_motions_are_found_within_a_pixel(motion: Floats64) -> None:
    canvas = surfaces()
    no_flash = by_lamps(moved(canvas, np.eye(3)))
    flash = by_flash(moved(canvas, np.linalg.inv(motion)))

    found = estimate_alignment(no_flash, flash)

    assert found.applied
    assert found.problem is None
    assert found.correlation is not None
    assert 0.4 < found.correlation <= 1
    assert np.linalg.norm(where(found.matrix) - where(motion), axis=1).max() < 1.0


@pytest.mark.parametrize("motion", [np.eye(3), turn(0, 2, 1), turn(-1.2, 15, 6)])
def test_a_motion_is_found_by_a_few_things_before_a_plain_wall(motion: Floats64) -> None:
    canvas = np.full((HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN, 3), 0.6, np.float32)
    for x, y, radius in ((140, 240, 30), (250, 230, 40), (330, 260, 22)):
        cv2.circle(canvas, (x, y), radius, (0.1, 0.3, 0.5), -1, cv2.LINE_AA)
    cv2.line(canvas, (0, 290), (WIDTH + 2 * MARGIN, 290), (0.2, 0.2, 0.2), 2, cv2.LINE_AA)
    no_flash = by_lamps(moved(canvas, np.eye(3)))
    flash = by_flash(moved(canvas, np.linalg.inv(motion)))

    found = estimate_alignment(no_flash, flash)

    assert found.problem is None
    assert np.linalg.norm(where(found.matrix) - where(motion), axis=1).max() < 1.0


def test_the_warped_frame_lies_on_the_other() -> None:
    canvas = surfaces()
    no_flash, flash = by_lamps(moved(canvas, np.eye(3))), moved(canvas, np.linalg.inv(TURN))
    nothing = np.zeros((HEIGHT, WIDTH), bool)

    found, uncovered = warp(flash, nothing, estimate_alignment(no_flash, by_flash(flash)))

    inner = slice(20, -20)
    true = moved(canvas, np.eye(3))
    before = np.abs(flash - true)[inner, inner].mean()
    assert np.abs(found - true)[inner, inner].mean() < 0.3 * before
    assert not uncovered[inner, inner].any()


def test_pictures_larger_than_the_working_size_are_aligned_in_full_size() -> None:
    """6.4 times as large: the motion found on the small picture holds for the large one."""
    canvas = surfaces()
    small = by_lamps(moved(canvas, np.eye(3))), by_flash(moved(canvas, np.linalg.inv(SHIFT)))
    large = [
        np.asarray(cv2.resize(picture, (2048, 1536), interpolation=cv2.INTER_CUBIC), np.float32)
        for picture in small
    ]

    found = estimate_alignment(large[0], large[1])

    assert found.applied
    np.testing.assert_allclose(found.matrix[:2, 2], 6.4 * SHIFT[:2, 2], atol=1.5)
    np.testing.assert_allclose(found.matrix[:2, :2], np.eye(2), atol=5e-3)


def test_pairs_from_a_tripod_are_not_warped() -> None:
    picture = moved(surfaces(), np.eye(3))

    found = estimate_alignment(by_lamps(picture), by_flash(picture))

    assert not found.applied
    assert found.problem is None
    assert found.correlation is not None
    assert found.correlation > 0.4
    assert np.linalg.norm(where(found.matrix) - where(np.eye(3)), axis=1).max() < 0.3


def refusal(found: Alignment) -> str:
    """The sentence of an alignment that was refused, which leaves the frame as it is."""
    assert not found.applied
    np.testing.assert_array_equal(found.matrix, np.eye(3))
    assert found.problem is not None
    return found.problem


def test_unrelated_photographs_are_refused_with_a_sentence() -> None:
    no_flash, flash = (moved(surfaces(seed), np.eye(3)) for seed in (0, 5))

    problem = refusal(estimate_alignment(by_lamps(no_flash), by_flash(flash)))

    assert problem.startswith("The two photographs could not be aligned (")
    assert "--no-align" in problem and "align: false" in problem
    assert problem.endswith(".")


@pytest.mark.parametrize("value", [0.0, 0.4])
def test_photographs_without_any_edge_are_refused(value: float) -> None:
    even = np.full((HEIGHT, WIDTH, 3), value, np.float32)

    refusal(estimate_alignment(even, even + np.float32(0.1)))


@pytest.mark.parametrize("size", [(32, 32), (32, 600), (33, 47)])
def test_noise_alone_is_refused(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    no_flash, flash = rng.uniform(0, 0.1, (2, *size, 3)).astype(np.float32)

    assert "could not be aligned" in refusal(estimate_alignment(no_flash, flash))


def test_a_motion_no_hand_makes_is_refused() -> None:
    """A quarter of the picture."""
    rng = np.random.default_rng(8)
    wide = cv2.GaussianBlur(rng.uniform(0, 1, (HEIGHT, 2 * WIDTH, 3)), (0, 0), 3).astype(np.float32)
    wide = (wide - wide.min()) / (wide.max() - wide.min())

    refusal(estimate_alignment(wide[:, :WIDTH], wide[:, WIDTH // 4 * 3 : WIDTH // 4 * 3 + WIDTH]))


def test_dark_noise_below_black_does_no_harm() -> None:
    dark = np.random.default_rng(4).normal(0, 0.001, (HEIGHT, WIDTH, 3)).astype(np.float32)

    refusal(estimate_alignment(dark, by_flash(moved(surfaces(), np.eye(3)))))


def test_a_frame_that_was_not_moved_is_not_resampled() -> None:
    picture = moved(surfaces(), np.eye(3))
    clipped = picture[..., 0] > 0.8

    found, bad = warp(picture, clipped, NOT_ATTEMPTED)

    np.testing.assert_allclose(found, picture, atol=1e-6)
    np.testing.assert_array_equal(bad, clipped)


def test_whole_pixels_are_moved_as_they_are_and_uncovered_ones_marked() -> None:
    picture = moved(surfaces(), np.eye(3))
    matrix = np.array([[1, 0, 5.0], [0, 1, -3.0], [0, 0, 1]])

    found, bad = warp(picture, np.zeros((HEIGHT, WIDTH), bool), Alignment(True, matrix, 0.9))

    np.testing.assert_allclose(found[4:, :-6], picture[1:-3, 5:-1], atol=1e-5)
    assert bad[:3].all()
    assert bad[:, -5:].all()
    assert not bad[3:, :-5].any()


@pytest.mark.parametrize("x", [-2.5, 0.5, 1.25])
def test_nothing_from_beyond_the_border_reaches_usable_pixels(x: float) -> None:
    even = np.full((HEIGHT, WIDTH, 3), 0.4, np.float32)

    found, bad = warp(even, np.zeros((HEIGHT, WIDTH), bool), Alignment(True, turn(0, x), 0.9))

    assert bad.mean() < 0.02
    np.testing.assert_allclose(found[~bad], 0.4, atol=1e-5)


def test_saturated_pixels_move_along_and_spread_over_every_pixel_they_touch() -> None:
    clipped = np.zeros((20, 30), bool)
    clipped[10, 15] = True
    matrix = np.array([[1, 0, 2.5], [0, 1, 0.0], [0, 0, 1]])

    _, bad = warp(np.ones((20, 30, 3), np.float32), clipped, Alignment(True, matrix, 0.9))

    np.testing.assert_array_equal(np.argwhere(bad[:, :25]), [[10, 12], [10, 13]])


def test_pixel_centers_are_kept_when_a_motion_is_enlarged() -> None:
    """Four full pixels to a small one: x = 4u + 1.5, so u → 2u is x → 2x − 1.5."""
    found = _to_size(np.diag([2.0, 2.0, 1.0]), (80, 60), (320, 240))

    expected = np.array([[2, 0, -1.5], [0, 2, -1.5], [0, 0, 1]])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_edges_are_searched_in_a_smaller_size_and_correlated_in_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sizes: dict[str, list[tuple[int, ...]]] = {"searched": [], "correlated": []}
    search, correlate = cv2.phaseCorrelate, cv2.computeECC

    def searched(*given: Any) -> Any:
        sizes["searched"].append(given[0].shape)
        return search(*given)

    def correlated(*given: Any) -> Any:
        sizes["correlated"].append(given[0].shape)
        return correlate(*given)

    monkeypatch.setattr(cv2, "phaseCorrelate", searched)
    monkeypatch.setattr(cv2, "computeECC", correlated)
    picture = np.asarray(cv2.resize(moved(surfaces(), np.eye(3)), (1000, 750)), np.float32)

    estimate_alignment(picture, picture)

    assert set(sizes["searched"]) == {(300, 400)}
    assert sizes["correlated"][-1] == (600, 800)


def shift_found(pixels: float) -> Alignment:
    canvas = surfaces()
    no_flash = by_lamps(moved(canvas, np.eye(3)))
    return estimate_alignment(no_flash, by_flash(moved(canvas, turn(0, pixels))))


def test_motions_within_the_error_are_no_reason_to_resample() -> None:
    found = shift_found(0.15)

    assert not found.applied
    np.testing.assert_array_equal(found.matrix, np.eye(3))


@pytest.mark.parametrize("pixels", [0.6, 1.0, 2.0])
def test_small_motions_are_found(pixels: float) -> None:
    found = shift_found(pixels)

    assert found.applied
    assert -found.matrix[0, 2] == pytest.approx(pixels, abs=0.1)


@pytest.mark.parametrize("motion", [SHIFT, TURN], ids=["shift", "turn"])
def test_known_motions_are_found_within_an_eighth_of_a_pixel(motion: Floats64) -> None:
    canvas = surfaces()
    no_flash = by_lamps(moved(canvas, np.eye(3)))
    flash = by_flash(moved(canvas, np.linalg.inv(motion)))

    found = estimate_alignment(no_flash, flash)

    assert np.linalg.norm(where(found.matrix) - where(motion), axis=1).max() < 0.125


def test_a_motion_that_no_hand_makes_is_not_taken_for_the_turn_of_round_things() -> None:
    """Balls without texture look alike however the camera is turned about them."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    ball = np.clip(1 - np.hypot(x - 160, y - 120) / 90, 0, 1)[..., None] * np.ones(3)

    found = estimate_alignment(by_lamps(ball + 0.02), by_flash(ball + 0.02))

    assert np.linalg.norm(where(found.matrix) - where(np.eye(3)), axis=1).max() < 0.5


@pytest.mark.parametrize(("mostly", "applied"), [(align._MOSTLY, False), (0.0, True)])
def test_strong_edges_that_move_in_a_part_of_the_picture_move_no_picture(
    monkeypatch: pytest.MonkeyPatch, mostly: float, applied: bool
) -> None:
    """As shadows do, which flash and lamps throw to different places."""
    monkeypatch.setattr(align, "_MOSTLY", mostly)
    paint = moved(surfaces(), np.eye(3))
    faint = 0.4 + 0.15 * (paint - 0.4)
    shadows, others = faint.copy(), faint.copy()
    part = slice(HEIGHT // 4, 3 * HEIGHT // 4), slice(WIDTH // 4, WIDTH // 2)
    shadows[part] = paint[part]
    others[part] = np.roll(paint, 2, axis=1)[part]

    assert estimate_alignment(by_lamps(shadows), by_flash(others)).applied is applied


@pytest.mark.parametrize(("pixels", "applied"), [(3.0, True), (0.5, False)])
def test_a_plain_shift_needs_to_mend_less_than_a_short_one(
    monkeypatch: pytest.MonkeyPatch, pixels: float, applied: bool
) -> None:
    """Shadows that differ let even the right motion raise the agreement by 0.015 alone."""
    agreements = iter([0.1, *[0.115] * 9])
    monkeypatch.setattr(align, "agreement", lambda *_: next(agreements))
    canvas = surfaces()

    found = estimate_alignment(
        by_lamps(moved(canvas, np.eye(3))), by_flash(moved(canvas, turn(0, pixels)))
    )

    assert found.applied is applied
    assert found.problem is None


@pytest.mark.parametrize(
    ("agreements", "degrees"),
    [
        ((0.8, 0.8, 0.815), 0.0),
        ((0.8, 0.8, 0.825), 1.5),
        ((0.8, 0.825, 0.835), 1.5),
        ((0.1, 0.1, 0.115), 1.5),
    ],
    ids=["as little as shading", "enough", "beside a shift", "as much as noise leaves"],
)
def test_a_turn_alone_needs_to_mend_more_than_one_beside_a_shift(
    monkeypatch: pytest.MonkeyPatch, agreements: tuple[float, ...], degrees: float
) -> None:
    """Lamps at its sides leave the lower edge of a ball dark, as if it had shrunk: 0.01."""
    given = iter([*agreements, *[agreements[-1]] * 9])
    monkeypatch.setattr(align, "agreement", lambda *_: next(given))
    canvas = surfaces()

    found = estimate_alignment(
        by_lamps(moved(canvas, np.eye(3))), by_flash(moved(canvas, np.linalg.inv(TURN)))
    )

    turned = np.degrees(np.arctan2(found.matrix[1, 0], found.matrix[0, 0]))
    assert turned == pytest.approx(degrees, abs=0.05)


@pytest.mark.parametrize("seed", [1, 3])
def test_noise_beside_a_plain_sphere_moves_no_pair_that_lies_still(seed: int) -> None:
    """Lit from one side without the flash: only its outline is alike, and noise is by chance."""
    rng = np.random.default_rng(seed)
    y, x = (np.mgrid[:960, :1440] + 0.5) / 3
    u, v = (x - 240) / 100, (160 - y) / 100
    hit = np.hypot(u, v) < 1
    normals = np.stack([u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0))], axis=-1)
    photographs = []
    for towards in (rng.normal(size=3) * [1, 0.8, 0.3] + [0, 0.2, 0.4], np.array([0.05, 0.12, 1])):
        shade = np.maximum(normals @ (towards / np.linalg.norm(towards)), 0) * 0.5
        lit = cv2.resize(np.where(hit, shade, 0.03), (480, 320), interpolation=cv2.INTER_AREA)
        photographs.append(lit[..., None] * np.array([0.8, 1.0, 0.6]))
    lamps, flash = photographs
    noisy = (
        np.asarray(light + 0.014 * np.sqrt(light) * rng.normal(size=light.shape), np.float32)
        for light in (lamps, lamps + flash)
    )

    assert not estimate_alignment(*noisy).applied


def ball_before_black(flash: float) -> tuple[Image, Image]:
    """A matt ball under a lamp at either side, without a flash at the camera and with it."""
    y, x = (np.mgrid[:720, :720] + 0.5) / 3
    u, v = (x - 120) / 80, (120 - y) / 80
    hit = np.hypot(u, v) < 1
    normals = np.stack([u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0))], axis=-1)

    def lit(towards: tuple[float, float, float], colour: list[float]) -> Floats64:
        shade = np.maximum(normals @ (np.array(towards) / np.linalg.norm(towards)), 0) * hit
        small = cv2.resize(shade, (240, 240), interpolation=cv2.INTER_AREA)
        return np.asarray(small[..., None] * colour)

    lamps = lit((-0.9, 0.3, 0.4), [0.4, 0.3, 0.15]) + lit((0.9, 0.3, 0.4), [0.15, 0.3, 0.4])
    both = lamps + lit((0, 0, 1), [flash] * 3)
    return np.asarray(lamps, np.float32), np.asarray(both, np.float32)


@pytest.mark.parametrize(("zoom", "applied"), [(0.0, True), (align._FIRST_ZOOM, False)])
@pytest.mark.parametrize("flash", [2.0, 4.0])
def test_a_ball_before_black_that_seems_to_shrink_under_the_flash_lies_still(
    monkeypatch: pytest.MonkeyPatch, flash: float, zoom: float, applied: bool
) -> None:
    """Its outline is dark by a flash at the camera, and bright by lamps at its sides."""
    monkeypatch.setattr(align, "_FIRST_ZOOM", zoom)

    assert estimate_alignment(*ball_before_black(flash)).applied is applied


def test_a_lens_that_focuses_anew_on_a_tripod_is_noticed() -> None:
    """Its picture grows about the middle, without shift or turn."""
    larger = about_the_middle(np.diag([1.01, 1.01, 1.0]))
    canvas = surfaces()

    found = estimate_alignment(
        by_lamps(moved(canvas, np.eye(3))), by_flash(moved(canvas, np.linalg.inv(larger)))
    )

    assert np.linalg.norm(where(found.matrix) - where(larger), axis=1).max() < 0.2
