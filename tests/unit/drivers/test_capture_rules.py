from __future__ import annotations

import pytest

from drivers.camera import (
    CameraObject,
    Event,
    EventKind,
    Setting,
    SettingName,
)
from drivers.capture import CAPTURE_STAGES, RECHARGE_S, capture_pair
from drivers.clock import Clock
from drivers.errors import (
    CaptureError,
    NoFlashError,
    PairVerificationError,
    SettingError,
    TransferError,
)
from drivers.flash import OperatorFlash
from drivers.shot import LARGEST_BYTES
from tests.raw_files import cr3, raf
from tests.unit.drivers.fake_camera import FLASH, MANUAL, NO_FLASH, FakeCamera, photograph, tags


def test_a_pair_is_taken_in_order_and_reported(clock: Clock) -> None:
    camera, told = FakeCamera(), list[tuple[str, float]]()
    pair = capture_pair(camera, lambda stage, fraction: told.append((stage, fraction)), clock)
    assert (pair.no_flash.best, pair.flash.best) == (NO_FLASH, FLASH)
    assert (pair.no_flash.exposure.flash_fired, pair.flash.exposure.flash_fired) == (False, True)
    assert [value for name, value in camera.written if name == SettingName.FLASH] == ["off", "fill"]
    stages = [stage for stage, _ in told]
    assert tuple(dict.fromkeys(stages)) == CAPTURE_STAGES
    assert stages == sorted(stages, key=CAPTURE_STAGES.index)
    for stage in CAPTURE_STAGES:
        fractions = [fraction for name, fraction in told if name == stage]
        assert (fractions[0], fractions[-1]) == (0.0, 1.0)
        assert fractions == sorted(fractions)


def test_nobody_is_asked_for_a_camera_that_cannot_be_released(clock: Clock) -> None:
    class Unreleased(FakeCamera):
        def check_release(self) -> None:
            raise SettingError("takes no order to release")

    camera, asked = Unreleased(), list[str]()

    def ask(request: str, _timeout_s: float) -> bool:
        asked.append(request)
        return True

    with pytest.raises(SettingError, match="takes no order to release"):
        capture_pair(camera, clock=clock, flash=OperatorFlash(ask, len))
    assert (asked, camera.written, len(camera.shots)) == ([], [], 2)


@pytest.mark.parametrize("white_balance", ["auto", "one_push"])
def test_automatic_settings_are_fixed_first(clock: Clock, white_balance: str) -> None:
    camera = FakeCamera()
    camera.set(SettingName.PROGRAM, "auto")
    camera.set(SettingName.FOCUS, "auto")
    camera.set(SettingName.DRIVE, "burst")
    camera.set(SettingName.ISO, "auto", "auto", 400, 200)
    camera.set(SettingName.WHITE_BALANCE, white_balance)
    capture_pair(camera, clock=clock)
    assert {name: setting.value for name, setting in camera.table.items()} == {
        **MANUAL,
        SettingName.ISO: 200,
    }


def test_chosen_settings_are_kept(clock: Clock) -> None:
    camera = FakeCamera(shots=[{"jpeg": photograph(0, 800)}, {"jpeg": photograph(1, 800)}])
    camera.set(SettingName.ISO, 800)
    camera.set(SettingName.WHITE_BALANCE, "tungsten")
    assert capture_pair(camera, clock=clock).flash.exposure.iso == 800
    assert camera.table[SettingName.WHITE_BALANCE].value == "tungsten"


def test_a_dial_that_stands_right_need_not_be_writable(clock: Clock) -> None:
    camera = FakeCamera()
    dial = Setting(SettingName.PROGRAM, "manual", (), writable=False)
    camera.table[SettingName.PROGRAM] = dial
    assert capture_pair(camera, clock=clock).flash.best == FLASH


def test_a_dial_that_stands_wrong_is_an_error(clock: Clock) -> None:
    camera = FakeCamera()
    camera.table[SettingName.PROGRAM] = Setting(SettingName.PROGRAM, "auto", (), writable=False)
    with pytest.raises(SettingError, match="program is locked"):
        capture_pair(camera, clock=clock)
    assert len(camera.shots) == 2  # nothing was taken


def test_an_iso_that_cannot_be_fixed_is_an_error(clock: Clock) -> None:
    camera = FakeCamera()
    camera.set(SettingName.ISO, "auto", "auto")
    with pytest.raises(SettingError, match="set a fixed ISO"):
        capture_pair(camera, clock=clock)


