from __future__ import annotations

import pytest

from drivers.errors import BadAddressError, CameraNotFoundError
from drivers.sim.address import SimulatedCamera, parse


def test_a_bare_address_takes_the_defaults() -> None:
    expected = SimulatedCamera(lights=2, width=1200, height=800, seed=1, format="dng")
    assert parse("sim://studio") == parse("sim://studio/") == parse("sim://studio?") == expected
    assert (expected.noise, expected.scene, expected.fault) == ("on", "studio", "none")


def test_every_parameter_is_read() -> None:
    address = (
        "sim://studio?lights=3&width=64&height=6000&seed=4294967295&format=both&noise=off"
        "&scene=objects&fault=unplug"
    )
    assert parse(address) == SimulatedCamera(
        lights=3,
        width=64,
        height=6000,
        seed=2**32 - 1,
        format="both",
        noise="off",
        scene="objects",
        fault="unplug",
    )


@pytest.mark.parametrize(
    ("query", "complaint"),
    [
        ("lights=0", "cannot take lights=0: input should be greater than or equal to 1"),
        ("lights=4", "cannot take lights=4: input should be less than or equal to 3"),
        ("lights=two", "cannot take lights=two: input should be a valid integer"),
        ("lights=", "cannot take lights=: input should be a valid integer"),
        ("lights=2.5", "cannot take lights=2.5"),
        ("width=62", "cannot take width=62"),
        ("width=65", "cannot take width=65: input should be a multiple of 2"),
        ("height=6002", "cannot take height=6002"),
        ("seed=-1", "cannot take seed=-1"),
        ("format=tiff", "input should be 'dng', 'jpeg' or 'both'"),
        ("noise=loud", "input should be 'on' or 'off'"),
        ("scene=../objects", "input should be 'studio', 'objects', 'chart'"),
        ("fault=fire", "cannot take fault=fire: input should be 'none', 'busy_briefly'"),
        ("lamps=2", "has no parameter 'lamps'; it has lights, width"),
        ("lights", "cannot be read: write"),
        ("lights=1&lights=2", "says lights more than once"),
    ],
)
def test_parameters_that_do_not_exist_are_refused(query: str, complaint: str) -> None:
    with pytest.raises(BadAddressError, match=complaint):
        parse(f"sim://studio?{query}")


@pytest.mark.parametrize(
    "address", ["sim://", "sim://garden", "sim://studio/back", "sim://[studio", "sim://studio#x"]
)
def test_other_places_hold_no_camera(address: str) -> None:
    with pytest.raises(CameraNotFoundError, match="the only one is sim://studio"):
        parse(address)
