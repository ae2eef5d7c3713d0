from __future__ import annotations

import json
from typing import Any

import pytest

from pipeline.calibration.kept_calibrations import Kept, setup_warnings, with_kept
from pipeline.errors import OptionError
from pipeline.images.frames import Frame
from pipeline.options import Options, Spectrum
from pipeline.taken_with import TakenWith
from tests.unit.pipeline.calibration.photographs import frame_of

CAMERA = TakenWith(make="NIKON", model="D5100")
TABLE = "wavelength_nm,power\n400,1\n500,2\n700,1\n"
CURVES = "wavelength_nm,r,g,b\n400,1,1,2\n550,1,3,1\n700,2,1,1\n"
TWO = json.dumps({"lights": [{"direction": [1, 0, 1]}, {"direction": [0, 1, 1]}]})
THREE = json.dumps({"lights": [{"direction": d} for d in ([1, 0, 1], [0, 1, 1], [-1, 0, 1])]})
DIRECT = "light_directions"
ONE = json.dumps({"lights": [{"direction": [1, 0, 1]}]})


def _kept(kind: Any = "flash", content: str = TABLE, **more: Any) -> Kept:
    said = {"setup": "default", "name": "a", "made": "2026-01-01", "taken_with": CAMERA, **more}
    return Kept(kind=kind, content=content, **said)


def test_what_options_leave_out_is_filled_in_and_named() -> None:
    options, used, warnings = with_kept(
        Options(lights=2), [_kept(), _kept("lamps", TWO)], frame_of()
    )
    assert isinstance(options.flash_spectrum, Spectrum)
    assert options.flash_spectrum.power == [1, 2, 1]
    assert options.light_directions is not None
    assert options.lights == 2
    assert [entry["kind"] for entry in used] == ["flash", "lamps"]
    assert warnings == []
    assert used[0] == {"kind": "flash", "setup": "default", "name": "a", "made": "2026-01-01"}


def test_the_newest_counts() -> None:
    old = _kept(name="old", made="2025-01-01")
    _, used, _ = with_kept(Options(), [old, _kept(name="new", made="2026-05-05")], frame_of())
    assert [entry["name"] for entry in used] == ["new"]


@pytest.mark.parametrize(
    ("options", "kept", "frame"),
    [
        ({"flash_spectrum": "xenon"}, _kept(), frame_of()),
        ({"setup": "none"}, _kept(), frame_of()),
        ({"setup": "none"}, _kept(setup="none"), frame_of()),
        ({"setup": "studio"}, _kept(), frame_of()),
        ({}, _kept(), frame_of(model="D850")),
        ({}, _kept("camera", CURVES), frame_of(encoding="srgb")),
        ({}, _kept("camera", CURVES), frame_of(encoding="linear", profiled=True)),
        ({}, _kept(taken_with=TakenWith()), frame_of(make="", model="")),
        ({}, _kept(taken_with=CAMERA.model_copy(update={"body": "1"})), frame_of(serial="77")),
        ({}, _kept("lamps", ONE), frame_of()),
        ({"lights": 3}, _kept("lamps", TWO), frame_of()),
        ({"pinned_lamps": ["A", "D65", "FL2"]}, _kept("lamps", TWO), frame_of()),
        ({"method": "paper"}, _kept("lamps", TWO), frame_of()),
        ({"method": "paper", "lights": 2}, _kept("lamps", TWO), frame_of()),
    ],
)
def test_what_does_not_fit_is_left(options: dict[str, Any], kept: Kept, frame: Frame) -> None:
    given = Options.model_validate(options)
    assert with_kept(given, [kept], frame) == (given, [], [])


@pytest.mark.parametrize(
    ("options", "content", "count"),
    [
        ({"pinned_lamps": ["A", "D65"]}, TWO, 2),
        ({"pinned_lamps": ["A", "D65", "FL2"]}, THREE, 3),
        ({"method": "paper"}, THREE, 3),
    ],
)
def test_lamps_are_taken_where_there_are_enough(
    options: dict[str, Any], content: str, count: int
) -> None:
    filled, *_ = with_kept(Options.model_validate(options), [_kept("lamps", content)], frame_of())
    assert filled.light_directions is not None
    assert len(filled.light_directions) == count