@pytest.mark.parametrize(
    ("choices", "mode"), [(("off", "fill"), "fill"), (("off", "external"), "external")]
)
def test_the_flash_is_put_to_a_mode_that_fires(
    clock: Clock, choices: tuple[str, ...], mode: str
) -> None:
    camera = FakeCamera()
    camera.set(SettingName.FLASH, "auto", *choices)
    capture_pair(camera, clock=clock)
    assert camera.table[SettingName.FLASH].value == mode


def test_files_of_two_photographs_are_none(clock: Clock) -> None:
    camera = FakeCamera(shots=[{"dng": FLASH, "jpeg": NO_FLASH}])
    with pytest.raises(CaptureError, match="Files of two photographs came as one"):
        capture_pair(camera, clock=clock)


def test_a_failed_second_photograph_repeats_the_pair_and_mixes_none(clock: Clock) -> None:
    fresh = NO_FLASH + b"anew"
    dark = {"jpeg": NO_FLASH}
    camera = FakeCamera([dark, dark, {"jpeg": fresh}, {"jpeg": FLASH}])
    pair = capture_pair(camera, clock=clock)
    assert (pair.no_flash.best, pair.flash.best) == (fresh, FLASH)
    modes = [value for name, value in camera.written if name == SettingName.FLASH]
    assert modes == ["off", "fill", "off", "fill"]
    assert clock.monotonic() > RECHARGE_S


def test_a_failed_first_photograph_repeats_nothing(clock: Clock) -> None:
    camera = FakeCamera([{"jpeg": b"nothing"}, {"jpeg": FLASH}])
    with pytest.raises(PairVerificationError):
        capture_pair(camera, clock=clock)
    assert len(camera.shots) == 1


def test_a_pair_is_repeated_once_only(clock: Clock) -> None:
    camera = FakeCamera([{"jpeg": NO_FLASH}, {"jpeg": NO_FLASH}] * 3)
    with pytest.raises(NoFlashError, match="let it charge"):
        capture_pair(camera, clock=clock)
    assert len(camera.shots) == 2


def test_a_dial_turned_between_the_photographs_is_noticed(clock: Clock) -> None:
    class Turned(FakeCamera):
        def trigger(self) -> None:
            super().trigger()
            self.set(SettingName.SHUTTER_S, 0.5)

    camera = Turned()
    with pytest.raises(SettingError, match=r"shutter_s went from 0.02 to 0.5 in the middle"):
        capture_pair(camera, clock=clock)
    assert len(camera.shots) == 1


def test_a_pair_is_deleted_from_the_card_and_nothing_else(clock: Clock) -> None:
    camera = FakeCamera()
    camera.card[40] = ("jpeg", b"old")
    pair = capture_pair(camera, clock=clock)
    assert sorted(camera.card) == [1, 40, 41, 42]
    pair.delete_from(camera)
    assert camera.card == {1: ("folder", b""), 40: ("jpeg", b"old")}


def test_a_camera_need_not_tell_its_other_settings(clock: Clock) -> None:
    camera = FakeCamera()
    for name in (SettingName.DRIVE, SettingName.FOCUS, SettingName.WHITE_BALANCE, SettingName.ISO):
        del camera.table[name]
    assert capture_pair(camera, clock=clock).flash.best == FLASH


def test_a_flash_without_a_mode_that_fires_is_an_error(clock: Clock) -> None:
    camera = FakeCamera()
    camera.set(SettingName.FLASH, "auto", "auto", "off", "red_eye_auto")
    with pytest.raises(SettingError, match="no flash mode that always fires"):
        capture_pair(camera, clock=clock)


def test_raw_is_preferred_and_both_are_kept(clock: Clock) -> None:
    raw, other = NO_FLASH + b"raw", FLASH + b"raw"
    camera = FakeCamera(shots=[{"jpeg": NO_FLASH, "dng": raw}, {"dng": other, "jpeg": FLASH}])
    pair = capture_pair(camera, clock=clock)
    assert (pair.no_flash.best, pair.flash.best) == (raw, other)
    assert pair.flash.files == {"dng": other, "jpeg": FLASH}


def test_raw_files_of_canon_and_fuji_make_pairs(clock: Clock) -> None:
    for shots in (
        [{"cr3": cr3(tags(0x10))}, {"cr3": cr3(tags(0x09))}],
        [{"raf": raf(NO_FLASH)}, {"raf": raf(FLASH)}],
    ):
        pair = capture_pair(FakeCamera(shots=list(shots)), clock=clock)
        assert [pair.no_flash.files, pair.flash.files] == shots
        assert [pair.no_flash.exposure.iso, pair.flash.exposure.iso] == [100, 100]


