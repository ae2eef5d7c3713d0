from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pipeline.calibration.named_calibrations import named_warnings
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import OptionError
from pipeline.options import Options, PairOptions, Sensitivities, Spectrum
from pipeline.spectra.tables import write_sensitivities, write_spectrum
from pipeline.taken_with import TakenWith
from tests.unit.pipeline.calibration.photographs import frame_of

NM = [400.0, 550.0, 700.0]
WAYS = {
    "colours": "may give wrong colours",
    "normals": "may give wrong normals",
}
DO = "send photographs like those of the calibration, calibrate with such as these, or go without."


def _light(**made_with: Any) -> dict[str, Any]:
    return {"wavelength_nm": NM, "power": [1, 2, 1], **_said(made_with)}


def _camera(**made_with: Any) -> dict[str, Any]:
    curves = {"r": [0, 0.2, 1], "g": [0.1, 1, 0.2], "b": [1, 0.3, 0]}
    return {"wavelength_nm": NM, **curves, **_said(made_with)}


def _lamps(*made_with: dict[str, Any]) -> list[dict[str, Any]]:
    directions = ([1, 0, 1], [0, 1, 1], [-1, 0, 1])
    return [
        {"direction": direction, **_said(one)}
        for direction, one in zip(directions, made_with, strict=False)
    ]


def _said(made_with: dict[str, Any]) -> dict[str, Any]:
    return {"taken_with": TakenWith.of(frame_of(**made_with)).model_dump()}


def _messages(options: dict[str, Any], **here: Any) -> list[str]:
    warnings = named_warnings(Options.model_validate(options), frame_of(**here))
    assert {warning.code for warning in warnings} <= {"calibration_unfit"}
    return [warning.message for warning in warnings]


@pytest.mark.parametrize(
    ("options", "here", "begins", "wrong"),
    [
        (
            {"light_directions": _lamps({}, {})},
            {"orientation": 3},
            "The light directions that were given were found with pictures that were turned "
            "another way (EXIF orientation 1, of these 3). ",
            "normals",
        ),
        (
            {"light_directions": _lamps({}, {})},
            {"size": (2, 3)},
            "The light directions that were given were found with pictures that lie, and these "
            "are upright. ",
            "normals",
        ),
        (
            {"light_directions": _lamps({"serial": "1"}, {"serial": "1"})},
            {"serial": "2"},
            "The light directions that were given were found with another camera of this model. ",
            "normals",
        ),
        (
            {"camera": _camera()},
            {"make": "SONY", "model": "ILCE-6400"},
            "The camera that was named was found with the camera NIKON D5100, and these are of "
            "SONY ILCE-6400. ",
            "colours",
        ),
        (
            {"camera": _camera(encoding="linear")},
            {},
            "The camera that was named was found with linear files, and these are RAW files. ",
            "colours",
        ),
        (
            {"flash_spectrum": _light(encoding="srgb")},
            {},
            "The flash that was named was found with sRGB files, and these are RAW files. ",
            "colours",
        ),
        (
            {"neutral": _light(encoding="srgb")},
            {"encoding": "linear"},
            "The neutral light that was named was found with sRGB files, and these are linear "
            "files. ",
            "colours",
        ),
        (
            {"pinned_lamps": ["A", {"x": 1, "y": 1, "radius": 1}, _light(encoding="srgb")]},
            {},
            "A lamp that was pinned was found with sRGB files, and these are RAW files. ",
            "colours",
        ),
        (
            {"forbidden_lamps": [_light(encoding="srgb")]},
            {},
            "A lamp that was forbidden was found with sRGB files, and these are RAW files. ",
            "colours",
        ),
    ],
)
def test_what_does_not_fit_is_told_and_what_to_do(
    options: dict[str, Any], here: dict[str, Any], begins: str, wrong: str
) -> None:
    (message,) = _messages(options, **here)
    assert message == f"{begins}Used as asked, that {WAYS[wrong]}: {DO}"


