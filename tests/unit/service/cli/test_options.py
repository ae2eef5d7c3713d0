from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import InputError, OptionError
from pipeline.options import Circle, Options, Sensitivities, Spectrum
from service.cli.options import Flags

CAMERA = "wavelength_nm,R,G,B\n400,0.1,0.2,0.3\n550,0.2,0.9,0.1\n700,0.5,0.1,0\n"
LIGHT = "wavelength_nm,power\n400,0.5\n700,1\n"


def test_no_flags_are_the_defaults() -> None:
    assert Flags().options() == Options()


def test_what_is_not_typed_is_unset_and_a_default_that_is_typed_is_set() -> None:
    assert Flags().options().model_fields_set == set()
    typed = Flags(flash_spectrum="xenon", setup="default", no_align=True).options()
    assert typed.model_fields_set == {"flash_spectrum", "setup", "align"}


def test_every_flag_reaches_its_option() -> None:
    same: dict[str, Any] = {
        "method": "paper",
        "quality": "fast",
        "basis": "joint",
        "camera": "Canon EOS 5D",
        "flash_spectrum": "D55",
        "encoding": "linear",
        "flash_only": True,
        "exposure_ratio": 2.5,
        "neutral": "A",
        "response": "Nikon D5100",
        "focal_px": 1200.0,
    }
    flags = Flags(lights="3", no_align=True, outputs="layers.exr, gamma.png", **same)
    expected = Options(lights=3, align=False, outputs=["layers.exr", "gamma.png"], **same)
    assert flags.options() == expected


def test_outputs_can_be_all() -> None:
    assert Flags(outputs="all").options().outputs == "all"


def test_files_become_tables(tmp_path: Path) -> None:
    camera, light = tmp_path / "camera.csv", tmp_path / "light"
    camera.write_text(CAMERA)
    light.write_text(LIGHT)
    flags = Flags(
        camera=str(camera), response=str(camera), flash_spectrum=str(light), neutral=str(light)
    )
    options = flags.options()
    assert isinstance(options.camera, Sensitivities)
    assert options.camera == options.response
    assert options.camera.g == [0.2, 0.9, 0.1]
    assert isinstance(options.flash_spectrum, Spectrum)
    assert options.flash_spectrum == options.neutral
    assert options.neutral.power == [0.5, 1.0]


def test_lamps_are_areas_names_or_files(tmp_path: Path) -> None:
    light = tmp_path / "bulb, warm.csv"
    light.write_text(LIGHT)
    flags = Flags(pin_lamp=["10, 20.5,3", "A"], forbid_lamp=[str(light), "1e3,4,5"])
    options = flags.options()
    assert options.pinned_lamps == [Circle(x=10, y=20.5, radius=3), "A"]
    assert options.forbidden_lamps == [
        Spectrum(wavelength_nm=[400, 700], power=[0.5, 1]),
        Circle(x=1000, y=4, radius=5),
    ]


def _directions(tmp_path: Path, content: Any) -> Options:
    path = tmp_path / "lights.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return Flags(light_directions=path).options()


def test_directions_come_from_a_file(tmp_path: Path) -> None:
    lights = [
        {"direction": [0, 0, 1]},
        {"direction": [1, 0, 1], "strength": 2.0},
        {"direction": [0, 1, 1], "strength": 1.0, "rgb": [1, 0.5, 0.25]},
    ]
    found = _directions(tmp_path, {"lights": lights}).light_directions
    assert found is not None
    assert [light.direction for light in found] == [(0, 0, 1), (1, 0, 1), (0, 1, 1)]
    assert [light.strength for light in found] == [None, 2.0, 1.0]
    assert [light.rgb for light in found] == [None, None, (1, 0.5, 0.25)]


ONE = {"direction": [0, 0, 1]}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("not JSON", "is not JSON of the form"),
        ("", "is not JSON of the form"),
        ([ONE] * 3, "is not JSON of the form"),
        ({"lamps": []}, "is not JSON of the form"),
        ({"lights": {"direction": [0, 0, 1]}}, "must be a list"),
        ({"lights": [ONE]}, "light_directions"),
        ({"lights": [ONE] * 4}, "light_directions"),
        ({"lights": [ONE, ONE, {"direction": [0, 1]}]}, "light direction 3, direction"),
        ({"lights": [ONE, ONE, {"direction": [0, 0, 1], "strength": 0}]}, "3, strength"),
        ({"lights": [ONE, ONE, {"direction": [0, 0, 1], "colour": 0}]}, "3, colour"),
        ({"lights": [ONE, ONE, "left"]}, "light direction 3: "),
    ],
)
def test_directions_that_cannot_be_used_are_told(content: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError) as caught:
        _directions(tmp_path, content)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (Flags(lights="4"), "more than three lamps"),
        (Flags(lights="0"), "lights"),
        (Flags(lights="-1"), "lights"),
        (Flags(lights="two"), "lights"),
        (Flags(lights="²"), "lights"),
        (Flags(method="good"), "method"),
        (Flags(basis="svd"), "basis"),
        (Flags(encoding="gamma"), "encoding"),
        (Flags(exposure_ratio=0.0), "exposure_ratio"),
        (Flags(exposure_ratio=float("nan")), "exposure_ratio"),
        (Flags(focal_px=-5.0), "focal_px"),
        (Flags(outputs="layers.exr,lamp9.gif"), "lamp9.gif"),
        (Flags(outputs=""), "Unknown output"),
        (Flags(camera="nothing.csv"), "nothing.csv cannot be read: no such file"),
        (Flags(camera="x" * 300), "x cannot be read: file name too long."),
        (Flags(pin_lamp=["x" * 300]), "x cannot be read: file name too long."),
        (Flags(pin_lamp=["1,2"]), "The area 1,2 is not three numbers X,Y,RADIUS"),
        (Flags(forbid_lamp=["1,2,3,4"]), "is not three numbers"),
        (Flags(pin_lamp=["1"]), "The area 1 is not three numbers"),
        (Flags(pin_lamp=["1,2,0"]), "pinned lamp 1, radius: "),
        (Flags(pin_lamp=["1,nan,2"]), "pinned lamp 1, y: "),
        (Flags(pin_lamp=["none.csv"]), "none.csv cannot be read: no such file"),
        (Flags(lights="1", pin_lamp=["A", "D65"]), "2 lamps are pinned and only 1"),
        (Flags(method="paper", pin_lamp=["A"]), "no room for pinned"),
        (Flags(light_directions=Path("nothing.json")), "nothing.json cannot be read"),
        (Flags(light_directions=Path()), "is a directory"),
    ],
)
def test_a_flag_that_cannot_be_used_is_told(flags: Flags, words: str) -> None:
    with pytest.raises(InputError) as caught:
        flags.options()
    assert words in str(caught.value)


def test_a_table_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    table = tmp_path / "camera.csv"
    table.write_text("wavelength_nm,power\n400,1\n")
    with pytest.raises(
        OptionError, match=r"^The file .*camera\.csv cannot be used\. The camera table"
    ):
        Flags(camera=str(table)).options()
