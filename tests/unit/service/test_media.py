from __future__ import annotations

import pytest

from service.media import headers_of, media_type


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


def test_answers_with_a_result_say_what_it_is_and_its_name() -> None:
    assert headers_of("lamp1.tif") == {
        "Content-Type": "image/tiff",
        "Content-Disposition": 'inline; filename="lamp1.tif"',
    }
