"""Media types of results, by the end of the name."""

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
