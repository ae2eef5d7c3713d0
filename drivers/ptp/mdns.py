"""Cameras on the network that announce themselves (mDNS, DNS-SD). Source: RFC 6762, RFC 6763.

The service type is that of CIPA DC-005. Nothing but a name and an address is taken from what is
announced: anybody on the network may announce anything.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import logging
import socket
from collections.abc import Iterator

import ifaddr
from zeroconf import (
    Error,
    InterfaceChoice,
    IPVersion,
    ServiceBrowser,
    ServiceInfo,
    ServiceListener,
    Zeroconf,
)

from drivers.camera import CameraInfo
from drivers.ptp.ip import ANNOUNCED
from drivers.ptp.ip_packets import PORT

SERVICE = "_ptp._tcp.local."

MOST_CAMERAS = 100
"""So many announced ones are listed at once; no studio has more, but anybody may announce."""

_RESOLVE_MS = 1000
_LONGEST_NAME = 60
_EVERYWHERE = ("", "0.0.0.0")

log = logging.getLogger("drivers.ptp.mdns")


class _Ears(ServiceListener):
    """Keeps ANNOUNCED up to date."""

    def add_service(self, zc: Zeroconf, type_: str, name: str) -> None:
        """A camera has come."""
        info = zc.get_service_info(type_, name, _RESOLVE_MS)
        addresses = info.parsed_addresses(IPVersion.V4Only) if info else []
        if info is None or not addresses or not info.port:
            return
        port = "" if info.port == PORT else f":{info.port}"
        plain = "".join(filter(str.isprintable, name.removesuffix(f".{SERVICE}")))
        model = plain[:_LONGEST_NAME].strip()
        if name not in ANNOUNCED and len(ANNOUNCED) >= MOST_CAMERAS:
            log.info("more cameras are announced than are listed")
            return
        ANNOUNCED[name] = CameraInfo(f"ptp+ip://{addresses[0]}{port}", "", model, "", None)

    def update_service(self, zc: Zeroconf, type_: str, name: str) -> None:
        """A camera has another address."""
        self.add_service(zc, type_, name)

    def remove_service(self, zc: Zeroconf, type_: str, name: str) -> None:  # noqa: ARG002
        """A camera has gone."""
        ANNOUNCED.pop(name, None)


@functools.cache
def listen() -> bool:
    """Listen from now on, in threads of this process; false where the network does not let us."""
    try:
        network = Zeroconf(ip_version=IPVersion.V4Only)
    except (OSError, Error) as error:
        log.info("no camera on the network can be heard: %s", error)
        return False
    atexit.register(network.close)
    ServiceBrowser(network, SERVICE, _Ears())
    return True


@contextlib.contextmanager
def announced(host: str, port: int, model: str) -> Iterator[bool]:
    """Announce a camera that listens here; gives false where the network does not let us.

    host: on the network of this address alone; 0.0.0.0 stands for all of this computer's.
    """
    with contextlib.ExitStack() as stack:
        try:
            network = Zeroconf(
                interfaces=InterfaceChoice.All if host in _EVERYWHERE else _places(host),
                ip_version=IPVersion.V4Only,
            )
            stack.callback(network.close)
            network.register_service(_announcement(host, port, model), cooperating_responders=True)
            heard = True
        except (OSError, Error) as error:
            log.info("the camera is not announced: %s", error)
            heard = False
        yield heard


def _announcement(host: str, port: int, model: str) -> ServiceInfo:
    here = socket.gethostname().partition(".")[0]
    return ServiceInfo(
        SERVICE,
        f"{f'{model} simulated on {here}'[:50]} {port}.{SERVICE}",
        port=port,
        addresses=[socket.inet_aton(place) for place in _places(host)],
        server=f"simcam-{here}-{port}.local.",
    )


def _places(host: str) -> list[str]:
    """Addresses at which others reach what listens on a host."""
    if host not in _EVERYWHERE:
        return [socket.gethostbyname(host)]
    own = [ip.ip for adapter in ifaddr.get_adapters() for ip in adapter.ips if ip.is_IPv4]
    return [str(ip) for ip in own if not str(ip).startswith("127.")] or ["127.0.0.1"]
