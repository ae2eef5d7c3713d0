from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image as PillowImage

from pipeline.encode.files import describe
from pipeline.encode.glb import write_glb
from pipeline.encode.jpeg import write_jpeg
from pipeline.encode.mesh import Mesh, make_mesh
from pipeline.encode.texture import Texture
from pipeline.images.strips import strips


@pytest.fixture
def mesh() -> Mesh:
    y, x = np.mgrid[:8, :12]
    normals = np.broadcast_to(np.array([0, 0, 1], np.float32), (8, 12, 3))
    return make_mesh((1 + 0.001 * x + 0.002 * y).astype(np.float32), normals, 50.0)


@pytest.fixture
def picture() -> np.ndarray:
    """Red at the left, green at the upper edge."""
    picture = np.zeros((8, 12, 3), np.float32)
    picture[:, :6, 0] = 0.8
    picture[:4, :, 1] = 0.8
    return picture


def written(path: Path, mesh: Mesh, picture: np.ndarray, to_srgb: np.ndarray) -> None:
    """Write a mesh with the picture, which comes in strips, as its texture."""
    texture = Texture((picture.shape[1], picture.shape[0]), to_srgb)
    for rows in strips(len(picture), 3):
        texture.write(picture[rows])
    write_glb(path, mesh, texture.close())


def test_a_mesh_reads_back_in_another_reader(
    mesh: Mesh, picture: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "surface.glb"
    written(path, mesh, picture, np.eye(3))

    scene = trimesh.load_scene(path)
    (body,) = scene.geometry.values()

    np.testing.assert_allclose(body.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_array_equal(body.faces, mesh.faces)
    np.testing.assert_allclose(body.vertex_normals, mesh.normals, atol=1e-6)
    np.testing.assert_allclose(body.visual.uv, mesh.uv * [1, -1] + [0, 1], atol=1e-6)
    np.testing.assert_array_equal(scene.graph.get("surface")[0], np.eye(4))
    np.testing.assert_array_less(0, body.face_normals[:, 2])


def test_the_texture_is_the_picture_as_encoded_once(
    mesh: Mesh, picture: np.ndarray, tmp_path: Path
) -> None:
    path, alone = tmp_path / "surface.glb", io.BytesIO()
    written(path, mesh, picture, np.eye(3))
    write_jpeg(alone, picture)

    data = path.read_bytes()

    assert alone.getvalue() in data
    (body,) = trimesh.load_scene(path).geometry.values()
    assert body.visual.material.baseColorTexture.size == (12, 8)


def test_the_texture_is_in_srgb(mesh: Mesh, picture: np.ndarray, tmp_path: Path) -> None:
    path, alone = tmp_path / "surface.glb", io.BytesIO()
    to_srgb = np.array([[1.5, -0.5, 0], [-0.1, 1.2, 0], [0, 0.2, 0.5]])
    written(path, mesh, picture, to_srgb)
    write_jpeg(alone, picture, to_srgb)

    assert alone.getvalue() in path.read_bytes()


def test_the_surface_is_matt_and_has_two_sides(
    mesh: Mesh, picture: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "surface.glb"
    written(path, mesh, picture, np.eye(3))

    data = path.read_bytes()

    head = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    (material,) = head["materials"]
    assert material["doubleSided"]
    surface = material["pbrMetallicRoughness"]
    assert (surface["metallicFactor"], surface["roughnessFactor"]) == (0, 1)


def test_vertices_in_one_place_stay_apart(picture: np.ndarray, tmp_path: Path) -> None:
    """As on both sides of a jump that is seen end on."""
    corners = np.array([[0.0, 0, -1], [1, 0, -1], [0, 1, -1]] * 2)
    up = np.tile([0.0, 0, 1], (6, 1))
    faces = np.arange(6).reshape(2, 3)
    path = tmp_path / "surface.glb"
    written(path, Mesh(corners, up, np.zeros((6, 2)), faces), picture, np.eye(3))

    (body,) = trimesh.load_scene(path, process=False).geometry.values()

    np.testing.assert_allclose(body.vertices, corners)
    np.testing.assert_array_equal(body.faces, faces)


@pytest.mark.parametrize(
    ("size", "smaller"), [((5000, 3), (4096, 2)), ((5000, 2), (4096, 2)), ((3, 5000), (2, 4096))]
)
def test_a_large_texture_is_made_smaller(
    mesh: Mesh, tmp_path: Path, size: tuple[int, int], smaller: tuple[int, int]
) -> None:
    path = tmp_path / "surface.glb"
    written(path, mesh, np.full((*size[::-1], 3), 0.5, np.float32), np.eye(3))

    (body,) = trimesh.load_scene(path).geometry.values()

    texture: PillowImage.Image = body.visual.material.baseColorTexture
    assert texture.size == smaller


def test_a_texture_made_smaller_is_the_mean(mesh: Mesh, tmp_path: Path) -> None:
    """Of stripes of black and grey: 0.25 is 137 in sRGB."""
    stripes = np.zeros((16, 8192, 3), np.float32)
    stripes[:, ::2] = 0.5
    path = tmp_path / "surface.glb"
    written(path, mesh, stripes, np.eye(3))

    (body,) = trimesh.load_scene(path).geometry.values()

    assert np.asarray(body.visual.material.baseColorTexture) == pytest.approx(137, abs=1)


def test_bytes_are_the_same_each_time_and_tell_of_nobody(
    mesh: Mesh, picture: np.ndarray, tmp_path: Path
) -> None:
    paths = tmp_path / "a.glb", tmp_path / "b.glb"
    for path in paths:
        written(path, mesh, picture, np.eye(3))

    first, second = (path.read_bytes() for path in paths)

    assert first == second
    head = json.loads(first[20 : 20 + int.from_bytes(first[12:16], "little")])
    assert head["asset"] == {"version": "2.0"}
    assert b"Exif" not in first


def test_a_surface_of_nothing_is_an_empty_scene(picture: np.ndarray, tmp_path: Path) -> None:
    nothing = make_mesh(np.full((8, 12), np.nan, np.float32), picture, 50.0)
    path = tmp_path / "surface.glb"

    written(path, nothing, picture, np.eye(3))

    assert path.read_bytes()[:4] == b"glTF"
    assert set(describe(path, "glTF", "sRGB")) == {"name", "sha256", "encoding", "colour_space"}


def test_a_full_disk_is_told(mesh: Mesh, picture: np.ndarray, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        written(tmp_path / "missing" / "surface.glb", mesh, picture, np.eye(3))


def test_numbers_that_begin_like_a_jpeg_are_no_texture(
    mesh: Mesh, picture: np.ndarray, tmp_path: Path
) -> None:
    """A vertex whose first float has the bytes FF D8 in front."""
    places = mesh.vertices.astype(np.float32)
    places.view(np.uint8)[0, :2] = 0xFF, 0xD8
    path = tmp_path / "surface.glb"
    written(path, replace(mesh, vertices=places.astype(np.float64)), picture, np.eye(3))

    (body,) = trimesh.load_scene(path, process=False).geometry.values()

    np.testing.assert_array_equal(body.vertices, places)
    assert body.visual.material.baseColorTexture.size == (12, 8)


def test_of_no_surface_there_is_no_mesh(picture: np.ndarray, tmp_path: Path) -> None:
    nothing = np.zeros((0, 3))
    path = tmp_path / "surface.glb"
    written(path, Mesh(nothing, nothing, nothing[:, :2], nothing.astype(int)), picture, np.eye(3))

    assert not trimesh.load_scene(path).geometry