def test_a_kept_calibration_that_options_refuse_is_named() -> None:
    nowhere = json.dumps({"lights": [{"direction": [0, 0, 0]}, {"direction": [0, 1, 1]}]})
    with pytest.raises(OptionError) as refused:
        with_kept(Options(), [_kept("lamps", nowhere, name="shelf")], frame_of())
    assert str(refused.value) == (
        "What is kept as 'shelf' for the set-up 'default' cannot be used: must not be zero in all "
        "three components. Calibrate anew, or separate with the set-up none."
    )


@pytest.mark.parametrize(
    "content", ["", "x", "{}", "[]", "null", '{"lights": 5}', '{"lights": [5]}']
)
@pytest.mark.parametrize("kind", ["camera", "flash", "lamps"])
def test_a_damaged_calibration_is_named(kind: Any, content: str) -> None:
    kept = _kept(kind, content, name="shelf", setup="table")
    with pytest.raises(OptionError) as refused:
        with_kept(Options(setup="table"), [kept], frame_of())
    said = str(refused.value)
    assert said.startswith("What is kept as 'shelf' for the set-up 'table' cannot be used")
    assert said.endswith(". Calibrate anew, or separate with the set-up none.")


@pytest.mark.parametrize(
    "directions",
    [[(-1, 0, 1), (0, 0, 1), (1, 0, 1)], [(0, 0, 1), (0, 0, 2)], [(1, 0, -1), (0, 1, 0)]],
)
def test_lamps_that_fix_no_normals_are_left_out_and_named(directions: Any) -> None:
    flat = json.dumps({"lights": [{"direction": one} for one in directions]})
    kept = [_kept("lamps", flat, name="shelf", setup="table"), _kept(setup="table")]

    options, used, warnings = with_kept(Options(setup="table"), kept, frame_of())

    assert options.light_directions is None
    assert [entry["kind"] for entry in used] == ["flash"]
    assert [warning.code for warning in warnings] == ["kept_unusable"]
    assert warnings[0].message == (
        "The lamps kept as 'shelf' for the set-up 'table' are nearly alike, lie nearly in one "
        "plane, or all behind the surface, which fixes no normals, so that they were left out: "
        "calibrate them anew, or separate with --setup none."
    )


def test_older_lamps_stand_in_for_those_that_fix_no_normals() -> None:
    flat = json.dumps({"lights": [{"direction": (0, 0, 1)}] * 2})
    kept = [_kept("lamps", flat, made="2027-01-01"), _kept("lamps", TWO, name="older")]

    _, used, warnings = with_kept(Options(), kept, frame_of())

    assert [entry["name"] for entry in used] == ["older"]
    assert len(warnings) == 1


@pytest.mark.parametrize(
    ("options", "content", "why"),
    [
        ({}, ONE, "normals need two lamps at least, and one is kept: calibrate with all lamps"),
        ({"lights": 3}, TWO, "2 lamps are kept, and 3 asked for or pinned: ask for as many"),
        ({"lights": 1}, TWO, "2 lamps are kept, and 1 asked for or pinned: ask for as many"),
        ({"pinned_lamps": ["A", "D65", "FL2"]}, TWO, "2 lamps are kept, and 3 asked for or pinned"),
        ({"method": "paper"}, TWO, "the method paper needs three lamps, and 2 are kept: ask for"),
    ],
)
def test_lamps_of_a_named_set_up_that_are_left_out_are_told(
    options: dict[str, Any], content: str, why: str
) -> None:
    given = Options.model_validate({"setup": "table", **options})
    kept = _kept("lamps", content, name="shelf", setup="table")

    assert with_kept(given, [kept], frame_of())[:2] == (given, [])
    (warning,) = with_kept(given, [kept], frame_of())[2]

    assert warning.code == "kept_unusable"
    begins = "The lamps kept as 'shelf' for the set-up 'table' were left out, since "
    assert warning.message.startswith(begins + why)


def test_lamps_that_others_stand_in_for_are_not() -> None:
    newer = _kept("lamps", THREE, setup="table", made="2027-01-01")
    both = [newer, _kept("lamps", TWO, setup="table")]

    _, used, warnings = with_kept(Options(setup="table", lights=2), both, frame_of())

    assert (len(used), warnings) == (1, [])


