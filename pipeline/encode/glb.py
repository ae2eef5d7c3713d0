from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image as PillowImage
from trimesh.exchange.gltf import export_glb

from pipeline.area_means import area_means, size_within
from pipeline.encode.jpeg import write_jpeg
from pipeline.frames import Image, Matrix
from pipeline.mesh import Mesh

_MOST_SIDE = 4096  # pixels of a texture that every viewer can show
_JPEG = b"\xff\xd8"


def write_glb(path: Path, mesh: Mesh, picture: Image, to_srgb: Matrix) -> None:
    """Write a mesh with its normals as binary glTF 2.0, the picture inside it as texture.

    picture: (H, W, 3) linear, over which mesh.uv goes; to_srgb: matrix (3, 3) to linear sRGB.
    Nothing is said of where it comes from. Raises OSError.
    """
    texture = _texture(picture, to_srgb)
    material = trimesh.visual.material.PBRMaterial(
        name="surface",
        baseColorTexture=PillowImage.open(io.BytesIO(texture)),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    # trimesh counts v from the lower edge
    uv = np.stack([mesh.uv[:, 0], 1.0 - mesh.uv[:, 1]], axis=1)
    body = trimesh.Trimesh(
        vertices=mesh.vertices,
        faces=mesh.faces,
        vertex_normals=mesh.normals if len(mesh.normals) else None,
        visual=trimesh.visual.TextureVisuals(uv=uv, material=material),
        process=False,
    )
    scene = trimesh.Scene({"surface": body})

    def as_encoded(buffers: dict[str, bytes], _: object) -> None:
        # trimesh encodes the texture once more, and worse
        for name, data in buffers.items():
            if data.startswith(_JPEG):
                buffers[name] = texture + bytes(-len(texture) % 4)

    def unnamed(tree: dict[str, Any]) -> None:
        del tree["asset"]["generator"]

    path.write_bytes(
        export_glb(
            scene,
            include_normals=True,
            buffer_postprocessor=as_encoded,
            tree_postprocessor=unnamed,
        )
    )


def _texture(picture: Image, to_srgb: Matrix) -> bytes:
    height, width = picture.shape[:2]
    size = size_within((width, height), _MOST_SIDE)
    if size != (width, height):
        picture = area_means(picture, size)
    file = io.BytesIO()
    write_jpeg(file, picture, to_srgb)
    return file.getvalue()
