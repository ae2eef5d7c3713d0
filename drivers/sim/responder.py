"""The simulated camera's end of the protocol: containers in, containers out. Source: ISO 15740."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

from drivers.ptp import containers
from drivers.ptp.codes import (
    ALL_STORAGES,
    ContainerType,
    EventCode,
    ObjectFormat,
    Operation,
    Response,
)
from drivers.ptp.containers import Bytes, Container
from drivers.ptp.datasets import DeviceInfo, StorageInfo
from drivers.ptp.wire import uint, uints
from drivers.sim.body import (
    CARD_BYTES,
    FOLDER,
    PHOTOGRAPH_BYTES,
    STORAGE,
    Body,
    Refusal,
    StoredObject,
)

_VENDOR = 0x9000  # from here on operations are of makers
_LAST_TRANSACTION = 0xFFFFFFFE  # read from the standard anew, so that it checks the driver
_ROOT = 0xFFFFFFFF  # as parent in GetObjectHandles: the objects outside every folder
_WITHOUT_SESSION = (Operation.GET_DEVICE_INFO, Operation.OPEN_SESSION)

RELEASES = (Operation.INITIATE_CAPTURE, Operation.NIKON_CAPTURE_TO_CARD)
"""Operations that take a photograph."""

Answer = tuple[Bytes | None, tuple[int, ...]]
"""Data, if the operation has any, and the parameters of the response."""


class Responder:
    """Answers one initiator. unplugged: true once the fault of that name has happened."""

    def __init__(self, body: Body) -> None:
        self.unplugged = False
        self._body = body
        self._session: int | None = None
        self._transaction = 0
        self._broken = False
        self._command: Container | None = None
        self._operations: dict[int, Callable[..., Answer]] = {
            Operation.GET_DEVICE_INFO: self._get_device_info,
            Operation.OPEN_SESSION: self._open_session,
            Operation.CLOSE_SESSION: self._close_session,
            Operation.GET_STORAGE_IDS: self._get_storage_ids,
            Operation.GET_STORAGE_INFO: self._get_storage_info,
            Operation.GET_NUM_OBJECTS: self._get_num_objects,
            Operation.GET_OBJECT_HANDLES: self._get_object_handles,
            Operation.GET_OBJECT_INFO: self._get_object_info,
            Operation.GET_OBJECT: self._get_object,
            Operation.GET_PARTIAL_OBJECT: self._get_partial_object,
            Operation.DELETE_OBJECT: self._delete_object,
            Operation.INITIATE_CAPTURE: self._initiate_capture,
            Operation.GET_DEVICE_PROP_DESC: self._get_device_prop_desc,
            Operation.GET_DEVICE_PROP_VALUE: self._get_device_prop_value,
            Operation.NIKON_CAPTURE_TO_CARD: self._initiate_capture,
            Operation.NIKON_DEVICE_READY: self._device_ready,
            Operation.NIKON_GET_EVENTS: self._get_events,
        }

    def accept(self, raw: bytes) -> list[bytes]:
        """Take one container from the initiator and return those that answer it.

        Raises ProtocolError for bytes that are no container.
        """
        return [answer.encode() for answer in self.answer(containers.decode(raw))]

    def answer(self, container: Container) -> list[Container]:
        """Take one container from the initiator and return those that answer it."""
        self._body.advance()
        command, self._command = self._command, None
        if container.type is ContainerType.COMMAND:
            if container.code == Operation.SET_DEVICE_PROP_VALUE:
                self._command = container
                return []  # its data come in a container of their own
            answers = self._answer(container, lambda: self._run(container))
            if self._body.fault == "asleep" and container.code == Operation.OPEN_SESSION:
                self._body.fault = "none"  # the first call wakes it
                return []
            if container.code in RELEASES:
                nonsense = Container(ContainerType.RESPONSE, 0xFFFF, 0xFFFFFFFF)
                return {"silent": [], "garbled": [nonsense]}.get(self._body.fault, answers)
            return answers
        if container.type is not ContainerType.DATA or command is None:
            return self._answer(container, lambda: _refuse(Response.GENERAL_ERROR))
        return self._answer(command, lambda: self._set_device_prop_value(command, container))

    def next_event(self) -> bytes | None:
        """Take the next event, if there is one to be told unasked."""
        self._body.advance()
        if not self._body.events or Operation.NIKON_GET_EVENTS in self._body.model.calls:
            return None
        code, parameter = self._body.events.popleft()
        parameters = () if code is EventCode.CAPTURE_COMPLETE else (parameter,)
        return Container.with_parameters(ContainerType.EVENT, code, 0, parameters).encode()

    def _answer(self, command: Container, run: Callable[[], Answer]) -> list[Container]:
        code, data, parameters = Response.OK, None, tuple[int, ...]()
        try:
            data, parameters = run()
        except Refusal as refusal:
            code = refusal.response
        answers = []
        if data is not None:
            answers.append(Container(ContainerType.DATA, command.code, command.transaction, data))
        answers.append(
            Container.with_parameters(ContainerType.RESPONSE, code, command.transaction, parameters)
        )
        return answers

    def _run(self, command: Container) -> Answer:
        operation = self._operations.get(command.code)
        ours = command.code < _VENDOR or command.code in self._body.model.calls
        if operation is None or not ours:
            raise Refusal(Response.OPERATION_NOT_SUPPORTED)
        if command.code not in _WITHOUT_SESSION:
            self._check_session(command)
        self._transaction = command.transaction
        # a missing parameter is 0, one too many is ignored, as the standard has it
        return operation(*(command.parameters + (0,) * 5)[:5])

    def _check_session(self, command: Container) -> None:
        if self._session is None:
            raise Refusal(Response.SESSION_NOT_OPEN)
        # an initiator that finds a session open does not know its count, so it may close it
        expected = 1 if self._transaction == _LAST_TRANSACTION else self._transaction + 1
        if command.transaction != expected and command.code != Operation.CLOSE_SESSION:
            raise Refusal(Response.INVALID_TRANSACTION_ID)

    def _get_device_info(self, *_: int) -> Answer:
        model = self._body.model
        offered = [code for code in self._operations if code < _VENDOR or code in model.calls]
        info = DeviceInfo(
            operations=(*offered, Operation.SET_DEVICE_PROP_VALUE),
            events=tuple(EventCode),
            properties=tuple(self._body.properties),
            formats=(ObjectFormat.DNG, ObjectFormat.EXIF_JPEG),
            manufacturer=model.make,
            model=model.model,
            version="simulated 1",
            serial=model.serial,
            vendor=model.vendor,
        )
        return info.encode(), ()

    def _open_session(self, session: int, *_: int) -> Answer:
        if self._session is not None:
            raise Refusal(Response.SESSION_ALREADY_OPEN)
        if session == 0:
            raise Refusal(Response.INVALID_PARAMETER)
        self._session = session
        return None, ()

    def _close_session(self, *_: int) -> Answer:
        self._session = None
        return None, ()

    def _get_storage_ids(self, *_: int) -> Answer:
        return uints([STORAGE], 4), ()

    def _get_storage_info(self, storage: int, *_: int) -> Answer:
        if storage != STORAGE:
            raise Refusal(Response.INVALID_STORAGE_ID)
        free = self._body.free_bytes
        return StorageInfo(CARD_BYTES, free, free // PHOTOGRAPH_BYTES, "studio").encode(), ()

    def _get_num_objects(self, storage: int, kind: int, parent: int, *_: int) -> Answer:
        return None, (len(self._matching(storage, kind, parent)),)

    def _get_object_handles(self, storage: int, kind: int, parent: int, *_: int) -> Answer:
        if self._body.fault == "hostile":
            return b"\xff\xff\xff\xff" * 4, ()
        return uints(self._matching(storage, kind, parent), 4), ()

    def _get_object_info(self, handle: int, *_: int) -> Answer:
        return self._object(handle).info.encode(), ()

    def _get_object(self, handle: int, *_: int) -> Answer:
        data = self._object(handle).data
        self._pull_the_cable()
        return data, ()

    def _get_partial_object(self, handle: int, offset: int, count: int, *_: int) -> Answer:
        data = self._object(handle).data
        if offset > len(data):
            raise Refusal(Response.INVALID_PARAMETER)
        self._broken = self._body.fault == "broken_transfer" and not self._broken
        if self._broken:
            raise Refusal(Response.INCOMPLETE_TRANSFER)
        self._pull_the_cable()
        part = memoryview(data)[offset : offset + count]
        return part, (len(part),)

    def _delete_object(self, handle: int, *_: int) -> Answer:
        self._object(handle)
        if handle == FOLDER:
            raise Refusal(Response.ACCESS_DENIED)
        del self._body.objects[handle]
        return None, ()

    def _initiate_capture(self, *_: int) -> Answer:
        self._body.release()
        return None, ()

    def _device_ready(self, *_: int) -> Answer:
        if self._body.seconds_to_wait() is not None:
            raise Refusal(Response.DEVICE_BUSY)
        return None, ()

    def _get_events(self, *_: int) -> Answer:
        told, self._body.events = self._body.events, deque()
        return uint(len(told), 2) + b"".join(uint(c, 2) + uint(p, 4) for c, p in told), ()

    def _get_device_prop_desc(self, code: int, *_: int) -> Answer:
        self._check_property(code)
        description = self._body.properties[code]
        return replace(description, writable=self._body.writable(code)).encode(), ()

    def _get_device_prop_value(self, code: int, *_: int) -> Answer:
        self._check_property(code)
        description = self._body.properties[code]
        return uint(description.current, description.width), ()

    def _set_device_prop_value(self, command: Container, data: Container) -> Answer:
        self._check_session(command)
        self._transaction = command.transaction
        if data.transaction != command.transaction:
            raise Refusal(Response.INVALID_TRANSACTION_ID)
        code = (*command.parameters, 0)[0]
        self._check_property(code)
        if len(data.payload) != self._body.properties[code].width:
            raise Refusal(Response.INVALID_PROP_FORMAT)
        self._body.set_property(code, int.from_bytes(data.payload, "little"))
        return None, ()

    def _check_property(self, code: int) -> None:
        if code not in self._body.properties:
            raise Refusal(Response.DEVICE_PROP_NOT_SUPPORTED)

    def _object(self, handle: int) -> StoredObject:
        if handle not in self._body.objects:
            raise Refusal(Response.INVALID_OBJECT_HANDLE)
        return self._body.objects[handle]

    def _matching(self, storage: int, kind: int, parent: int) -> list[int]:
        if storage not in (STORAGE, ALL_STORAGES):
            raise Refusal(Response.INVALID_STORAGE_ID)
        if parent not in (0, _ROOT, FOLDER):
            raise Refusal(Response.INVALID_OBJECT_HANDLE)
        inside = {0: None, _ROOT: 0, FOLDER: FOLDER}[parent]
        return [
            handle
            for handle, stored in self._body.objects.items()
            if kind in (0, stored.info.format) and inside in (None, stored.info.parent)
        ]

    def _pull_the_cable(self) -> None:
        self.unplugged = self._body.fault == "unplug"


def _refuse(response: Response) -> Answer:
    raise Refusal(response)
