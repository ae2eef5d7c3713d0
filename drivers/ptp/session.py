"""A PTP session: transactions in order, busy cameras waited for, refusals as typed errors."""

from __future__ import annotations

from drivers.clock import Clock
from drivers.errors import (
    CameraBusyError,
    CaptureError,
    DriverError,
    FocusError,
    ProtocolError,
    SettingError,
    StoreFullError,
    TransferError,
)
from drivers.ptp.codes import ContainerType, Operation, Response
from drivers.ptp.containers import Bytes, Container
from drivers.ptp.transport import DATASET_BYTES, Transport

_LAST_TRANSACTION = 0xFFFFFFFE  # 1 follows: PTP reserves 0 and 0xFFFFFFFF
_BUSY_PAUSES_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)  # between tries while a camera is busy
_BUSY = (Response.DEVICE_BUSY, Response.NIKON_BULB_RELEASE_BUSY)
_READY = (
    Response.OK,
    Response.NIKON_SILENT_RELEASE_BUSY,
)  # as libgphoto2 has it: the second may last

_RELEASES = (Operation.INITIATE_CAPTURE, Operation.NIKON_CAPTURE_TO_CARD)
_UNREASONED = (Response.GENERAL_ERROR, Response.ACCESS_DENIED)
_OF_SETTINGS = (
    Operation.GET_DEVICE_PROP_DESC,
    Operation.GET_DEVICE_PROP_VALUE,
    Operation.SET_DEVICE_PROP_VALUE,
)
_KEEPS = (  # what a camera says of a setting that it has, but in another mode alone
    Response.GENERAL_ERROR,
    Response.OPERATION_NOT_SUPPORTED,
    Response.PARAMETER_NOT_SUPPORTED,
    Response.ACCESS_DENIED,
    Response.INVALID_PARAMETER,
    Response.NIKON_SET_NOT_SUPPORTED,
)

_NO_CARD = "The camera has no memory card it can write to: insert one and try again."
_NO_TIME = (
    "The camera's exposure time stands on bulb or time: set one in seconds and take the pair again."
)
_REFUSED_VALUE = "The camera refused the value of a setting: set it on the camera itself."

_REFUSALS: dict[int, tuple[type[DriverError], str]] = {
    Response.DEVICE_BUSY: (
        CameraBusyError,
        "The camera kept saying that it is busy: wait until it is idle and try again.",
    ),
    Response.STORE_FULL: (
        StoreFullError,
        "The camera's memory card is full: make room on it and try again.",
    ),
    Response.STORE_NOT_AVAILABLE: (StoreFullError, _NO_CARD),
    Response.INVALID_STORAGE_ID: (StoreFullError, _NO_CARD),  # it was there a moment ago
    Response.STORE_READ_ONLY: (
        StoreFullError,
        "The camera's memory card is write-protected: move its switch and try again.",
    ),
    Response.NIKON_OUT_OF_FOCUS: (
        FocusError,
        "The camera could not focus: switch the lens to manual focus, focus by hand and try again.",
    ),
    Response.INCOMPLETE_TRANSFER: (
        TransferError,
        "The camera broke off a transfer: try again.",
    ),
    Response.INVALID_OBJECT_HANDLE: (
        TransferError,
        "The photograph is no longer on the camera's card: take it again.",
    ),
    Response.INVALID_PROP_VALUE: (SettingError, _REFUSED_VALUE),
    Response.INVALID_PROP_FORMAT: (SettingError, _REFUSED_VALUE),
    Response.NIKON_BULB: (SettingError, _NO_TIME),
    Response.NIKON_TIME: (SettingError, _NO_TIME),
    Response.NIKON_MIRROR_UP: (
        SettingError,
        "The camera's release stands on raising the mirror first: set it to single frames and try "
        "again.",
    ),
    Response.DEVICE_PROP_NOT_SUPPORTED: (
        SettingError,
        "The camera lacks a setting: set it on the camera itself.",
    ),
}


