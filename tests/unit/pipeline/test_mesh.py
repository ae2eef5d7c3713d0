from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.mesh import Mesh, make_mesh

FOCAL = 100.0


def plane(height: int, width: int, depth: float = 2.0) -> tuple[Any, Any]:
    """Depth and normals of a plane that faces the camera."""
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), (height, width, 3)).copy()
    return np.full((height, width), depth, np.float32), normals


def crossed(mesh: Mesh) -> NDArray[np.float64]:
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


def test_of_nothing_there_is_no_triangle() -> None:
    depth, normals = plane(4, 4)

    mesh = make_mesh(np.full_like(depth, np.nan), normals, FOCAL)

    assert mesh.faces.shape == (0, 3)
    assert mesh.vertices.shape == (0, 3)
