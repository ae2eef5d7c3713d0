from __future__ import annotations

from typing import Any, Literal, NoReturn

import pytest
from pydantic import BaseModel

from pipeline.calibration.options import FlashCalibration
from pipeline.errors import OptionError
from pipeline.mixes.mix_options import LampMix, MixRequest
from pipeline.options import Circle, Options
from service import job_options
from service.job_options import check_options
from service.mixing import MixOptions

Task = Literal["separate", "calibrate", "mix"]

CARD = {"x": 20, "y": 20, "radius": 5}
MIX = {"kind": "mix", "of": "a", "mix": {"lamps": [{"ev": 1}]}}


def test_the_options_of_each_kind_of_job_are_read_as_its_own() -> None:
    assert check_options("separate", {}) == Options()
    read = check_options("separate", {"lights": 2, "pinned_lamps": [CARD]})
    assert isinstance(read, Options)
    assert read.model_dump(mode="json", exclude_unset=True) == {"lights": 2, "pinned_lamps": [CARD]}
    flash = check_options("calibrate", {"kind": "flash", "card": CARD, "setup": "table"})
    assert flash == FlashCalibration(kind="flash", card=Circle(**CARD), setup="table")
    mix = MixRequest(lamps=[LampMix(ev=1)])
    assert check_options("mix", MIX) == MixOptions(kind="mix", of="a", mix=mix)


@pytest.mark.parametrize(
    ("task", "options", "said"),
    [
        # a text is no number, as in a request
        ("separate", {"focal_px": "5000"}, "focal_px: Input should be a valid number."),
        ("separate", {"lights": 7}, "lights: more than three lamps have no unique answer"),
        ("separate", {"of_old": 1}, "of_old: this name is not known."),
        ("separate", {"kind": "flash"}, "kind: this name is not known."),
        ("calibrate", {}, "Field 'kind' required."),
        ("calibrate", {"kind": "sun"}, "'kind' should be one of 'flash', 'camera', 'lamps'."),
        ("calibrate", {"kind": "flash", "setup": "none"}, "flash.setup: separations of the set-up"),
        ("calibrate", {"kind": "flash", "lights": 2}, "flash.lights: this name is not known."),
        ("calibrate", {"kind": "lamps", "mirror": 1}, "lamps.mirror: Input should be a valid bool"),
        ("mix", {"kind": "mix", "of": "a"}, "mix: Field required."),
        ("mix", {**MIX, "mix": {"lamps": []}}, "mix.lamps: "),
        ("mix", {**MIX, "mix": {"lamps": [{"ev": "1"}]}}, "mix.lamp 1, ev: Input should be a "),
        ("mix", {**MIX, "of": 5}, "of: Input should be a valid string."),
    ],
)
def test_options_that_a_job_cannot_have_are_told_with_their_place(
    task: Task, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(OptionError) as told:
        check_options(task, options)
    assert str(told.value).startswith(said)


@pytest.mark.parametrize(
    ("task", "options"),
    [
        ("separate", {"neutral": "D655"}),
        ("calibrate", {"kind": "camera", "flash_spectrum": "xenonn"}),
        ("mix", MIX),
    ],
)
def test_cameras_and_lights_are_looked_up_in_the_options_of_every_kind(
    task: Task, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[dict[str, Any]] = []

    def refuse(read: BaseModel) -> NoReturn:
        looked.append(read.model_dump(mode="json", exclude_unset=True))
        raise OptionError("there is no such light")

    monkeypatch.setattr(job_options, "check_spectra", refuse)
    with pytest.raises(OptionError, match=r"^there is no such light$"):
        check_options(task, options)
    assert looked == [options]
