"""Addresses of cameras and what stands behind them.

scheme://…   backend
sim          drivers.sim, a simulated camera: sim://studio?lights=2&width=1200&height=800
ptp+usb      drivers.ptp.usb, a camera on USB: ptp+usb://serial
ptp+ip       drivers.ptp.ip, a camera on the network: ptp+ip://host or ptp+ip://host:port
gphoto2      drivers.gphoto.backend, any camera that libgphoto2 knows: gphoto2://usb:001,004
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from importlib import import_module
from typing import Protocol, cast

from drivers.camera import Camera, CameraInfo
from drivers.clock import SystemClock
from drivers.errors import BadAddressError, DriverError
from drivers.truth import SimulatedTruth

_BACKENDS = {
    "sim": "drivers.sim.backend",
    "ptp+usb": "drivers.ptp.usb",
    "ptp+ip": "drivers.ptp.ip",
    "gphoto2": "drivers.gphoto.backend",
}

SCHEMES = tuple(_BACKENDS)
"""What addresses of cameras begin with, before ://."""

_HEAR_S = 1.5  # so long cameras on the network may take to answer


class Backend(Protocol):
    """What the module of a backend offers; imported when its first address is met."""

    def open_camera(self, address: str) -> Camera:
        """Open the camera at the address."""

    def check_address(self, address: str) -> None:
        """Raise BadAddressError or CameraNotFoundError where no camera could ever be."""

    def list_cameras(self) -> list[CameraInfo]:
        """Cameras that can be opened now."""


class SimulatedResponder(Protocol):
    """A simulated camera that is served. address: host:port."""

    address: str
    model: str

    def order(self, line: str) -> None:
        """Do as "fault NAME" or "flash mode|off|external" says. Raises BadAddressError."""

    def close(self) -> None:
        """Serve no longer."""


def open_camera(address: str) -> Camera:
    """Open the camera at an address; close it, or use it as a context manager.

    Raises BadAddressError, CameraNotFoundError, CameraBusyError.
    """
    return _load(_scheme(address)).open_camera(address)


def check_address(address: str) -> None:
    """Refuse, without opening anything, an address at which no camera could ever be.

    Raises BadAddressError, CameraNotFoundError.
    """
    _load(_scheme(address)).check_address(address)


def names_one_camera(address: str) -> bool:
    """Whether this is a camera's whole address, and not the beginning of several."""
    scheme, _, rest = address.partition("://")
    if not rest or (scheme == "gphoto2" and ":" not in rest):  # gphoto2://usb
        return False
    try:
        check_address(address)
    except DriverError:
        return False
    return True


def canonical_address(address: str) -> str:
    """Give the one spelling of an address.

    A camera may have several addresses all the same: ptp+usb:// leads to whichever is on USB.
    Raises BadAddressError, CameraNotFoundError.
    """
    check_address(address)
    if _scheme(address) == "ptp+ip":
        from drivers.ptp.ip import parse
        from drivers.ptp.ip_packets import PORT

        host, port = parse(address)
        named = f"[{host}]" if ":" in host else host
        return f"ptp+ip://{named}" + ("" if port == PORT else f":{port}")
    place, mark, query = address.partition("?")
    scheme, _, rest = place.partition("://")
    return f"{scheme}://{rest.rstrip('/')}{mark}{query}"


def list_cameras() -> list[CameraInfo]:
    """Every camera that can be opened now, of every backend; looks without waiting.

    Those on the network are among them after listen_to_network.
    """
    return [info for scheme in _BACKENDS for info in _load(scheme).list_cameras()]


def listen_to_network() -> None:
    """From now on, take notice of cameras that announce themselves (mDNS).

    Returns once those that are there have had time to answer. Where the network lets nobody
    listen, nothing is heard.
    """
    from drivers.ptp import mdns

    if mdns.listen():
        SystemClock().sleep(_HEAR_S)


def announce_simulated(responder: SimulatedResponder) -> AbstractContextManager[bool]:
    """Announce a simulated camera that is served (mDNS); gives false where that cannot be."""
    from drivers.ptp import mdns

    host, _, port = responder.address.rpartition(":")
    return mdns.announced(host, int(port), responder.model)


def serve_simulated(address: str, host: str, port: int) -> SimulatedResponder:
    """Serve the simulated camera at an address by PTP/IP, as a camera on the network would.

    host, port: where to listen; port 0 takes any. Raises BadAddressError, CameraNotFoundError.
    """
    from drivers.sim.address import parse
    from drivers.sim.body import Body
    from drivers.sim.ip_responder import IpResponder

    return IpResponder(Body(parse(address), SystemClock()), host, port)


def simulated_truth(address: str) -> SimulatedTruth:
    """Tell the exact light of a simulated scene, for the demo and for tests.

    Raises BadAddressError, and CameraNotFoundError where there is no simulated camera.
    """
    from drivers.sim.studio import truth

    return truth(address)


def _scheme(address: str) -> str:
    scheme, separator, _ = address.partition("://")
    if not separator or scheme not in _BACKENDS:
        known = ", ".join(f"{name}://" for name in _BACKENDS)
        raise BadAddressError(f"{address!r} is no camera address: it must start with {known}.")
    return scheme


def _load(scheme: str) -> Backend:
    return cast(Backend, import_module(_BACKENDS[scheme]))
