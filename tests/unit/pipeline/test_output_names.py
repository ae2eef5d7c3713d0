from __future__ import annotations

from dataclasses import fields

from pipeline.output_names import FULL_SIZE_JPEGS, OUTPUT_NAMES, OUTPUTS, outputs_with
from pipeline.results.pictures import Pictures


def test_all_jpegs_but_the_thumbnail_are_of_full_size() -> None:
    jpegs = {name for name in OUTPUT_NAMES if name.endswith(".jpg")}

    assert jpegs - {"thumbnail.jpg"} == FULL_SIZE_JPEGS


def test_outputs_need_pictures_that_there_are() -> None:
    pictures = {field.name for field in fields(Pictures)}
    needed = {need for output in OUTPUTS.values() for need in output.needs}

    assert needed - pictures == {"facing", "surface"}


def test_normals_and_surfaces_face_somewhere() -> None:
    assert outputs_with("normals") | outputs_with("surface") == outputs_with("facing")


def test_outputs_are_found_by_what_they_need() -> None:
    assert outputs_with("response") == {"response.jpg", "response_lamps.jpg", "response.exr"}
    assert outputs_with("surface") == {"normals_confidence.tif", "depth.exr", "surface.glb"}
    assert outputs_with("white_balanced_2") == {
        "white_balanced_2.jpg",
        "white_balanced_2.tif",
        "white_balanced.exr",
    }
