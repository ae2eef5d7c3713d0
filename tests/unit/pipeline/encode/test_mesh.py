from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.encode.mesh import Mesh, make_mesh

FOCAL = 100.0


def plane(height: int, width: int, depth: float = 2.0) -> tuple[Any, Any]:
    """Depth and normals of a plane that faces the camera."""
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), (height, width, 3)).copy()
    return np.full((height, width), depth, np.float32), normals


def crossed(mesh: Mesh) -> Floats64:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def test_vertices_are_where_the_pixels_show_them() -> None:
    depth, normals = plane(4, 6)
    depth[:, 3:] = 2.01

    mesh = make_mesh(depth, normals, FOCAL)

    assert mesh.vertices.shape == (24, 3)
    assert mesh.faces.shape == (2 * 3 * 5, 3)
    np.testing.assert_allclose(mesh.vertices[0], [-2.5 * 0.02, 1.5 * 0.02, -2], atol=1e-6)
    np.testing.assert_allclose(mesh.vertices[-1], [2.5 * 0.0201, -1.5 * 0.0201, -2.01], atol=1e-6)
    np.testing.assert_allclose(mesh.uv[0], [0.5 / 6, 0.5 / 4])
    np.testing.assert_allclose(mesh.uv[-1], [5.5 / 6, 3.5 / 4])
    np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * 24)
    assert (crossed(mesh)[:, 2] > 0).all()


def test_no_triangle_bridges_a_jump_or_reaches_outside() -> None:
    depth, normals = plane(8, 8)
    depth[:, 4:] = 3
    depth[0], normals[7, 0] = np.nan, np.nan

    mesh = make_mesh(depth, normals, FOCAL)

    z = -mesh.vertices[:, 2][mesh.faces]
    assert (np.ptp(z, axis=1) == 0).all()
    assert len(mesh.vertices) == 7 * 8 - 1
    assert len(mesh.faces) == 2 * (2 * 6 * 3) - 2
    assert np.isfinite(mesh.vertices).all()


def test_a_steep_side_is_no_jump_while_normals_go_along_with_it() -> None:
    """A slope of 4: depth alone would not tell it from a jump."""
    _, x = np.mgrid[:6, :6]
    depth = (2 / (1 - 4 * (x - 2.5) / FOCAL)).astype(np.float32)
    slanted = np.array([4, 0, 1], np.float32) / np.sqrt(17) * np.ones((6, 6, 1), np.float32)

    along, off = (make_mesh(depth, n.astype(np.float32), FOCAL) for n in (slanted, plane(6, 6)[1]))

    assert len(along.faces) == 50
    assert len(off.faces) == 0


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    ("slope", "off", "joined"),
    [
        (1.9, 0.8, True),
        (2.1, 0.8, False),
        (4.0, 0.45, True),
        (4.0, 0.55, False),
        (11.0, 0.0, True),
        (13.0, 0.0, False),
    ],
)
def test_a_jump_is_steep_and_off_the_surface_or_sheer(
    axis: int, slope: float, off: float, joined: bool
) -> None:
    """Normals are turned off the slope's by an angle of this sine; from upper to lower, too."""
    _, x = np.mgrid[:6, :6]
    depth = (2 / (1 - slope * (x - 2.5) / FOCAL)).astype(np.float32)
    angle = np.arctan2(slope, 1) - np.arcsin(off)
    normal = np.array([np.sin(angle), 0, np.cos(angle)])
    if axis == 0:  # deeper towards the upper edge
        depth, normal = np.ascontiguousarray(np.rot90(depth)), normal[[1, 0, 2]]
    normals = np.broadcast_to(normal.astype(np.float32), (6, 6, 3))

    assert len(make_mesh(depth, normals, FOCAL).faces) == 50 * joined


def test_either_side_tells_a_jump() -> None:
    """On a slope of 4, one column of pixels that face the camera hangs together with none."""
    _, x = np.mgrid[:6, :6]
    depth = (2 / (1 - 4 * (x - 2.5) / FOCAL)).astype(np.float32)
    normals = np.tile(np.array([4, 0, 1], np.float32) / np.float32(np.sqrt(17)), (6, 6, 1))
    normals[:, 3] = [0, 0, 1]

    assert len(make_mesh(depth, normals, FOCAL).faces) == 2 * 5 * 3


def test_all_squares_about_an_unknown_pixel_are_open() -> None:
    depth, normals = plane(5, 5)
    depth[2, 2] = np.nan

    mesh = make_mesh(depth, normals, FOCAL)

    assert len(mesh.faces) == 2 * (16 - 4)
    assert len(mesh.vertices) == 24


