import pytest

from drivers import contract
from drivers.camera import Setting, SettingName, SettingValue
from drivers.errors import SettingError, TransferError


def test_a_setting_of_a_dial_is_not_written() -> None:
    contract.require_writable(SettingName.ISO, 200, True)
    with pytest.raises(SettingError, match=r"iso cannot be set from a computer: set it to 200 on"):
        contract.require_writable(SettingName.ISO, 200, False)


def test_a_setting_reads_back_as_it_was_told() -> None:
    contract.require_kept(200, Setting(SettingName.ISO, 200, (), True))
    with pytest.raises(SettingError, match=r"told to set iso to 200 but kept 100: check"):
        contract.require_kept(200, Setting(SettingName.ISO, 100, (), True))


@pytest.mark.parametrize(("told", "kept"), [(1 / 60, 0.0166), (0.0167, 0.0166), (1 / 640, 0.0015)])
def test_a_time_may_read_back_as_cameras_round_it(told: float, kept: float) -> None:
    contract.require_kept(told, Setting(SettingName.SHUTTER_S, kept, (), True))
    with pytest.raises(SettingError, match="told to set shutter_s to"):
        contract.require_kept(told, Setting(SettingName.SHUTTER_S, 0.8 * kept, (), True))


def test_a_file_has_the_size_that_there_is_room_for() -> None:
    contract.require_size(3, None)
    contract.require_size(3, memoryview(bytearray(3)))
    with pytest.raises(TransferError, match=r"says 3 bytes where it said 2 before"):
        contract.require_size(3, memoryview(bytearray(2)))


def test_what_a_camera_lacks_is_named() -> None:
    assert str(contract.lacking(SettingName.DRIVE)) == (
        "The camera has no setting drive: set it on the camera itself."
    )
    assert str(contract.not_offered(SettingName.ISO, 3, (100, "auto"))) == (
        "The camera offers no iso of 3; it offers 100, auto."
    )


@pytest.mark.parametrize(
    ("value", "near"),
    [
        (123.5, "122, 123, 124, 125"),
        (99, "100, 101"),
        (5000, "999, 1000"),
        (10**400, "999, 1000"),
        ("fast", "auto, 100, 101, 102"),
    ],
)
def test_of_a_long_list_those_near_what_was_asked_for_are_said(
    value: SettingValue, near: str
) -> None:
    offered = ("auto", *range(100, 1001))
    assert str(contract.not_offered(SettingName.ISO, value, offered)).endswith(
        f"; it offers 902 values from auto to 1000, like {near}."
    )


def test_a_list_without_numbers_may_be_long_as_well() -> None:
    offered = [f"mode {number}" for number in range(1, 32)]
    assert str(contract.not_offered(SettingName.PROGRAM, 3, offered)).endswith(
        "it offers 31 values from mode 1 to mode 31, like mode 1, mode 2, mode 3, mode 4."
    )
    assert str(contract.not_offered(SettingName.PROGRAM, 3, offered[:30])).count("mode ") == 30
