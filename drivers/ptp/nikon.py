"""What is Nikon's own: capture to the card, readiness, events to be asked for, file formats.

Codes as observed in libgphoto2. The calls that capture into the camera's memory (0x90C0, 0x90CB)
are left alone: their photographs never reach the card.
"""

from __future__ import annotations

from drivers.errors import ProtocolError
from drivers.ptp.codes import NIKON, ContainerType, Operation, Property
from drivers.ptp.containers import Container
from drivers.ptp.datasets import DeviceInfo, Form, PropertyDescription
from drivers.ptp.properties import Codec
from drivers.ptp.session import Session
from drivers.ptp.wire import Reader

# parameters of a release: as it is focused, and onto the card
_NO_FOCUSING = 0xFFFFFFFF
_TO_CARD = 0
_POLL_S = 0.1
_MOST_EVENTS = 1000  # in an answer: more is no list of events

_JPEGS = {0: "jpeg_basic", 1: "jpeg_normal", 2: "jpeg_fine"}
_FORMATS = Codec(
    Property.COMPRESSION_SETTING,
    names={
        **_JPEGS,
        3: "raw",
        4: "raw+jpeg_basic",
        5: "raw+jpeg_normal",
        6: "raw+jpeg_fine",
    },
)
_OLDER_FORMATS = Codec(
    Property.COMPRESSION_SETTING, names={**_JPEGS, 4: "raw", 5: "raw+jpeg_basic"}
)


def codec(device: DeviceInfo, description: PropertyDescription) -> Codec | None:
    """Give the codec of a setting whose numbers are Nikon's own; None for any other.

    Newer bodies offer more formats and number them otherwise, so that theirs have no names.
    """
    if description.code != Property.COMPRESSION_SETTING or not _is_made_by_nikon(device):
        return None
    offered = set(description.values) if description.form is Form.ENUMERATION else set()
    if not offered:
        return None
    if 3 not in offered:  # the older ones have none; JPEGs have the same numbers in both
        return _OLDER_FORMATS if offered <= _OLDER_FORMATS.names.keys() else None
    return _FORMATS if offered <= _FORMATS.names.keys() else None


def _is_made_by_nikon(device: DeviceInfo) -> bool:
    return device.manufacturer.lower().startswith("nikon")


class Calls:
    """What a camera offers of these calls, and how they are made."""

    def __init__(self, session: Session, device: DeviceInfo) -> None:
        # many of Nikon's bodies name another extension: that of MTP, or none there is
        ours = device.vendor == NIKON or _is_made_by_nikon(device)
        offered = device.operations if ours else ()
        self.can_capture = Operation.NIKON_CAPTURE_TO_CARD in offered
        self.can_tell = Operation.NIKON_GET_EVENTS in offered
        self._can_ready = Operation.NIKON_DEVICE_READY in offered
        self._session = session

    def capture(self) -> None:
        """Press the release, without focusing."""
        self._session.request_once(Operation.NIKON_CAPTURE_TO_CARD, _NO_FOCUSING, _TO_CARD)

    def events(self, timeout_s: float) -> list[Container]:
        """Ask for events until there are some, at most for timeout_s seconds."""
        clock = self._session.clock
        deadline = clock.monotonic() + timeout_s
        while True:
            busy = self._can_ready and self._session.is_busy(Operation.NIKON_DEVICE_READY)
            told = [] if busy else self._ask()
            left = deadline - clock.monotonic()
            if told or left <= 0:
                return told
            clock.sleep(min(_POLL_S, left))

    def _ask(self) -> list[Container]:
        data = self._session.request(Operation.NIKON_GET_EVENTS)
        reader = Reader(data)
        count = reader.uint(2)
        if count > _MOST_EVENTS:
            raise ProtocolError(f"The camera tells of {count} events at once")
        return [
            Container.with_parameters(ContainerType.EVENT, reader.uint(2), 0, (reader.uint(4),))
            for _ in range(count)
        ]
