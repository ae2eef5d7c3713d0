from __future__ import annotations

from pipeline.options import Options
from service.calibration_names import take_out

NAME = {"calibration": "a" * 32}


def test_stand_ins_take_the_place_of_calibrations() -> None:
    sent = {"camera": NAME, "flash_spectrum": NAME, "lights": 2}
    options, named = take_out(sent)
    assert named == {"camera": NAME, "flash_spectrum": NAME}
    assert options["lights"] == 2
    Options.model_validate(options)
    assert sent["camera"] == NAME


def test_what_names_no_calibration_stays_as_it_was_sent() -> None:
    sent = {"quality": NAME, "camera": {"calibration": "a", "more": 1}, "neutral": "d65"}
    assert take_out(sent) == (sent, {})
    deep = {"camera": {"calibration": ["a"]}, "neutral": {"calibration": {}}}
    assert take_out(deep) == (deep, {})
    for no_options in (None, [NAME], "camera"):
        assert take_out(no_options) == (no_options, {})
