"""What answers say of a result, by its name."""

from __future__ import annotations

_TYPES = {
    "json": "application/json",
    "exr": "image/x-exr",
    "tif": "image/tiff",
    "jpg": "image/jpeg",
    "png": "image/png",
    "glb": "model/gltf-binary",
    "psd": "image/vnd.adobe.photoshop",
}


def media_type(name: str) -> str:
    """Tell the media type of a result."""
    return _TYPES.get(name.rpartition(".")[2], "application/octet-stream")


def headers_of(name: str) -> dict[str, str]:
    """Headers of every answer that has a result in it, whoever gives it."""
    return {
        "Content-Type": media_type(name),
        "Content-Disposition": f'inline; filename="{name}"',
    }
