from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.photometric_stereo.detail import spread, surface_depth, surface_normals
from pipeline.photometric_stereo.solve import Surface
from pipeline.separation.separation import Strip

SIZE, BLOCK = 64, 4
DIRECTIONS = np.array([[-0.6, 0.35, 0.7], [0.65, 0.3, 0.7], [0.05, -0.55, 0.8]])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
MATRICES = np.array([np.diag(d) for d in ((1.2, 0.8, 0.3), (0.5, 1.1, 0.6), (0.3, 0.5, 1.2))])


def flat(block: int, w: Any = (0.0, 0.0, 1.0), **more: Any) -> Surface:
    """A surface known everywhere, the same in every pixel."""
    side = SIZE // block
    given: dict[str, Any] = {
        "block": block,
        "mask": np.ones((side, side), bool),
        "cut": np.zeros((side, side), bool),
        "w": np.broadcast_to(np.array(w), (side, side, 3)),
        "z": np.ones((side, side)),
        "lit": np.ones((side, side, 3)),
        "deviations": np.zeros((side, side, 3, 3)),
        "correction": np.ones((side, side, 3)),
        "directions": DIRECTIONS,
        "matrices": MATRICES,
        "misfit": 0.0,
        "unexplained": 0.0,
        "strengths": np.ones(3),
        "turned_deg": 0.0,
        "focal_px": 100.0,
    }
    return Surface(**{**given, **more})


def strip_of(normals: Floats64, rows: slice = slice(0, SIZE), confidence: float = 1.0) -> Strip:
    """Light of a surface of these normals (h, W, 3) and |w| = 1, and its flash part."""
    flash = np.full(normals.shape, 0.4)
    lit = np.einsum("hwj,jkl,hwl->hwk", np.maximum(normals @ DIRECTIONS.T, 0), MATRICES, flash)
    light, part = lit.astype(np.float32)[rows], flash.astype(np.float32)[rows]
    return Strip(rows, light[None], light, part, np.full(light.shape[:2], confidence, np.float32))


@pytest.fixture
def ripples() -> Floats64:
    """Unit normals (64, 64, 3) that sway by 10° every 6 pixels."""
    y, x = np.mgrid[:SIZE, :SIZE]
    tilt = np.tan(np.radians(10))
    slope = [tilt * np.sin(x * 2 * np.pi / 6), tilt * np.cos(y * 2 * np.pi / 6)]
    normals = np.stack([*slope, np.ones(x.shape)], axis=-1)
    return np.asarray(normals / np.linalg.norm(normals, axis=2, keepdims=True))


def angle(found: Floats32, true: Floats64) -> float:
    return float(np.degrees(np.arccos(np.clip((found * true).sum(axis=2), -1, 1))).mean())


def test_details_come_back_that_the_reduced_surface_lacks(ripples: Floats64) -> None:
    smooth = np.broadcast_to([0.0, 0.0, 1.0], ripples.shape).astype(np.float32)

    found = surface_normals(strip_of(ripples), flat(BLOCK))

    assert angle(smooth, ripples) > 8
    assert angle(found, ripples) < 0.5 * angle(smooth, ripples)


def test_a_surface_at_full_size_is_taken_as_it_is(ripples: Floats64) -> None:
    surface = flat(1, w=2.0 * ripples)

    found = surface_normals(strip_of(ripples[::-1]), surface)

    np.testing.assert_allclose(found, ripples, atol=1e-6)


def test_what_was_cut_out_follows_its_own_light(ripples: Floats64) -> None:
    """Also at full size, and what was not cut out is left as it is."""
    cut = np.zeros((SIZE, SIZE), bool)
    cut[:, 32:] = True
    smooth = np.broadcast_to(np.array([0.0, 0.0, 1.0]), ripples.shape)

    found = surface_normals(strip_of(ripples), flat(1, cut=cut))

    np.testing.assert_allclose(found[:, :32], smooth[:, :32])
    assert angle(found[:, 32:], ripples[:, 32:]) < 0.5


