from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, cast

import pytest
from zeroconf import NotRunningException, ServiceInfo, Zeroconf

from drivers.camera import CameraInfo
from drivers.ptp import ip, mdns

NAME = f"Studio camera.{mdns.SERVICE}"


@pytest.fixture
def announced(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, CameraInfo]]:
    found: dict[str, CameraInfo] = {}
    monkeypatch.setattr(ip, "ANNOUNCED", found)
    monkeypatch.setattr(mdns, "ANNOUNCED", found)
    yield found


def network(info: ServiceInfo | None) -> Zeroconf:
    return cast(Zeroconf, SimpleNamespace(get_service_info=lambda *_: info))


def service(name: str, *places: str, port: int = 15740) -> ServiceInfo:
    addresses = [
        socket.inet_pton(socket.AF_INET6 if ":" in p else socket.AF_INET, p) for p in places
    ]
    return ServiceInfo(mdns.SERVICE, name, port=port, addresses=addresses, server="camera.local.")


@pytest.mark.parametrize(
    ("port", "address"), [(15740, "ptp+ip://192.0.2.7"), (15741, "ptp+ip://192.0.2.7:15741")]
)
def test_an_announced_camera_is_listed_until_it_goes(
    announced: dict[str, CameraInfo], port: int, address: str
) -> None:
    ears, there = mdns._Ears(), network(service(NAME, "192.0.2.7", port=port))
    ears.add_service(there, mdns.SERVICE, NAME)
    assert ip.list_cameras() == [CameraInfo(address, "", "Studio camera", "", None)]
    ears.update_service(network(service(NAME, "192.0.2.8")), mdns.SERVICE, NAME)
    assert [camera.address for camera in ip.list_cameras()] == ["ptp+ip://192.0.2.8"]
    ears.remove_service(there, mdns.SERVICE, NAME)
    ears.remove_service(there, mdns.SERVICE, NAME)
    assert announced == {}


def test_cameras_are_listed_by_address(announced: dict[str, CameraInfo]) -> None:
    for place in ("192.0.2.9", "192.0.2.1", "192.0.2.5"):
        name = f"{place}.{mdns.SERVICE}"
        mdns._Ears().add_service(network(service(name, place)), mdns.SERVICE, name)
    assert list(announced) != sorted(announced)
    assert [camera.model for camera in ip.list_cameras()] == ["192.0.2.1", "192.0.2.5", "192.0.2.9"]


def test_no_more_cameras_are_listed_than_a_studio_has(announced: dict[str, CameraInfo]) -> None:
    names = [f"{number}.{mdns.SERVICE}" for number in range(mdns.MOST_CAMERAS + 1)]
    for name in names:
        mdns._Ears().add_service(network(service(name, "192.0.2.7")), mdns.SERVICE, name)
    assert list(announced) == names[:-1]
    first = names[0]
    mdns._Ears().update_service(network(service(first, "192.0.2.9")), mdns.SERVICE, first)
    assert announced[first].address == "ptp+ip://192.0.2.9"
    mdns._Ears().remove_service(network(None), mdns.SERVICE, first)
    mdns._Ears().add_service(network(service(names[-1], "192.0.2.7")), mdns.SERVICE, names[-1])
    assert list(announced) == names[1:]


@pytest.mark.parametrize(
    "info",
    [None, service(NAME), service(NAME, "fe80::1"), service(NAME, "192.0.2.7", port=0)],
    ids=["no answer", "no address", "IPv6 alone", "no port"],
)
def test_what_says_not_where_it_is_is_not_listed(
    announced: dict[str, CameraInfo], info: ServiceInfo | None
) -> None:
    mdns._Ears().add_service(network(info), mdns.SERVICE, NAME)
    assert announced == {}


def test_names_are_plain_and_short(announced: dict[str, CameraInfo]) -> None:
    name = f"\x1b[31mred\n{'x' * 99}.{mdns.SERVICE}"
    mdns._Ears().add_service(network(service(NAME, "192.0.2.7")), mdns.SERVICE, name)
    assert announced[name].model == f"[31mred{'x' * 53}"


@pytest.mark.parametrize("error", [OSError("no multicast"), NotRunningException()])
def test_a_network_that_lets_nobody_listen_or_announce_is_no_failure(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def refused(**_: Any) -> None:
        raise error

    monkeypatch.setattr(mdns, "Zeroconf", refused)
    listen: Callable[[], bool] = mdns.listen.__wrapped__
    assert listen() is False
    with mdns.announced("127.0.0.1", 15740, "NIKON") as told:
        assert told is False


def test_what_goes_wrong_while_it_is_announced_is_not_swallowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    closed = []

    class Network:
        def __init__(self, **asked: object) -> None:
            assert asked["interfaces"] == ["127.0.0.1"]

        def register_service(self, info: ServiceInfo, **_: object) -> None:
            assert info.parsed_addresses() == ["127.0.0.1"]

        def close(self) -> None:
            closed.append(True)

    monkeypatch.setattr(mdns, "Zeroconf", Network)
    with pytest.raises(OSError, match="disk"), mdns.announced("localhost", 1, "x"):
        raise OSError("disk")
    assert closed == [True]


def test_everywhere_means_the_addresses_that_others_reach() -> None:
    places = mdns._places("0.0.0.0")
    assert places
    assert places == ["127.0.0.1"] or not any(place.startswith("127.") for place in places)
