"""Which network addresses are this machine alone, and which the service may call for a user.

A webhook's URL comes from outside: without these checks it could name the operator's own machines.
"""

from __future__ import annotations

import ipaddress
import socket
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Networks = tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, ...]

_NAT64 = ipaddress.ip_network("64:ff9b::/96")
_SPECIAL = [  # that Pythons of some versions take for public
    ipaddress.ip_network(text)
    for text in ("192.0.0.0/24", "192.88.99.0/24", "64:ff9b:1::/48", "fec0::/10")
]
_REFUSAL = (
    "this service calls no addresses of private networks; its operator may allow some with "
    "LIGHTLAYERS_WEBHOOK_PRIVATE"
)


_LOOKUPS = ThreadPoolExecutor(32, "lookup")
"""Threads that look names up: the system sets no limit to it that we could choose."""


class ForbiddenAddressError(Exception):
    """An address that the service does not call. The message says why, without a full stop."""


def parse_networks(text: str) -> Networks:
    """Read "false" (none), "true" (all) or networks like "10.0.0.0/8,fd00::/8".

    Raises ValueError.
    """
    word = text.strip().lower()
    if word in ("false", ""):
        return ()
    listed = "0.0.0.0/0,::/0" if word == "true" else word
    return tuple(ipaddress.ip_network(part.strip(), strict=False) for part in listed.split(","))


def is_loopback(name: str) -> bool:
    """Whether a name or address without port means this machine alone."""
    try:
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    except ValueError:
        return name == "localhost" or name.endswith(".localhost")


def is_allowed(address: Address, private: Networks) -> bool:
    """Whether an address is one of the public internet, or of the private networks allowed."""
    inner = _embedded(address)
    if inner is not None:
        return is_allowed(inner, private)
    if any(address in network for network in private):
        return True
    if any(address in network for network in _SPECIAL):
        return False
    return address.is_global and not (address.is_multicast or address.is_reserved)


def _embedded(address: Address) -> ipaddress.IPv4Address | None:
    """Find the IPv4 address that an IPv6 address stands for."""
    if isinstance(address, ipaddress.IPv4Address):
        return None
    if address in _NAT64:
        return ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)
    return address.ipv4_mapped or address.sixtofour


def check_url(url: str, private: Networks, https_only: bool) -> None:
    """Refuse a URL that the look of it forbids; names are resolved when they are called.

    Raises ForbiddenAddressError.
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not url.isascii():
        raise ForbiddenAddressError(
            "write other letters than those of ASCII as in requests: those of the host as xn--…, "
            "the rest as %…"
        )
    plain = url.isprintable() and not set(url) & set(' \\"<>^`{|}')
    if not host or "%" in host or port == 0 or not plain:
        raise ForbiddenAddressError("this is no URL; write one like https://example.org/hook")
    if parts.scheme not in (("https",) if https_only else ("https", "http")):
        wanted = "https" if https_only else "https and http"
        raise ForbiddenAddressError(f"this service calls {wanted} only")
    if "@" in parts.netloc:
        raise ForbiddenAddressError("leave user and password out; the signature says who calls")
    address = _literal(host)
    if address and not is_allowed(address, private):
        raise ForbiddenAddressError(_REFUSAL)


def _literal(host: str) -> Address | None:
    """Read a host that is an address already, however written: 0x7f.1 and 2130706433, too."""
    host = host.rstrip(".")
    if host == "localhost" or host.endswith(".localhost"):
        return ipaddress.IPv4Address("127.0.0.1")
    try:
        found = socket.getaddrinfo(host, None, flags=socket.AI_NUMERICHOST)
        return ipaddress.ip_address(str(found[0][4][0]))
    except (OSError, ValueError):
        return None


def resolve(host: str, port: int, private: Networks, seconds: float) -> list[str]:
    """Look a host up, for so many seconds at most; its addresses, which are all allowed.

    Raises ForbiddenAddressError, TimeoutError, and OSError or UnicodeError when the name is not
    known.
    """
    looked_up = _LOOKUPS.submit(socket.getaddrinfo, host, port, type=socket.SOCK_STREAM)
    try:
        found = looked_up.result(seconds)
    finally:
        looked_up.cancel()  # where it still waits for a thread; one that has begun goes on
    addresses = list(dict.fromkeys(str(entry[4][0]) for entry in found))
    if not all(is_allowed(ipaddress.ip_address(address), private) for address in addresses):
        raise ForbiddenAddressError(_REFUSAL)
    return addresses