def test_what_the_fit_leaves_over_is_no_detail(ripples: Floats64) -> None:
    """A light that the fit explains but for its scale moves no normal."""
    level = np.broadcast_to([0.0, 0.0, 1.0], ripples.shape)
    strip = strip_of(level)
    dimmed = replace(strip, no_flash=strip.no_flash * np.float32(0.8))
    surface = flat(BLOCK, correction=np.full((SIZE // BLOCK, SIZE // BLOCK, 3), 1 / 0.8))

    assert angle(surface_normals(dimmed, surface), level) < 1e-2
    assert angle(surface_normals(dimmed, flat(BLOCK)), level) > 0.3


@pytest.mark.parametrize("block", [1, BLOCK])
def test_strips_fit_together(ripples: Floats64, block: int) -> None:
    surface = flat(block)
    whole = surface_normals(strip_of(ripples), surface)
    parts = [
        surface_normals(strip_of(ripples, slice(top, top + 16)), surface)
        for top in range(0, SIZE, 16)
    ]

    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_what_is_not_known_is_nan(ripples: Floats64) -> None:
    mask = np.ones((SIZE // BLOCK, SIZE // BLOCK), bool)
    mask[:, 8:] = False
    w = np.where(mask[..., None], [0.0, 0.0, 1.0], 0.0)

    found = surface_normals(strip_of(ripples), flat(BLOCK, w=w, mask=mask))
    doubtful = surface_normals(strip_of(ripples, confidence=0.1), flat(BLOCK))

    assert np.isfinite(found[:, :32]).all()
    assert np.isnan(found[:, 36:]).all()
    assert np.isnan(doubtful).all()
    np.testing.assert_allclose(np.linalg.norm(found[:, :32], axis=2), 1, atol=1e-6)


def test_depth_is_spread_to_the_pictures_size() -> None:
    side = SIZE // BLOCK
    z = 1 + 0.01 * np.broadcast_to(np.arange(side), (side, side))
    mask = np.ones((side, side), bool)
    mask[:4] = False

    depth = surface_depth(flat(BLOCK, z=np.where(mask, z, 0), mask=mask), (SIZE + 2, SIZE))

    assert depth.shape == (SIZE + 2, SIZE)
    assert np.isnan(depth[:12]).all()
    expected = 1 + 0.01 * ((np.arange(8, 56) + 0.5) / BLOCK - 0.5)
    np.testing.assert_allclose(depth[30, 8:56], expected, rtol=1e-5)


@pytest.mark.parametrize("block", [1, 3])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_side_of_any_length_is_spread(axis: int, block: int) -> None:
    """Of 40,003 pixels: more than 32,766 to a side, beyond which the interpolation ends."""
    length, blocks = 40_003, 40_003 // block
    along = np.random.default_rng(4).uniform(0, 1, blocks)
    field = np.expand_dims(np.stack([along, 1 - along], axis=1), 1 - axis).repeat(4, 1 - axis)

    size = (length, 4 * block) if axis == 0 else (4 * block, length)
    found = np.moveaxis(spread(field, block, slice(0, size[0]), size[1]), axis, 0)

    place = (np.arange(length) + 0.5) / block - 0.5
    expected = np.interp(place, np.arange(blocks), along)
    for across in (0, 2 * block):
        np.testing.assert_allclose(found[:, across, 0], expected, atol=0.02)
        np.testing.assert_allclose(found[:, across].sum(axis=1), 1, atol=1e-5)
    part = slice(17_000, 17_010)
    if axis == 0:
        np.testing.assert_array_equal(spread(field, block, part, size[1]), found[part])


@pytest.mark.parametrize("left_over", [(0, 0), (3, 0), (0, 3), (2, 3)])
def test_a_surface_is_known_to_the_edges_of_the_picture(
    ripples: Floats64, left_over: tuple[int, int]
) -> None:
    """Also in the pixels that are left over of it after whole blocks; as are their details."""
    height, width = (SIZE - 4 + pixels for pixels in left_over)
    side = SIZE // BLOCK - 1
    surface = flat(BLOCK)
    blocks = ("mask", "cut", "w", "z", "lit", "deviations", "correction")
    surface = replace(surface, **{name: getattr(surface, name)[:side, :side] for name in blocks})
    true = ripples[:height, :width]
    smooth = np.broadcast_to([0.0, 0.0, 1.0], true.shape).astype(np.float32)

    depth = surface_depth(surface, (height, width))
    found = surface_normals(strip_of(true, slice(0, height)), surface)

    np.testing.assert_array_equal(depth, np.ones((height, width)))
    for edge in (np.s_[:3], np.s_[-3:], np.s_[:, :3], np.s_[:, -3:]):
        assert angle(found[edge], true[edge]) < 0.6 * angle(smooth[edge], true[edge])


def test_depth_and_normals_of_a_long_picture_are_found() -> None:
    width = 33_000
    known = np.ones((2, width), bool)
    up = np.broadcast_to([0.0, 0.0, 1.0], (2, width, 3))
    z = np.tile(np.arange(1.0, width + 1), (2, 1))
    surface = replace(flat(1), mask=known, cut=~known, w=up, z=z)

    depth = surface_depth(surface, (2, width))
    normals = surface_normals(strip_of(up, slice(0, 2)), surface)

    np.testing.assert_array_equal(depth, surface.z)
    np.testing.assert_array_equal(normals, up)
