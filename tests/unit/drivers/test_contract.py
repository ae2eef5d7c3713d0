import pytest

from drivers import contract
from drivers.camera import Setting, SettingName
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