def test_the_exposure_is_of_whichever_file_tells_it(clock: Clock) -> None:
    shots = [{"rw2": b"odd", "jpeg": NO_FLASH}, {"rw2": b"odd", "jpeg": FLASH}]
    pair = capture_pair(FakeCamera(shots=list(shots)), clock=clock)
    assert [pair.no_flash.files, pair.flash.files] == shots
    assert pair.flash.exposure.flash_fired


def test_a_pair_through_a_lens_that_tells_no_aperture_is_taken(clock: Clock) -> None:
    shots = [{"jpeg": photograph(flash, f_number=None)} for flash in (0x10, 0x09)]
    pair = capture_pair(FakeCamera(shots=list(shots)), clock=clock)
    assert [pair.no_flash.exposure.f_number, pair.flash.exposure.f_number] == [None, None]


def test_an_aperture_that_one_file_alone_tells_is_compared(clock: Clock) -> None:
    shots = [
        {"cr3": cr3(tags(flash, f_number=None)), "jpeg": photograph(flash, f_number=f_number)}
        for flash, f_number in ((0x10, 8), (0x09, 4))
    ]
    with pytest.raises(PairVerificationError, match=r"f-number \(8 and 4\)"):
        capture_pair(FakeCamera(shots=shots), clock=clock)


def test_files_none_of_which_tells_the_exposure_are_refused(clock: Clock) -> None:
    with pytest.raises(PairVerificationError, match="cannot be checked"):
        capture_pair(FakeCamera(shots=[{"rw2": b"odd", "jpeg": b"odd"}]), clock=clock)


def test_old_photographs_on_the_card_are_left_alone(clock: Clock) -> None:
    camera = FakeCamera()
    camera.card[40] = ("jpeg", b"old")
    assert capture_pair(camera, clock=clock).flash.best == FLASH
    assert camera.card[40] == ("jpeg", b"old")
    assert sorted(camera.card) == [1, 40, 41, 42]  # the new ones stay on the card too


def test_a_late_event_does_not_end_the_wait_for_its_successor(clock: Clock) -> None:
    class Slow(FakeCamera):
        """Completes at once and brings the photograph only with the second completion."""

        pending: tuple[str, bytes] | None = None

        def trigger(self) -> None:
            self.pending = ("jpeg", self.shots.pop(0)["jpeg"])
            self.waiting = [Event(EventKind.CAPTURE_COMPLETE)]

        def events(self, timeout_s: float) -> list[Event]:
            told = super().events(timeout_s)
            if not told and timeout_s and self.pending:
                self.card[max(self.card) + 1], self.pending = self.pending, None
                told = [Event(EventKind.CAPTURE_COMPLETE)]
            return told

    pair = capture_pair(Slow(), clock=clock)
    assert (pair.no_flash.best, pair.flash.best) == (NO_FLASH, FLASH)


def test_what_was_told_before_the_release_is_of_no_account(clock: Clock) -> None:
    camera = FakeCamera(waiting=[Event(EventKind.STORE_FULL)])  # and a card changed since
    assert capture_pair(camera, clock=clock).flash.best == FLASH


def test_no_photograph_is_an_error_after_the_patience(clock: Clock) -> None:
    class Waits(FakeCamera):
        def events(self, timeout_s: float) -> list[Event]:
            clock.sleep(timeout_s)
            return []

    with pytest.raises(CaptureError, match="no photograph reached its card"):
        capture_pair(Waits(shots=[{}]), clock=clock)
    assert clock.monotonic() == pytest.approx(0.02 + 5 + 0.3)


@pytest.mark.parametrize(
    ("names", "endings"),
    [
        (["DSC_1.HIF"], ".HIF"),
        (["IMG_1.HEIC", "IMG_1.XMP", "IMG_2.HEIC"], ".HEIC, .XMP"),
        (["\x1b.\x1b[2JHIF", *(f"a.{n}" for n in range(9))], ".[2JHIF, .0, .1"),
    ],
)
def test_files_of_other_kinds_are_told_by_their_endings(
    clock: Clock, names: list[str], endings: str
) -> None:
    class Odd(FakeCamera):
        def describe(self, handle: int) -> CameraObject:
            return CameraObject(handle, "other", 9, names[handle - 2])

        def trigger(self) -> None:
            self.card |= dict.fromkeys(range(2, 2 + len(names)), ("other", b""))
            self.waiting.append(Event(EventKind.CAPTURE_COMPLETE))

        def events(self, timeout_s: float) -> list[Event]:
            clock.sleep(timeout_s)
            return super().events(timeout_s)

    with pytest.raises(CaptureError) as raised:
        capture_pair(Odd(), clock=clock)
    assert str(raised.value) == (
        f"The camera wrote its photograph as a file that cannot be used, {endings}: set the camera "
        "to RAW or JPEG and try again."
    )


