from __future__ import annotations

import pytest

import drivers
from pipeline.errors import OptionError
from service.cli import flash
from service.cli.flash import flash_switch
from service.workers.camera_tasks import brightness


def test_an_operator_is_asked_and_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[object] = []

    def wait(seconds: float) -> bool:
        done.append(seconds)
        return True

    monkeypatch.setattr(flash, "forget_typed", lambda: done.append("forgot"))
    monkeypatch.setattr(flash, "await_enter", wait)
    switch = flash_switch("operator", 0.0, done.append)
    assert isinstance(switch, drivers.OperatorFlash)
    assert switch.ask("Switch the flash on, then confirm.", 9.0)
    assert done == ["forgot", "Switch the flash on, then press Enter.", 9.0]
    assert switch.brightness is brightness


def test_a_flash_is_the_cameras_own_or_obeys_an_order() -> None:
    assert isinstance(flash_switch("property", 2.0), drivers.PropertyFlash)
    relay = flash_switch("http://relay/0?turn={state}", 2.0)
    assert relay == drivers.ExternalFlash("http://relay/0?turn={state}", brightness, 2.0)


def test_an_order_that_says_no_state_is_refused() -> None:
    with pytest.raises(OptionError, match=r"^--flash relay on is neither property nor operator"):
        flash_switch("relay on", 0.0)