@pytest.mark.parametrize(
    ("options", "here"),
    [
        ({}, {}),
        ({"camera": "Nikon D5100", "flash_spectrum": "led", "neutral": "A"}, {}),
        ({"camera": _camera(), "light_directions": _lamps({}, {})}, {}),
        ({"flash_spectrum": _light()}, {}),
        ({"light_directions": [{"direction": [1, 0, 1]}, {"direction": [0, 1, 1]}]}, {}),
        ({"camera": {**_camera(), "taken_with": None}}, {"model": "D850"}),
        # a way up changes no colours
        ({"camera": _camera()}, {"size": (2, 3), "orientation": 6}),
        # light is the same for every camera
        ({"flash_spectrum": _light(serial="1")}, {"model": "D850", "serial": "2"}),
        ({"flash_spectrum": _light()}, {"encoding": "srgb"}),
        ({"pinned_lamps": [_light()]}, {"model": "D850"}),
        # what is not known speaks against nothing
        ({"camera": _camera(make="", model="")}, {}),
        ({"camera": _camera()}, {"make": "", "model": ""}),
        # another camera is what a response is for
        ({"response": _camera()}, {"model": "D850", "encoding": "linear"}),
    ],
)
def test_what_fits_or_does_not_say_is_not_told_of(
    options: dict[str, Any], here: dict[str, Any]
) -> None:
    assert _messages(options, **here) == []


def test_lamps_of_several_files_are_told_of_once_for_every_reason() -> None:
    upright, turned = {"size": (2, 3)}, {"orientation": 3}
    assert len(_messages({"light_directions": _lamps(upright, upright, upright)})) == 1
    assert len(_messages({"light_directions": _lamps({}, upright, {})})) == 1
    assert len(_messages({"light_directions": _lamps(turned, upright, {})})) == 2


def test_each_option_is_told_of() -> None:
    options = {
        "camera": _camera(model="D850"),
        "flash_spectrum": _light(encoding="srgb"),
        "light_directions": _lamps({"orientation": 3}, {"orientation": 3}),
    }
    begins = [message.partition(" found with ")[0] for message in _messages(options)]
    assert begins == [
        "The camera that was named was",
        "The flash that was named was",
        "The light directions that were given were",
    ]


@pytest.mark.parametrize(
    ("options", "here", "count"),
    [
        ({"kind": "flash", "camera": _camera()}, {"model": "D850"}, 1),
        ({"kind": "flash", "camera": _camera()}, {}, 0),
        ({"kind": "flash"}, {}, 0),
        ({"kind": "camera", "flash_spectrum": _light(encoding="srgb")}, {}, 1),
        ({"kind": "camera", "flash_spectrum": _light()}, {}, 0),
        ({"kind": "lamps"}, {}, 0),
    ],
)
def test_calibrations_take_others_in_the_same_way(
    options: dict[str, Any], here: dict[str, Any], count: int
) -> None:
    read: PairOptions = CALIBRATION_OPTIONS.validate_python(options)
    assert len(named_warnings(read, frame_of(**here))) == count


def test_calibrations_of_the_folder_are_named_by_their_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    camera = Sensitivities.model_validate(_camera(model="D850"))
    (tmp_path / "my_body.json").write_bytes(write_sensitivities(camera))
    flash = Spectrum.model_validate(_light(encoding="srgb"))
    (tmp_path / "my_flash.json").write_bytes(write_spectrum(flash))

    messages = _messages({"camera": "my body", "flash_spectrum": "my flash"})

    assert ["D850, and these are of NIKON D5100" in message for message in messages] == [
        True,
        False,
    ]
    assert "found with sRGB files, and these are RAW files" in messages[1]


def test_a_camera_that_is_unknown_is_refused() -> None:
    with pytest.raises(OptionError, match="no such camera"):
        _messages({"camera": "no such camera"})
