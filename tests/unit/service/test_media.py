from __future__ import annotations

import pytest

from service.media import media_type


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("manifest.json", "application/json"),
        ("layers.exr", "image/x-exr"),
        ("lamp1.tif", "image/tiff"),
        ("white_balanced_1.jpg", "image/jpeg"),
        ("gamma.png", "image/png"),
        ("surface.glb", "model/gltf-binary"),
        ("layers.psd", "image/vnd.adobe.photoshop"),
        ("surface.unknown", "application/octet-stream"),
        ("none", "application/octet-stream"),
    ],
)
def test_the_end_of_a_name_tells_its_media_type(name: str, expected: str) -> None:
    assert media_type(name) == expected
