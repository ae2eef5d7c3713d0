from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from pipeline.taken_with import TakenWith
from tests.unit.pipeline.calibration.photographs import frame_of

CAMERA = TakenWith(make="NIKON", model="D5100")


def test_a_body_is_told_by_a_digest_of_its_serial() -> None:
    taken = TakenWith.of(frame_of(serial="6001234"))
    assert len(taken.body) == 12
    assert "6001234" not in taken.model_dump_json()
    assert taken.fits(CAMERA, "flash")
    assert not taken.fits(TakenWith.of(frame_of(serial="6001235")), "flash")


@pytest.mark.parametrize(
    ("kind", "made_with", "frame", "expected"),
    [
        ("camera", "raw", "linear", False),
        ("camera", "linear", "raw", False),
        ("lamps", "raw", "linear", False),
        ("lamps", "linear", "linear", True),
        ("flash", "raw", "linear", True),
        ("camera", "raw", "srgb", False),
        ("flash", "raw", "srgb", True),
        ("flash", "linear", "srgb", True),
        ("flash", "srgb", "srgb", True),
        ("flash", "srgb", "raw", False),
        ("flash", "srgb", "linear", False),
    ],
)
def test_colours_are_of_one_kind_of_files(
    kind: Any, made_with: str, frame: str, expected: bool
) -> None:
    """Linear files of a camera may hold what a converter has made of its sensor's values.

    A flash is the same whatever the files hold, but only approximate when found with renderings.
    """
    taken = TakenWith.of(frame_of(encoding=made_with))
    assert taken.fits(TakenWith.of(frame_of(encoding=frame)), kind) is expected


@pytest.mark.parametrize(
    ("encoding", "expected"), [("raw", True), ("linear", True), ("srgb", False)]
)
def test_what_was_kept_before_files_were_noted_fits_as_before(
    encoding: str, expected: bool
) -> None:
    older = TakenWith.model_validate(
        {"make": "NIKON", "model": "D5100", "body": "", "rendered": False}
    )
    assert older.fits(TakenWith.of(frame_of(encoding=encoding)), "camera") is expected


@pytest.mark.parametrize(
    ("kind", "made_with", "size", "expected"),
    [
        ("lamps", (3, 2), (2, 3), False),
        ("lamps", (2, 3), (3, 2), False),
        ("lamps", (2, 3), (4, 6), True),
        ("lamps", (3, 2), (3, 3), True),
        ("flash", (3, 2), (2, 3), True),
        ("camera", (2, 3), (3, 2), True),
    ],
)
def test_directions_of_lamps_are_of_pictures_that_lie_alike(
    kind: Any, made_with: tuple[int, int], size: tuple[int, int], expected: bool
) -> None:
    """A camera that looks down may write another orientation the next time."""
    taken = TakenWith.of(frame_of(made_with))
    assert taken.fits(TakenWith.of(frame_of(size)), kind) is expected


@pytest.mark.parametrize("size", [(3, 2), (2, 3)])
def test_lamps_kept_before_that_was_noted_fit_as_before(size: tuple[int, int]) -> None:
    assert CAMERA.fits(TakenWith.of(frame_of(size)), "lamps")


@pytest.mark.parametrize(
    ("made_with", "here", "kind", "expected"),
    [
        (1, 3, "lamps", False),
        (6, 8, "lamps", False),
        (3, 3, "lamps", True),
        (1, 3, "flash", True),
        (1, 3, "camera", True),
    ],
)
def test_directions_of_lamps_are_of_pictures_turned_alike(
    made_with: int, here: int, kind: Any, expected: bool
) -> None:
    """Half a turn leaves a picture's size, and turns the signs of directions."""
    taken = TakenWith.of(frame_of(orientation=made_with))
    assert taken.fits(TakenWith.of(frame_of(orientation=here)), kind) is expected


def test_lamps_kept_before_orientations_were_noted_fit_by_being_upright() -> None:
    older = TakenWith.of(frame_of()).model_copy(update={"orientation": None})
    assert older.fits(TakenWith.of(frame_of(orientation=3)), "lamps")
    assert not older.fits(TakenWith.of(frame_of((2, 3), orientation=6)), "lamps")


@pytest.mark.parametrize("kind", ["camera", "flash", "lamps"])
def test_another_model_is_an_obstacle_where_both_are_known(kind: Any) -> None:
    here = TakenWith.of(frame_of(make="SONY", model="ILCE-6400"))
    assert CAMERA.obstacle(here, kind) == (
        "the camera NIKON D5100, and these are of SONY ILCE-6400"
    )
    assert CAMERA.obstacle(TakenWith(), kind) is None
    assert TakenWith().obstacle(CAMERA, kind) is None
    assert not CAMERA.fits(TakenWith(), kind)  # what is used unasked must be known to fit


def test_a_name_in_a_sentence_is_no_longer_than_names_are() -> None:
    told = TakenWith(model=200 * "x").obstacle(CAMERA, "camera")
    assert told == f"the camera {80 * 'x'}, and these are of NIKON D5100"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("encoding", "jpeg"),
        ("encoding", "raw\n"),
        ("orientation", 0),
        ("orientation", 9),
        ("upright", "perhaps"),
        ("model", None),
        ("make", 201 * "x"),
        ("model", 201 * "x"),
        ("body", 201 * "x"),
        ("lens", "50 mm"),
    ],
)
def test_what_no_photograph_says_is_refused(name: str, value: Any) -> None:
    with pytest.raises(ValidationError, match=name):
        TakenWith.model_validate({name: value})