@pytest.mark.parametrize(
    ("setup", "kept"),
    [
        ("tabel", [_kept(setup="table")]),
        ("table", []),
        ("table", [_kept(setup="table", taken_with=TakenWith(make="NIKON", model="D850"))]),
    ],
)
def test_a_named_set_up_of_which_nothing_fits_is_warned_of(setup: str, kept: list[Kept]) -> None:
    warnings = setup_warnings(Options(setup=setup), kept, frame_of())

    assert [warning.code for warning in warnings] == ["nothing_kept"]
    assert f"'{setup}'" in warnings[0].message


@pytest.mark.parametrize(
    ("options", "kept"),
    [
        ({}, []),
        ({"setup": "default"}, []),
        ({"setup": "none"}, []),
        ({"setup": "table"}, [_kept(setup="table")]),
        ({"setup": "table", "lights": 1}, [_kept("lamps", TWO, setup="table")]),
        ({"setup": "table", "flash_spectrum": "xenon"}, [_kept(setup="table")]),
    ],
)
def test_other_set_ups_are_not(options: dict[str, Any], kept: list[Kept]) -> None:
    assert setup_warnings(Options.model_validate(options), kept, frame_of()) == []


def test_a_set_up_with_lamps_of_pictures_that_lie_otherwise_is_warned_of() -> None:
    kept = [_kept("lamps", TWO, setup="table", taken_with=TakenWith.of(frame_of((2, 3))))]

    warnings = setup_warnings(Options(setup="table"), kept, frame_of((3, 2)))

    assert [warning.code for warning in warnings] == ["nothing_kept"]


@pytest.mark.parametrize(
    ("kind", "content", "made_with", "here", "why"),
    [
        (
            "lamps",
            TWO,
            {"size": (2, 3)},
            {},
            "lamps kept as 'shelf' for the set-up 'table' were left out, since found with upright "
            "pictures, and these lie: send",
        ),
        ("lamps", TWO, {}, {"size": (2, 3)}, "found with pictures that lie, and these are upright"),
        (
            "lamps",
            TWO,
            {"orientation": 3},
            {},
            "found with pictures that were turned another way (EXIF orientation 3, of these 1): ",
        ),
        (
            "camera",
            CURVES,
            {},
            {"encoding": "linear"},
            "camera kept as 'shelf' for the set-up 'table' was left out, since found with RAW "
            "files, and these are linear files: send",
        ),
        (
            "camera",
            CURVES,
            {},
            {"encoding": "linear", "profiled": True},
            "found with RAW files, and these are files in the colours of a profile: ",
        ),
        ("lamps", TWO, {"serial": "1"}, {"serial": "2"}, "found with another camera of this model"),
    ],
)
def test_a_kind_of_a_named_set_up_that_does_not_fit_is_told(
    kind: Any, content: str, made_with: Any, here: Any, why: str
) -> None:
    taken = TakenWith.of(frame_of(**made_with))
    kept = [
        _kept(setup="table"),
        _kept(kind, content, setup="table", name="shelf", taken_with=taken, made="2027-01-01"),
        _kept(kind, content, setup="table", name="older", taken_with=taken),
    ]

    (warning,) = setup_warnings(Options(setup="table"), kept, frame_of(**here))
    _, used, left_out = with_kept(Options(setup="table"), kept, frame_of(**here))

    assert warning.code == "kept_unusable"
    assert why in warning.message
    assert ([entry["kind"] for entry in used], left_out) == (["flash"], [])


def test_a_kind_that_is_not_missed_is_not_told_of() -> None:
    """Another of the kind fits, an option stands in for it, or it is of another camera."""
    unfit = TakenWith.of(frame_of(orientation=3))
    lamps = _kept("lamps", TWO, setup="table", taken_with=unfit, made="2027-01-01")
    fitting = _kept("lamps", TWO, setup="table")
    foreign = _kept("lamps", TWO, setup="table", taken_with=TakenWith(make="NIKON", model="D850"))
    flash = _kept(setup="table")
    given = Options.model_validate({"setup": "table", **json.loads(TWO.replace("lights", DIRECT))})

    assert setup_warnings(Options(setup="table"), [lamps, fitting], frame_of()) == []
    assert setup_warnings(Options(setup="table"), [foreign, flash], frame_of()) == []
    assert setup_warnings(given, [lamps, flash], frame_of()) == []
    assert len(setup_warnings(Options(setup="table"), [lamps, flash], frame_of())) == 1
