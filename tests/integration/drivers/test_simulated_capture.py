from __future__ import annotations

from fractions import Fraction

import pytest

import drivers
from drivers.clock import Clock
from drivers.errors import (
    CameraBusyError,
    FocusError,
    NoFlashError,
    PairVerificationError,
    ProtocolError,
    StoreFullError,
    TransferError,
)
from drivers.sim.backend import open_camera

SMALL = "sim://studio?width=64&height=64"


def take(clock: Clock, query: str) -> drivers.CapturedPair:
    with open_camera(f"{SMALL}&{query}", clock) as camera:
        return drivers.capture_pair(camera, clock=clock)


@pytest.mark.parametrize(
    ("files", "kinds"), [("dng", {"dng"}), ("jpeg", {"jpeg"}), ("both", {"dng", "jpeg"})]
)
def test_a_pair_comes_through_the_public_door(files: str, kinds: set[str]) -> None:
    told = list[tuple[str, float]]()
    with drivers.open_camera(f"{SMALL}&format={files}") as camera:
        pair = drivers.capture_pair(camera, lambda stage, part: told.append((stage, part)))
    assert pair.no_flash.files.keys() == pair.flash.files.keys() == kinds
    best = pair.flash.files["dng" if "dng" in kinds else "jpeg"]
    assert pair.flash.best == best
    assert pair.no_flash.exposure.flash_fired is False
    assert pair.flash.exposure.flash_fired is True
    assert pair.no_flash.exposure.time_s == pair.flash.exposure.time_s
    assert tuple(dict.fromkeys(stage for stage, _ in told)) == drivers.CAPTURE_STAGES
    assert told[-1] == ("verify", 1.0)


@pytest.mark.parametrize("cable", ["direct", "usb"])
@pytest.mark.parametrize(
    "fault",
    [
        "busy_briefly",
        "lost_events",
        "late_events",
        "broken_transfer",
        "short_packets",
        "glued_packets",
        "stall",
        "slow_link",
        "asleep",
    ],
)
def test_passing_faults_change_nothing_in_the_pair(clock: Clock, fault: str, cable: str) -> None:
    sound = take(clock, "format=both")
    troubled = take(clock, f"format=both&cable={cable}&fault={fault}")
    assert troubled.no_flash == sound.no_flash
    assert troubled.flash == sound.flash


@pytest.mark.parametrize("cable", ["direct", "usb"])
@pytest.mark.parametrize(
    ("fault", "error", "sentence"),
    [
        ("busy", CameraBusyError, "wait until it is idle"),
        ("focus", FocusError, "focus by hand"),
        ("store_full", StoreFullError, "make room on it"),
        ("no_photograph", drivers.CaptureError, "no photograph reached its card"),
        ("silent", drivers.CameraTimeoutError, "no answer for 10 s"),
        ("garbled", ProtocolError, "switch the camera off and on"),
        ("unplug", drivers.CameraDisconnectedError, r"(connect|plug) it (in )?again"),
        ("hostile", ProtocolError, "ends too early"),
        ("huge_size", TransferError, "4294967295 bytes"),
        ("truncated", TransferError, "sent 0 bytes where"),
        ("flash_dead", NoFlashError, "The flash did not fire"),
        ("flash_always", PairVerificationError, "flash fired in the photograph"),
        ("flash_locked", drivers.SettingError, "can be set on the camera alone"),
        ("auto_exposure", PairVerificationError, "differ in exposure time"),
    ],
)
def test_lasting_faults_end_in_an_error_that_says_what_to_do(
    clock: Clock, fault: str, error: type[drivers.DriverError], sentence: str, cable: str
) -> None:
    with pytest.raises(drivers.DriverError, match=sentence) as caught:
        take(clock, f"cable={cable}&fault={fault}")
    assert type(caught.value) is error
    assert "\n" not in str(caught.value)
    assert str(caught.value).endswith(".")


def test_a_pair_depends_on_its_address_alone(clock: Clock) -> None:
    first, again = take(clock, "seed=5"), take(clock, "seed=5")
    assert first == again
    assert take(clock, "seed=6").flash.best != first.flash.best
    assert first.no_flash.best != first.flash.best


def test_chosen_exposures_reach_the_photographs(clock: Clock) -> None:
    with open_camera(f"{SMALL}&noise=off", clock) as camera:
        camera.write(drivers.SettingName.ISO, 400)
        camera.write(drivers.SettingName.F_NUMBER, 16)
        camera.write(drivers.SettingName.SHUTTER_S, 0.04)
        exposure = drivers.capture_pair(camera, clock=clock).flash.exposure
    assert (exposure.iso, exposure.f_number, float(exposure.time_s)) == (400, Fraction(16), 0.04)


def test_photographs_stay_on_the_card(clock: Clock) -> None:
    with open_camera(f"{SMALL}&format=both", clock) as camera:
        drivers.capture_pair(camera, clock=clock)
        drivers.capture_pair(camera, clock=clock)
        names = sorted(camera.describe(handle).name for handle in camera.objects())
    assert names == ["100STUDI"] + [
        f"DSC_000{number}.{kind}" for number in range(1, 5) for kind in ("DNG", "JPG")
    ]


def test_a_flash_without_charge_is_waited_for(clock: Clock) -> None:
    pair = take(clock, "fault=flash_not_ready")
    assert pair.flash.exposure.flash_fired is True
    assert clock.monotonic() > 5


@pytest.mark.parametrize("cable", ["direct", "usb"])
@pytest.mark.parametrize("fault", ["none", "lost_events", "busy_briefly"])
def test_a_camera_is_released_by_its_makers_own_calls(clock: Clock, cable: str, fault: str) -> None:
    pair = take(clock, f"camera=native&cable={cable}&fault={fault}")
    assert [shot.exposure.flash_fired for shot in (pair.no_flash, pair.flash)] == [False, True]


def test_a_camera_whose_flash_has_no_switch_says_so_first(clock: Clock) -> None:
    with pytest.raises(drivers.SettingError, match="cannot be switched off from a computer"):
        take(clock, "camera=switchless")
    assert clock.monotonic() < 1