class Session:
    """Transactions with one camera, one after the other."""

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self.transport = transport
        self.clock = clock
        self._transaction = 0
        self._open = False
        self._cut = False  # a transaction was begun, and not all of its answer was taken

    def open(self) -> None:
        """Open the session; one that an earlier caller left open is closed first."""
        for pause in (*_BUSY_PAUSES_S, None):
            code, _ = self._once(Operation.OPEN_SESSION, (1,))
            if code == Response.SESSION_ALREADY_OPEN:
                self._once(Operation.CLOSE_SESSION, ())
                self._transaction = 0
                code, _ = self._once(Operation.OPEN_SESSION, (1,))
            if code != Response.DEVICE_BUSY or pause is None:
                break
            self._transaction = 0
            self.clock.sleep(pause)  # it may have been switched on just now
        if code != Response.OK:
            raise _refusal(Operation.OPEN_SESSION, code)
        self._open = True

    def request(
        self,
        operation: Operation,
        *parameters: int,
        data: bytes | None = None,
        most: int = DATASET_BYTES,
        into: memoryview | None = None,
    ) -> Bytes:
        """Run one operation and return the data of its answer, empty where it has none.

        data: bytes to send along. most: bytes that may come. into: where they are put if they fit.
        A busy camera is asked again for about three seconds. Raises the error that the camera's
        response stands for.
        """
        for pause in (*_BUSY_PAUSES_S, None):
            code, received = self._once(operation, parameters, data, most, into)
            if code == Response.OK:
                return received
            if code != Response.DEVICE_BUSY or pause is None:
                break
            self.clock.sleep(pause)
        raise _refusal(operation, code)

    def request_once(self, operation: Operation, *parameters: int) -> None:
        """Run an operation without data; a busy camera is an error, too, and not asked again."""
        code, _ = self._once(operation, parameters)
        if code != Response.OK:
            raise _refusal(operation, code)

    def is_busy(self, operation: Operation) -> bool:
        """Ask once whether the camera is busy. Raises like request() for any other refusal."""
        code, _ = self._once(operation, ())
        if code not in (*_READY, *_BUSY):
            raise _refusal(operation, code)
        return code in _BUSY

    def close(self) -> None:
        """Close the session and the transport, also where the camera is gone."""
        try:
            if self._cut:  # the next caller would take the rest of its answer for his own
                self._open &= self.transport.start_afresh()
            if self._open:
                self._open = False
                self._once(Operation.CLOSE_SESSION, ())
        except DriverError:
            pass  # the camera is gone or confused; what remains is to let go of it
        finally:
            self.transport.close()

    def _once(
        self,
        operation: Operation,
        parameters: tuple[int, ...],
        data: bytes | None = None,
        most: int = DATASET_BYTES,
        into: memoryview | None = None,
    ) -> tuple[int, Bytes]:
        transaction = self._transaction
        self._transaction = 1 if transaction == _LAST_TRANSACTION else transaction + 1
        self._cut = True
        self.transport.send(
            Container.with_parameters(ContainerType.COMMAND, operation, transaction, parameters)
        )
        if data is not None:
            self.transport.send(Container(ContainerType.DATA, operation, transaction, data))
        received: Bytes = b""
        answer = self.transport.receive(most, into)
        if answer.type is ContainerType.DATA:
            received = answer.payload
            _check(answer, operation, transaction, ContainerType.DATA)
            answer = self.transport.receive()
        _check(answer, answer.code, transaction, ContainerType.RESPONSE)
        self._cut = False
        return answer.code, received


def _check(container: Container, code: int, transaction: int, kind: ContainerType) -> None:
    if (container.type, container.code, container.transaction) != (kind, code, transaction):
        raise ProtocolError(
            f"The camera answered transaction {transaction} with a {container.type.name.lower()} "
            f"{container.code:#06x} of transaction {container.transaction}"
        )


def _refusal(operation: Operation, code: int) -> DriverError:
    if operation in _RELEASES and code in _UNREASONED:
        return CaptureError(
            "The camera did not release and does not say why: check focus, card and flash and try "
            "again."
        )
    if operation in _OF_SETTINGS and code in _KEEPS:
        return SettingError("The camera keeps a setting to itself: change it on the camera.")
    if code in _REFUSALS:
        kind, sentence = _REFUSALS[code]
        return kind(sentence)
    return ProtocolError(f"The camera answered {operation.name} with the response {code:#06x}")