def test_a_file_of_another_kind_beside_a_photograph_does_no_harm(clock: Clock) -> None:
    camera = FakeCamera(shots=[{"jpeg": NO_FLASH, "other": b""}, {"jpeg": FLASH, "other": b""}])
    assert capture_pair(camera, clock=clock).flash.files == {"jpeg": FLASH}


def test_two_photographs_of_one_kind_are_an_error(clock: Clock) -> None:
    class Bursts(FakeCamera):
        def trigger(self) -> None:
            self.card.update({7: ("jpeg", NO_FLASH), 8: ("jpeg", NO_FLASH)})
            self.waiting = [Event(EventKind.CAPTURE_COMPLETE)]

    with pytest.raises(CaptureError, match="single frames"):
        capture_pair(Bursts(), clock=clock)


def test_a_transfer_goes_on_where_it_broke_off(clock: Clock) -> None:
    long = NO_FLASH + bytes(1000)
    camera = FakeCamera([{"jpeg": long}, {"jpeg": FLASH}])
    camera.failures = 9  # more than may happen in a row, but each gained something
    pair = capture_pair(camera, clock=clock)
    assert camera.failures == 0
    assert (pair.no_flash.best, pair.flash.best) == (long, FLASH)


@pytest.mark.parametrize(("stalls", "fails"), [(3, False), (4, True)])
def test_a_transfer_that_stalls_in_a_row_is_given_up(
    clock: Clock, stalls: int, fails: bool
) -> None:
    camera = FakeCamera(stalls=stalls)
    if fails:
        with pytest.raises(TransferError, match="stalled"):
            capture_pair(camera, clock=clock)
    else:
        assert capture_pair(camera, clock=clock).no_flash.best == NO_FLASH


@pytest.mark.parametrize(
    ("size", "complaint"),
    [
        (len(NO_FLASH) + 1, f"sent {len(NO_FLASH)} of {len(NO_FLASH) + 1} bytes"),
        (len(NO_FLASH) - 1, "take the pair again"),
        (0, f"sent {len(NO_FLASH)} of 0 bytes"),
        (LARGEST_BYTES + 1, "more than one can have"),
        (0xFFFFFFFF, "4294967295 bytes"),
    ],
)
def test_a_size_that_is_not_true_is_an_error(clock: Clock, size: int, complaint: str) -> None:
    with pytest.raises(TransferError, match=complaint):
        capture_pair(FakeCamera(sizes={2: size}), clock=clock)


@pytest.mark.parametrize(
    ("shots", "complaint"),
    [
        ([{"jpeg": FLASH}, {"jpeg": FLASH}], "flash fired in the photograph that was to be"),
        ([{"jpeg": NO_FLASH}, {"jpeg": NO_FLASH}] * 2, "The flash did not fire"),
        ([{"jpeg": FLASH}, {"jpeg": NO_FLASH}], "flash fired in the photograph"),
        ([{"jpeg": NO_FLASH}, {"jpeg": photograph(9, iso=200)}], r"differ in ISO \(100 and 200\)"),
        ([{"jpeg": NO_FLASH}, {"jpeg": photograph(9, f_number=4)}], r"f-number \(8 and 4\)"),
        ([{"jpeg": NO_FLASH}, {"jpeg": photograph(9, f_number=None)}], r"\(8 and none told\)"),
        ([{"jpeg": NO_FLASH}, {"dng": FLASH}] * 2, "different kinds"),
        ([{"jpeg": b"nothing"}, {"jpeg": FLASH}], "cannot be checked"),
    ],
)
def test_photographs_that_are_no_pair_are_refused(
    clock: Clock, shots: list[dict[str, bytes]], complaint: str
) -> None:
    with pytest.raises(PairVerificationError, match=complaint):
        capture_pair(FakeCamera(shots=shots), clock=clock)
