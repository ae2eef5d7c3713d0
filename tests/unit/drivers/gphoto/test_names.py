from __future__ import annotations

import errno
import os
import tomllib
from pathlib import Path

import pytest

from drivers.camera import SettingName, SettingValue
from drivers.errors import BadAddressError, CameraDisconnectedError, MissingPackageError
from drivers.gphoto.backend import check_address, open_camera
from drivers.gphoto.names import WIDGETS, decode


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        (SettingName.SHUTTER_S, "1/50", 0.02),
        (SettingName.SHUTTER_S, "0.0200s", 0.02),
        (SettingName.SHUTTER_S, "30", 30),
        (SettingName.SHUTTER_S, "Bulb", "Bulb"),
        (SettingName.SHUTTER_S, "1/0", "1/0"),
        (SettingName.SHUTTER_S, "1/0.00", "1/0.00"),
        (SettingName.SHUTTER_S, "1/2.5", 0.4),
        (SettingName.SHUTTER_S, "1/1.3", 0.769231),
        (SettingName.SHUTTER_S, "10/13", 0.769231),
        (SettingName.SHUTTER_S, "25/10", 2.5),
        (SettingName.F_NUMBER, "f/5.6", 5.6),
        (SettingName.F_NUMBER, "8", 8),
        (SettingName.ISO, "400", 400),
        (SettingName.ISO, "Auto", "auto"),
        (SettingName.FLASH, "Flash off", "off"),
        (SettingName.FLASH, "Fill flash", "fill"),
        (SettingName.FLASH, "Slow Sync", "Slow Sync"),
        (SettingName.PROGRAM, "M", "manual"),
        (SettingName.PROGRAM, "Av", "aperture"),
        (SettingName.WHITE_BALANCE, "Automatic", "auto"),
        (SettingName.DRIVE, "Single Shot", "single"),
        (SettingName.FOCUS, "Manual", "manual"),
        (SettingName.FORMAT, "NEF (Raw)", "raw"),
        (SettingName.FORMAT, "RAW", "raw"),
        (SettingName.FORMAT, "JPEG Basic", "jpeg_basic"),
        (SettingName.FORMAT, "JPEG Normal", "jpeg_normal"),
        (SettingName.FORMAT, "JPEG Fine", "jpeg_fine"),
        (SettingName.FORMAT, "Large Fine JPEG", "jpeg_fine"),
        (SettingName.FORMAT, "NEF+Basic", "raw+jpeg_basic"),
        (SettingName.FORMAT, "NEF+Normal", "raw+jpeg_normal"),
        (SettingName.FORMAT, "NEF+Fine", "raw+jpeg_fine"),
        (SettingName.FORMAT, "RAW+JPEG", "raw+jpeg"),
        (SettingName.FORMAT, "RAW + JPEG", "raw+jpeg"),
        (SettingName.FORMAT, "RAW + Large Fine JPEG", "raw+jpeg_fine"),
        (SettingName.FORMAT, "cRAW", "cRAW"),
        (SettingName.FORMAT, "\x1b]0;mine\x07cRAW", "]0;minecRAW"),
    ],
)
def test_texts_of_libgphoto2_become_values(
    name: SettingName, text: str, value: SettingValue
) -> None:
    found = decode(name, text)
    assert (found, type(found)) == (value, type(value))


def test_every_setting_has_a_name_there() -> None:
    assert set(WIDGETS) == set(SettingName)


@pytest.mark.parametrize("address", ["gphoto2://", "gphoto2://usb:001,004", "gphoto2://ptpip:h"])
def test_ports_of_cameras_are_taken(address: str) -> None:
    check_address(address)


@pytest.mark.parametrize("address", ["gphoto2://disk:/etc", "gphoto2://serial:/dev/ttyS0"])
def test_ports_that_are_files_of_this_computer_are_refused(address: str) -> None:
    with pytest.raises(BadAddressError, match="no camera that libgphoto2 may open"):
        check_address(address)


def test_what_a_missing_package_is_installed_by_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(MissingPackageError) as refusal:
        open_camera("gphoto2://")
    project = tomllib.loads((Path(__file__).parents[4] / "pyproject.toml").read_text())["project"]
    (extra,) = project["optional-dependencies"]["gphoto2"]
    assert str(refusal.value) == (
        "The Python package gphoto2 is missing here: install it by make setup in the folder of "
        f"lightlayers, or by python -m pip install '{extra}' with the Python that lightlayers runs "
        "in."
    )


@pytest.mark.parametrize(
    ("number", "reason"),
    [
        (errno.EAGAIN, "resource temporarily unavailable"),
        (errno.ENOMEM, "cannot allocate memory"),
        (errno.ENOENT, "no such file or directory"),
    ],
)
def test_a_process_that_cannot_be_started_is_told(
    number: int, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object, **_named: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("importlib.util.find_spec", lambda _name: True)
    monkeypatch.setattr("subprocess.Popen", refuse)
    with pytest.raises(CameraDisconnectedError) as refusal:
        open_camera("gphoto2://")
    assert str(refusal.value) == (
        f"The process that libgphoto2 works in cannot be started here ({reason}): mend that, or "
        "end other programs if the computer has no room for it, and try again."
    )
