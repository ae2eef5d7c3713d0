"""A camera that speaks the Picture Transfer Protocol, over any transport."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator

from drivers.camera import (
    Camera,
    CameraInfo,
    CameraObject,
    Event,
    EventKind,
    Setting,
    SettingName,
    SettingValue,
    kind_of_name,
    meant,
)
from drivers.clock import Clock
from drivers.contract import (
    MOST_EVENTS,
    lacking,
    not_offered,
    require_kept,
    require_size,
    require_writable,
)
from drivers.errors import (
    CameraDisconnectedError,
    CameraTimeoutError,
    ProtocolError,
    SettingError,
    StoreFullError,
    TransferError,
)
from drivers.ptp import nikon
from drivers.ptp.codes import EventCode, ObjectFormat, Operation, Property
from drivers.ptp.containers import Bytes, Container
from drivers.ptp.datasets import (
    UNKNOWN_BYTES,
    DeviceInfo,
    Form,
    ObjectInfo,
    PropertyDescription,
    StorageInfo,
)
from drivers.ptp.properties import CODECS, Codec
from drivers.ptp.session import Session
from drivers.ptp.transport import Transport
from drivers.ptp.wire import Reader, uint

CHUNK_BYTES = 1 << 20
"""Bytes asked for at first."""

LARGEST_CHUNK_BYTES = 1 << 24
"""Bytes asked for at once of a camera that is fast."""

_QUICK_S = 0.1  # a chunk that comes so soon is followed by one of twice the size
_SLOW_S = 2.0  # and one that takes longer by one of half the size

_CARD_BACK_S = 1.0  # from when a card is gone until it is there again
_CARD = 0xFFFF  # what of a storage id is 0 where a slot has no card
_LONGEST_LIST = 1000  # a range with more steps is not spelt out as choices

_KINDS: dict[int, str] = {
    ObjectFormat.EXIF_JPEG: "jpeg",
    ObjectFormat.DNG: "dng",
    ObjectFormat.ASSOCIATION: "folder",
}
_LARGEST_WHOLE = 1 << 29  # of an object that can only be had in one piece
_EVENTS: dict[int, EventKind] = {
    EventCode.OBJECT_ADDED: EventKind.OBJECT_ADDED,
    EventCode.CAPTURE_COMPLETE: EventKind.CAPTURE_COMPLETE,
    EventCode.STORE_FULL: EventKind.STORE_FULL,
    EventCode.DEVICE_PROP_CHANGED: EventKind.SETTING_CHANGED,
}


class PtpCamera(Camera):
    """A camera behind a PTP session. The session is opened on construction."""

    def __init__(self, address: str, transport: Transport, clock: Clock) -> None:
        self._address = address
        self._session = Session(transport, clock)
        try:
            self._session.open()
            self._device = DeviceInfo.decode(self._session.request(Operation.GET_DEVICE_INFO))
            self._nikon = nikon.Calls(self._session, self._device)
        except BaseException:
            self._session.close()
            raise

    @property
    def address(self) -> str:
        """The address it was opened by."""
        return self._address

    def info(self) -> CameraInfo:
        """Make, model, serial number, battery and room on the cards."""
        battery = None
        if Property.BATTERY_LEVEL in self._device.properties:
            with contextlib.suppress(SettingError):  # it may keep it to itself
                value = self._session.request(
                    Operation.GET_DEVICE_PROP_VALUE, Property.BATTERY_LEVEL
                )
                battery = Reader(value).uint(1)
        device = self._device
        return CameraInfo(
            self._address,
            device.manufacturer,
            device.model,
            device.serial,
            battery,
            self._free_bytes(),
        )

    def _free_bytes(self) -> int | None:
        """Room on all cards that tell it; None where none does."""
        if Operation.GET_STORAGE_INFO not in self._device.operations:
            return None
        told = []
        for card in self._cards():
            with contextlib.suppress(StoreFullError):  # it was taken out just now
                answer = self._session.request(Operation.GET_STORAGE_INFO, card)
                told.append(StorageInfo.decode(answer).free)
        known = [free for free in told if free != UNKNOWN_BYTES]
        return sum(known) if known or not told else None

    def settings(self) -> list[Setting]:
        """Every setting of SettingName that this camera has, and tells of as it stands now."""
        told = []
        for name in SettingName:
            with contextlib.suppress(SettingError):  # many are named, but of one mode alone
                told.append(self.read(name))
        return told

    def read(self, name: SettingName) -> Setting:
        """Read one setting. Raises SettingError where the camera has none of that name."""
        description = self._describe_property(name)
        decode = self._codec(name, description).decode
        return Setting(
            name,
            decode(description.current),
            tuple(decode(number) for number in _choices(description)),
            description.writable,
        )

    def write(self, name: SettingName, value: SettingValue) -> Setting:
        """Write one setting and read it back.

        Raises SettingError where it is missing, read-only, refused, or reads back otherwise.
        """
        description = self._describe_property(name)
        codec = self._codec(name, description)
        choices = _choices(description)
        wanted = meant(name, value, map(codec.decode, choices))
        require_writable(name, wanted, description.writable)
        try:
            number = codec.encode(wanted)
            raw = uint(number, description.width)
        except (ValueError, OverflowError, struct.error) as error:
            if choices:
                raise not_offered(name, value, map(codec.decode, choices)) from error
            raise SettingError(
                f"{value!r} is not a value that {name} can have: set it on the camera itself."
            ) from error
        if choices and number not in choices:
            raise not_offered(name, value, map(codec.decode, choices))
        self._session.request(Operation.SET_DEVICE_PROP_VALUE, codec.code, data=raw)
        setting = self.read(name)
        require_kept(codec.decode(number), setting)
        return setting

    def objects(self) -> set[int]:
        """List the handles of everything on the card, folders too."""
        try:
            return self._listed()
        except StoreFullError:  # a card may be taken up anew once a photograph is written
            self._session.clock.sleep(_CARD_BACK_S)
            return self._listed()

    def _listed(self) -> set[int]:
        # card by card, since not every responder takes the number that stands for all of them
        return {handle for card in self._cards() for handle in self._objects_in(card)}

    def _cards(self) -> list[int]:
        """Give the storages; empty slots are left out."""
        data = self._session.request(Operation.GET_STORAGE_IDS)
        return [storage for storage in Reader(data).uints(4) if storage & _CARD]

    def _objects_in(self, storage: int) -> set[int]:
        data = self._session.request(Operation.GET_OBJECT_HANDLES, storage, 0, 0)
        return set(Reader(data).uints(4))

    def describe(self, handle: int) -> CameraObject:
        """Kind, size and name of an object."""
        data = self._session.request(Operation.GET_OBJECT_INFO, handle)
        info = ObjectInfo.decode(data)
        kind = _KINDS.get(info.format) or kind_of_name(info.name)
        return CameraObject(handle, kind, info.size, info.name, f"{info.storage:#010x}")

    def delete(self, handle: int) -> None:
        """Delete an object from the card."""
        self._session.request(Operation.DELETE_OBJECT, handle)

    def check_release(self) -> None:
        """Look whether the camera offers a way to be released. Raises SettingError."""
        if not self._nikon.can_capture and (
            Operation.INITIATE_CAPTURE not in self._device.operations
        ):
            raise SettingError(
                "The camera takes no order to release over PTP: have libgphoto2 take its pairs, on "
                "USB by lightlayers capture gphoto2:// -o DIR, on a network with "
                "gphoto2://ptpip:HOST in place of gphoto2://."
            )

    def trigger(self) -> None:
        """Press the release; returns at once, the photograph comes later."""
        if self._nikon.can_capture:
            self._nikon.capture()
        else:
            self._session.request_once(Operation.INITIATE_CAPTURE, 0, 0)

    def events(self, timeout_s: float) -> list[Event]:
        """Every event waiting; if there is none, the first that comes within timeout_s seconds."""
        if self._nikon.can_tell:
            return [_event(container) for container in self._nikon.events(timeout_s)]
        events: list[Event] = []
        while len(events) < MOST_EVENTS:
            wait_s = 0 if events else timeout_s
            container = self._session.transport.receive_event(wait_s)
            if container is None:
                break
            events.append(_event(container))
        return events

    def download(
        self, handle: int, offset: int = 0, into: memoryview | None = None
    ) -> Iterator[Bytes]:
        """Chunks of an object's bytes from offset to its end.

        into: room for just the whole object, where each chunk is put in its place. Raises
        TransferError where a chunk comes incomplete: call again with the offset reached.
        """
        size = self.describe(handle).size
        require_size(size, into)
        if Operation.GET_PARTIAL_OBJECT not in self._device.operations:
            yield self._whole(handle, size, into)[offset:]
            return
        most, clock = CHUNK_BYTES, self._session.clock
        while offset < size:
            asked, wanted = clock.monotonic(), min(most, size - offset)
            room = memoryview(bytearray(wanted)) if into is None else into[offset:][:wanted]
            chunk = self._session.request(
                Operation.GET_PARTIAL_OBJECT, handle, offset, wanted, most=2 * most, into=room
            )
            if not 0 < len(chunk) <= wanted:
                raise TransferError(
                    f"The camera sent {len(chunk)} bytes where {wanted} were asked for: try again."
                )
            took_s = clock.monotonic() - asked
            if took_s < _QUICK_S:
                most = min(2 * most, LARGEST_CHUNK_BYTES)
            elif took_s > _SLOW_S:
                most = max(most // 2, CHUNK_BYTES)
            offset += len(chunk)
            yield chunk

    def _whole(self, handle: int, size: int, into: memoryview | None) -> Bytes:
        """Fetch an object of a camera that cannot send parts."""
        data = self._session.request(
            Operation.GET_OBJECT, handle, most=min(size, _LARGEST_WHOLE), into=into
        )
        if len(data) != size:
            raise TransferError(f"The camera sent {len(data)} of {size} bytes: try again.")
        return data

    def close(self) -> None:
        """Give the camera back. Closing twice is fine."""
        self._session.close()

    def _codec(self, name: SettingName, description: PropertyDescription) -> Codec:
        return nikon.codec(self._device, description) or CODECS[name]

    def _describe_property(self, name: SettingName) -> PropertyDescription:
        code = CODECS[name].code
        if code not in self._device.properties:
            raise lacking(name)
        data = self._session.request(Operation.GET_DEVICE_PROP_DESC, code)
        return PropertyDescription.decode(data)


def open_awake(address: str, connect: Callable[[], Transport], clock: Clock) -> PtpCamera:
    """Open a camera by a fresh connection, and by a second one where the first fails.

    The first may only have woken the camera, or have met the rest of an answer to a caller that was
    cut off; closing it has cleared that away.
    """
    try:
        return PtpCamera(address, connect(), clock)
    except (CameraTimeoutError, CameraDisconnectedError, ProtocolError):
        return PtpCamera(address, connect(), clock)


def _choices(description: PropertyDescription) -> tuple[int, ...]:
    if description.form is Form.RANGE:
        low, high, step = description.values
        spelt = range(low, high + 1, max(step, 1))
        return tuple(spelt) if len(spelt) <= _LONGEST_LIST else ()
    return description.values


def _event(container: Container) -> Event:
    kind = _EVENTS.get(container.code, EventKind.OTHER)
    added = kind is EventKind.OBJECT_ADDED and container.parameters
    return Event(kind, container.parameters[0] if added else None)
