from __future__ import annotations

import pytest

import drivers


@pytest.mark.parametrize("address", ["", "studio", "sim:studio", "usb://1", "SIM://studio"])
def test_addresses_of_no_backend_are_refused(address: str) -> None:
    with pytest.raises(drivers.BadAddressError, match="must start with sim://"):
        drivers.open_camera(address)
    with pytest.raises(drivers.BadAddressError, match="must start with sim://"):
        drivers.check_address(address)


def test_an_address_is_checked_by_its_backend() -> None:
    drivers.check_address("sim://studio?lights=3")
    with pytest.raises(drivers.BadAddressError, match="no parameter 'lamps'"):
        drivers.check_address("sim://studio?lamps=3")


@pytest.mark.parametrize(
    ("address", "one"),
    [
        ("sim://studio?lights=3", True),
        ("ptp+ip://192.168.1.20", True),
        ("ptp+usb://0000001", True),
        ("gphoto2://usb:001,004", True),
        ("sim://", False),
        ("ptp+ip://", False),
        ("ptp+usb://", False),
        ("gphoto2://usb", False),
        ("gphoto2://disk:/etc", False),
        ("sim://studio?lamps=3", False),
        ("studio", False),
    ],
)
def test_whole_addresses_are_told_from_beginnings(address: str, one: bool) -> None:
    assert drivers.names_one_camera(address) is one


def test_the_light_of_real_cameras_is_not_known() -> None:
    with pytest.raises(drivers.CameraNotFoundError, match=r"no simulated camera at ptp\+usb://1-2"):
        drivers.simulated_truth("ptp+usb://1-2")


def test_the_simulated_camera_is_listed() -> None:
    assert drivers.list_cameras() == [
        drivers.CameraInfo(
            "sim://studio", "NIKON CORPORATION", "NIKON D5100", "0000001", 87, 2 * 10**9
        )
    ]


@pytest.mark.parametrize(("listens", "waits_s"), [(True, [1.5]), (False, [])])
def test_cameras_on_the_network_have_time_to_answer_where_it_lets_anybody_listen(
    monkeypatch: pytest.MonkeyPatch, listens: bool, waits_s: list[float]
) -> None:
    slept: list[float] = []
    monkeypatch.setattr("drivers.ptp.mdns.listen", lambda: listens)
    monkeypatch.setattr("drivers.clock.SystemClock.sleep", lambda _, seconds: slept.append(seconds))
    drivers.listen_to_network()
    assert slept == waits_s