@pytest.mark.parametrize("turned", [False, True])
def test_a_jump_parts_rows_as_it_parts_columns(turned: bool) -> None:
    depth, normals = plane(6, 6)
    depth[3:] = 3

    mesh = make_mesh(depth.T if turned else depth, normals, FOCAL)

    assert len(mesh.faces) == 2 * 5 * 4


def test_what_no_surface_can_be_is_a_jump_whatever_the_normals_say() -> None:
    depth, normals = plane(4, 4)
    depth[:, 2:] = 2.5
    normals[:] = [1, 0, 0]

    assert len(make_mesh(depth, normals, FOCAL).faces) == 2 * 2 * 3


def test_many_pixels_share_a_vertex() -> None:
    depth, normals = plane(30, 40)

    mesh = make_mesh(depth, normals, FOCAL, most=100)

    assert len(mesh.vertices) == 7 * 10
    np.testing.assert_allclose(mesh.uv[0], [2 / 40, 2 / 30])
    np.testing.assert_allclose(mesh.vertices[0], [(2 - 20) * 0.02, (15 - 2) * 0.02, -2])


@pytest.mark.parametrize("focal", [FOCAL, 1.0])
def test_a_block_is_known_where_half_of_it_is(focal: float) -> None:
    """Blocks of 2 × 2 pixels; the depth of those is not drawn to nothing by unknown pixels.

    Through the shorter lens it would be no jump if it were.
    """
    depth, normals = plane(8, 8)
    depth[::2, ::4] = np.nan  # every second block lacks one pixel
    depth[0:2, 0] = np.nan  # the first lacks two
    depth[6:, 7] = depth[6, 6] = np.nan  # the last lacks three

    mesh = make_mesh(depth, normals, focal, most=16)

    assert len(mesh.vertices) == 15
    np.testing.assert_allclose(mesh.vertices[:, 2], -2, atol=1e-6)
    np.testing.assert_allclose(mesh.uv[[0, -1]], [[1 / 8, 1 / 8], [5 / 8, 7 / 8]])


def test_normals_of_blocks_are_unit_vectors() -> None:
    depth, normals = plane(8, 8)
    normals[:, ::2] = [0.6, 0, 0.8]

    mesh = make_mesh(depth, normals, FOCAL, most=16)

    expected = np.array([0.6, 0, 1.8]) / np.hypot(0.6, 1.8)
    np.testing.assert_allclose(mesh.normals, np.tile(expected, (16, 1)), atol=1e-6)


def test_a_small_surface_keeps_its_pixels_in_a_large_picture() -> None:
    depth, normals = plane(30, 40)
    depth[:, 10:] = depth[10:] = np.nan

    assert len(make_mesh(depth, normals, FOCAL, most=100).vertices) == 100


def test_blocks_grow_until_they_are_few_enough() -> None:
    """Scattered pixels make more blocks half known than their number tells."""
    depth, normals = plane(40, 40)
    depth[np.random.default_rng(1).uniform(size=depth.shape) > 0.6] = np.nan
    assert np.ceil(np.sqrt(np.isfinite(depth).sum() / 245)) == 2

    mesh = make_mesh(depth, normals, FOCAL, most=245)

    assert 50 < len(mesh.vertices) <= 245
    np.testing.assert_allclose(np.diff(np.unique(mesh.uv[:, 0])), 3 / 40)


def test_of_nothing_there_is_no_triangle() -> None:
    depth, normals = plane(4, 4)

    mesh = make_mesh(np.full_like(depth, np.nan), normals, FOCAL)

    assert mesh.faces.shape == (0, 3)
    assert mesh.vertices.shape == (0, 3)


def test_a_small_surface_takes_little_memory_in_a_large_picture() -> None:
    """Strips of the picture and one byte per pixel; whole grids would take 200 bytes of each."""
    height, width = 2000, 1000
    depth, normals = plane(height, width)
    depth[:, 20:] = depth[:-10] = np.nan

    tracemalloc.start()
    try:
        mesh = make_mesh(depth, normals, FOCAL)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert peak < 20 * height * width
    assert len(mesh.faces) == 2 * 9 * 19
    np.testing.assert_allclose(mesh.uv[[0, -1]], [[5e-4, 0.99525], [0.0195, 0.99975]])


def test_blocks_at_the_edges_are_no_neighbours() -> None:
    """Of the last column and of the first of the row below."""
    depth, normals = plane(6, 5)
    depth[:, 1:4] = np.nan

    assert make_mesh(depth, normals, FOCAL).faces.shape == (0, 3)
