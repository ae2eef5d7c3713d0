from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from pipeline.calibration.options import (
    CALIBRATION_OPTIONS,
    CameraCalibration,
    FlashCalibration,
    LampsCalibration,
)
from pipeline.options import Sensitivities, Spectrum

CARD = {"x": 5, "y": 6, "radius": 3}
CHART = [[0, 0], [50, 0], [50, 30], [0, 30]]


def test_the_kind_says_what_is_read() -> None:
    read = CALIBRATION_OPTIONS.validate_python
    flash = read({"kind": "flash", "card": CARD, "flash_only": True})
    assert isinstance(flash, FlashCalibration) and flash.card is not None
    assert (flash.card.radius, flash.flash_only, flash.align) == (3.0, True, True)
    camera = read({"kind": "camera", "chart": CHART})
    assert isinstance(camera, CameraCalibration) and camera.chart is not None
    assert (camera.chart[2], camera.flash_spectrum) == ((50.0, 30.0), None)
    lamps = read({"kind": "lamps", "sphere": CARD})
    assert isinstance(lamps, LampsCalibration) and lamps.lights == "auto"


def test_tables_stand_for_names() -> None:
    nm = [400.0, 700.0]
    table = {"wavelength_nm": nm, "r": [1, 0], "g": [0, 1], "b": [0.5, 0.25]}
    light = {"wavelength_nm": nm, "power": [1, 2]}
    flash = CALIBRATION_OPTIONS.validate_python({"kind": "flash", "card": CARD, "camera": table})
    assert isinstance(flash, FlashCalibration) and isinstance(flash.camera, Sensitivities)
    assert flash.camera.b == [0.5, 0.25]
    camera = CALIBRATION_OPTIONS.validate_python(
        {"kind": "camera", "chart": CHART, "flash_spectrum": light}
    )
    assert isinstance(camera, CameraCalibration) and isinstance(camera.flash_spectrum, Spectrum)
    assert camera.flash_spectrum.power == [1, 2]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "kind"),
        ({"kind": "lens"}, "kind"),
        ({"kind": "flash", "card": CARD, "chart": CHART}, "mark either a grey card"),
        ({"kind": "flash", "card": {**CARD, "radius": 0}}, "greater than 0"),
        ({"kind": "flash", "card": {**CARD, "x": float("nan")}}, "finite"),
        ({"kind": "camera", "setup": "../up"}, "1 to 40 of the letters"),
        ({"kind": "camera", "setup": "none"}, "go without calibrations; give another name"),
        ({"kind": "camera", "chart": CHART[:3]}, "required"),
        ({"kind": "lamps", "sphere": CARD, "lights": 4}, "more than three lamps have no unique"),
        ({"kind": "lamps", "sphere": CARD, "lights": 0}, "'auto', 1, 2 or 3"),
        ({"kind": "lamps", "sphere": CARD, "lights": True}, "number of lamps is 1, 2, 3 or auto"),
        ({"kind": "lamps", "sphere": CARD, "focal_px": -1}, "than or equal to 10"),
        ({"kind": "lamps", "sphere": CARD, "focal_px": 1e30}, "than or equal to 1000000"),
        ({"kind": "lamps", "sphere": CARD, "card": CARD}, "Extra inputs"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        CALIBRATION_OPTIONS.validate_python(options)
