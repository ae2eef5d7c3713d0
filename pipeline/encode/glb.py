"""A mesh and its texture as binary glTF 2.0."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image as PillowImage
from trimesh.exchange.gltf import export_glb

from pipeline.encode.mesh import Mesh


def write_glb(path: Path, mesh: Mesh, texture: bytes) -> None:
    """Write a mesh with its normals as binary glTF 2.0, a picture inside it as texture.

    texture: a JPEG of the picture over which mesh.uv goes, see Texture.
    Nothing is said of where it comes from. Raises OSError.
    """
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

    def as_encoded(buffers: dict[str, bytes], tree: dict[str, Any]) -> None:
        # trimesh encodes the texture once more, and worse; numbers may begin like a JPEG
        names = list(buffers)
        for image in tree["images"]:
            buffers[names[image["bufferView"]]] = texture + bytes(-len(texture) % 4)

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
