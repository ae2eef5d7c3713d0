from __future__ import annotations

import ipaddress
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from service import addresses
from service.addresses import (
    ForbiddenAddressError,
    check_url,
    is_allowed,
    is_loopback,
    parse_networks,
    resolve,
)

PRIVATE = [
    "127.0.0.1", "0x7f.1", "0x7f000001", "2130706433", "017700000001", "0", "127.0.0.1.",
    "localhost", "LOCALHOST", "localhost.", "hook.localhost", "10.1.2.3", "172.16.0.1",
    "192.168.1.1", "169.254.169.254", "100.64.0.1", "192.0.0.8", "198.18.0.1", "224.0.0.1",
    "240.0.0.1", "255.255.255.255", "[::]", "[::1]", "[::ffff:10.0.0.1]", "[::ffff:7f00:1]",
    "[::7f00:1]", "[64:ff9b::a00:1]", "[2002:a00:1::]", "[2001:0:4136:e378::]", "[fc00::1]",
    "[fe80::1]", "[ff02::1]", "192.88.99.1", "[64:ff9b:1::1]", "[fec0::1]",
]  # fmt: skip
PUBLIC = ["1.1.1.1", "8.8.8.8:8443", "[2606:4700:4700::1111]", "[::ffff:8.8.8.8]", "example.org"]


@pytest.mark.parametrize("host", PRIVATE)
def test_an_address_that_is_not_public_is_refused_however_it_is_written(host: str) -> None:
    with pytest.raises(ForbiddenAddressError, match="LIGHTLAYERS_WEBHOOK_PRIVATE"):
        check_url(f"http://{host}/hook", (), False)


@pytest.mark.parametrize("host", PUBLIC)
def test_what_may_be_public_is_taken(host: str) -> None:
    check_url(f"https://{host}/hook?a=b", (), True)


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("https://user:word@example.org/", "user and password"),
        ("https://user@example.org/", "user and password"),
        ("ftp://example.org/", "https and http only"),
        ("file:///etc/passwd", "no URL"),
        ("javascript:alert(1)", "no URL"),
        ("//example.org/", "https and http only"),
        ("example.org/hook", "no URL"),
        ("", "no URL"),
        ("https://", "no URL"),
        ("https:///hook", "no URL"),
        ("https://[::1/", "no URL"),
        ("https://example.org:0/", "no URL"),
        ("https://example.org:65536/", "no URL"),
        ("https://example.org:x/", "no URL"),
        ("https://exam ple.org/", "no URL"),
        ("https://example.org/\r\nHost: a", "no URL"),
        ("https://example.org/\r\nHost:a", "no URL"),
        ("https://example.org/\t", "no URL"),
        ("https://example.org/\x7f", "no URL"),
        *((f"https://example.org/a{character}b", "no URL") for character in ' \\"<>^`{|}'),
        ("https://example.org\\@127.0.0.1/", "no URL"),
        ("https://①②⑦.0.0.1/", "as xn--"),
        ("https://bücher.example/", "as xn--…, the rest as %"),
        ("https://example.org/größe", "as xn--…, the rest as %"),
        ("https://[fe80::1%25eth0]/", "no URL"),
    ],
)
def test_what_is_no_url_to_call_is_refused_with_its_reason(url: str, why: str) -> None:
    with pytest.raises(ForbiddenAddressError, match=why) as refused:
        check_url(url, (), False)
    assert "word" not in str(refused.value).replace("password", "")


def test_http_is_refused_where_https_is_required() -> None:
    check_url("http://example.org/", (), False)
    with pytest.raises(ForbiddenAddressError, match="calls https only"):
        check_url("http://example.org/", (), True)


@pytest.mark.parametrize(
    ("setting", "allowed", "refused"),
    [
        ("false", [], ["10.0.0.1", "::1"]),
        ("", [], ["10.0.0.1", "::1"]),
        ("true", ["10.0.0.1", "127.0.0.1", "::1", "fe80::1"], []),
        ("True", ["10.0.0.1"], []),
        ("10.0.0.0/8, fd00::/8", ["10.0.0.1", "fd12::1"], ["127.0.0.1", "fc00::1"]),
        ("10.0.0.0/8", ["::ffff:10.0.0.1"], ["::ffff:127.0.0.1"]),
        ("192.168.1.7", ["192.168.1.7"], ["192.168.1.8"]),
    ],
)  # fmt: skip
def test_private_networks_are_allowed_by_a_setting(
    setting: str, allowed: list[str], refused: list[str]
) -> None:
    networks = parse_networks(setting)
    for text in allowed:
        assert is_allowed(ipaddress.ip_address(text), networks)
    for text in refused:
        assert not is_allowed(ipaddress.ip_address(text), networks)


@pytest.mark.parametrize("text", ["yes", "10.0.0.0/33", "10.0.0.0/8,", "example.org"])
def test_what_is_no_network_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_networks(text)


def _names(monkeypatch: pytest.MonkeyPatch, *addresses: str) -> None:
    def look_up(_host: str, port: int, **_rest: Any) -> list[Any]:
        return [(0, 0, 0, "", (address, port)) for address in addresses]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)


def test_a_name_gives_all_its_addresses_once(monkeypatch: pytest.MonkeyPatch) -> None:
    _names(monkeypatch, "8.8.8.8", "2606:4700:4700::1111", "8.8.8.8")
    assert resolve("example.org", 443, (), 60) == ["8.8.8.8", "2606:4700:4700::1111"]


def test_a_name_with_one_private_address_among_others_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _names(monkeypatch, "8.8.8.8", "10.0.0.1")
    with pytest.raises(ForbiddenAddressError):
        resolve("example.org", 443, (), 60)
    assert resolve("example.org", 443, parse_networks("10.0.0.0/8"), 60) == ["8.8.8.8", "10.0.0.1"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("localhost", True),
        ("photos.localhost", True),
        ("127.0.0.1", True),
        ("127.9.9.9", True),
        ("::1", True),
        ("[::1]", True),
        ("192.168.1.7", False),
        ("0.0.0.0", False),
        ("evil.example", False),
        ("evillocalhost", False),
        ("localhost.evil.example", False),
        ("127.0.0.1.evil.example", False),
        ("", False),
    ],
)
def test_only_names_of_this_machine_are_loopback(name: str, expected: bool) -> None:
    assert is_loopback(name) is expected


def test_a_name_that_is_looked_up_for_too_long_holds_nobody_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    over = threading.Event()
    asked: list[str] = []

    def look_up(host: str, port: int, **_rest: Any) -> list[Any]:
        asked.append(host)
        if host == "slow.example":
            over.wait(60)
        return [(0, 0, 0, "", ("8.8.8.8", port))]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    with ThreadPoolExecutor(2) as lookups:
        monkeypatch.setattr(addresses, "_LOOKUPS", lookups)
        with pytest.raises(TimeoutError):
            resolve("slow.example", 443, (), 0.05)
        assert resolve("example.org", 443, (), 60) == ["8.8.8.8"]
        with pytest.raises(TimeoutError):
            resolve("slow.example", 443, (), 0.05)
        with pytest.raises(TimeoutError):  # no thread is left, and no further one is made
            resolve("late.example", 443, (), 0.05)
        over.set()
    assert asked == ["slow.example", "example.org", "slow.example"]


def test_a_name_that_is_not_known_is_no_want_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_arguments: object, **_rest: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "unknown")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(socket.gaierror):
        resolve("example.org", 443, (), 60)
