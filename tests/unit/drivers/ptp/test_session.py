from __future__ import annotations

from collections import deque

import pytest

from drivers.clock import Clock
from drivers.errors import (
    CameraBusyError,
    CameraDisconnectedError,
    CaptureError,
    DriverError,
    FocusError,
    ProtocolError,
    SettingError,
    StoreFullError,
    TransferError,
)
from drivers.ptp.codes import ContainerType, Operation, Response
from drivers.ptp.containers import Container
from drivers.ptp.session import Session
from drivers.ptp.transport import Transport

RESPONSE, DATA = ContainerType.RESPONSE, ContainerType.DATA


class Script(Transport):
    """Answers with what it was given, whatever is asked.

    outlasted: whether its sessions outlast it.
    """

    outlasted = True

    def __init__(self, *answers: Container) -> None:
        self.answers = deque(answers)
        self.sent: list[Container] = []
        self.closed = 0
        self.afresh: list[int] = []

    def send(self, container: Container) -> None:
        self.sent.append(container)

    def receive(self, most: int = 0, into: memoryview | None = None) -> Container:  # noqa: ARG002
        if not self.answers:
            raise CameraDisconnectedError("gone")
        return self.answers.popleft()

    def receive_event(self, timeout_s: float) -> Container | None:
        raise AssertionError(timeout_s)

    def start_afresh(self) -> bool:
        self.afresh.append(len(self.sent))
        return self.outlasted

    def close(self) -> None:
        self.closed += 1


def response(transaction: int, code: int = Response.OK, *parameters: int) -> Container:
    return Container.with_parameters(RESPONSE, code, transaction, parameters)


def opened(clock: Clock, *answers: Container) -> tuple[Session, Script]:
    script = Script(response(0), *answers)
    session = Session(script, clock)
    session.open()
    return session, script


def test_transactions_count_up_from_the_opening(clock: Clock) -> None:
    session, script = opened(clock, response(1), response(2))
    session.request(Operation.GET_STORAGE_IDS)
    session.request(Operation.GET_OBJECT_INFO, 9)
    assert [container.transaction for container in script.sent] == [0, 1, 2]
    assert [container.code for container in script.sent] == [0x1002, 0x1004, 0x1008]
    assert [container.parameters for container in script.sent] == [(1,), (), (9,)]


def test_transaction_ids_wrap_around_the_reserved_ones(clock: Clock) -> None:
    session, script = opened(clock, response(0xFFFFFFFE), response(1))
    session._transaction = 0xFFFFFFFE
    session.request(Operation.GET_STORAGE_IDS)
    session.request(Operation.GET_STORAGE_IDS)
    assert [container.transaction for container in script.sent[1:]] == [0xFFFFFFFE, 1]


def test_data_are_handed_on(clock: Clock) -> None:
    session, _ = opened(
        clock, Container(DATA, Operation.GET_OBJECT, 1, b"photograph"), response(1, Response.OK, 10)
    )
    assert session.request(Operation.GET_OBJECT, 5) == b"photograph"


def test_data_are_sent_after_their_command(clock: Clock) -> None:
    session, script = opened(clock, response(1))
    session.request(Operation.SET_DEVICE_PROP_VALUE, 0x500C, data=b"\2\0")
    command, data = script.sent[1:]
    assert (command.type, command.parameters) == (ContainerType.COMMAND, (0x500C,))
    assert (data.type, data.code, data.transaction, data.payload) == (DATA, 0x1016, 1, b"\2\0")


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        (response(2), "answered transaction 1 with a response 0x2001 of transaction 2"),
        (response(0), "of transaction 0"),
        (Container(DATA, Operation.GET_OBJECT, 2), "data 0x1009 of transaction 2"),
        (Container(DATA, Operation.GET_OBJECT_INFO, 1), "data 0x1008 of transaction 1"),
        (Container(ContainerType.COMMAND, Operation.GET_OBJECT, 1), "command 0x1009"),
        (Container(ContainerType.EVENT, 0x4002, 1), "event 0x4002"),
    ],
)
def test_answers_that_belong_to_something_else_are_refused(
    clock: Clock, answer: Container, complaint: str
) -> None:
    session, _ = opened(clock, answer, response(1))
    with pytest.raises(ProtocolError, match=complaint):
        session.request(Operation.GET_OBJECT, 1)


def test_data_twice_are_refused(clock: Clock) -> None:
    data = Container(DATA, Operation.GET_OBJECT, 1, b"x")
    session, _ = opened(clock, data, data)
    with pytest.raises(ProtocolError, match="with a data 0x1009"):
        session.request(Operation.GET_OBJECT, 1)


@pytest.mark.parametrize(
    ("code", "error", "sentence"),
    [
        (Response.STORE_FULL, StoreFullError, "memory card is full"),
        (Response.STORE_NOT_AVAILABLE, StoreFullError, "no memory card"),
        (Response.INVALID_STORAGE_ID, StoreFullError, "no memory card"),
        (Response.STORE_READ_ONLY, StoreFullError, "is write-protected: move its switch"),
        (Response.NIKON_OUT_OF_FOCUS, FocusError, "could not focus"),
        (0xA008, SettingError, "stands on bulb or time: set one in seconds"),
        (0xA204, SettingError, "stands on bulb or time: set one in seconds"),
        (0xA009, SettingError, "raising the mirror first: set it to single frames"),
        (Response.INCOMPLETE_TRANSFER, TransferError, "broke off"),
        (Response.INVALID_OBJECT_HANDLE, TransferError, "no longer on the camera's card"),
        (Response.INVALID_PROP_VALUE, SettingError, "refused the value"),
        (Response.INVALID_PROP_FORMAT, SettingError, "refused the value"),
        (Response.DEVICE_PROP_NOT_SUPPORTED, SettingError, "lacks a setting"),
        (Response.ACCESS_DENIED, CaptureError, "did not release"),
        (Response.GENERAL_ERROR, CaptureError, "did not release"),
        (Response.SESSION_NOT_OPEN, ProtocolError, "INITIATE_CAPTURE with the response 0x2003"),
        (0xBEEF, ProtocolError, "response 0xbeef"),
    ],
)
def test_refusals_become_errors_of_their_kind(
    clock: Clock, code: int, error: type[DriverError], sentence: str
) -> None:
    session, script = opened(clock, response(1, code))
    with pytest.raises(error, match=sentence):
        session.request(Operation.INITIATE_CAPTURE)
    assert len(script.sent) == 2  # asked once, not again
    assert clock.monotonic() == 0


@pytest.mark.parametrize(
    "operation",
    [
        Operation.GET_DEVICE_PROP_DESC,
        Operation.GET_DEVICE_PROP_VALUE,
        Operation.SET_DEVICE_PROP_VALUE,
    ],
)
@pytest.mark.parametrize("code", [0x2002, 0x2005, 0x2006, 0x200F, 0x201D, 0xA005])
def test_a_setting_that_is_refused_without_a_reason_is_kept_by_the_camera(
    clock: Clock, operation: Operation, code: int
) -> None:
    session, _ = opened(clock, response(1, code))
    with pytest.raises(SettingError, match="keeps a setting to itself"):
        session.request(operation, 0x500C)


def test_a_session_that_is_lost_is_no_matter_of_settings(clock: Clock) -> None:
    session, _ = opened(clock, response(1, Response.SESSION_NOT_OPEN))
    with pytest.raises(ProtocolError, match="SET_DEVICE_PROP_VALUE with the response 0x2003"):
        session.request(Operation.SET_DEVICE_PROP_VALUE, 0x500C, data=b"\2\0")


def test_a_busy_camera_is_asked_again(clock: Clock) -> None:
    busy = Response.DEVICE_BUSY
    session, script = opened(clock, response(1, busy), response(2, busy), response(3))
    session.request(Operation.INITIATE_CAPTURE)
    assert [container.transaction for container in script.sent] == [0, 1, 2, 3]
    assert clock.monotonic() == pytest.approx(0.15)


def test_a_camera_that_stays_busy_is_given_up(clock: Clock) -> None:
    session, _ = opened(clock, *(response(n, Response.DEVICE_BUSY) for n in range(1, 9)))
    with pytest.raises(CameraBusyError, match="kept saying that it is busy"):
        session.request(Operation.INITIATE_CAPTURE)
    assert clock.monotonic() == pytest.approx(3.15)


@pytest.mark.parametrize(
    ("code", "busy"),
    [
        (Response.OK, False),
        (Response.NIKON_SILENT_RELEASE_BUSY, False),
        (Response.DEVICE_BUSY, True),
        (Response.NIKON_BULB_RELEASE_BUSY, True),
    ],
)
def test_whether_a_camera_is_busy_is_asked_once(clock: Clock, code: int, busy: bool) -> None:
    session, script = opened(clock, response(1, code))
    assert session.is_busy(Operation.NIKON_DEVICE_READY) is busy
    assert len(script.sent) == 2


def test_a_session_left_open_is_closed_first(clock: Clock) -> None:
    script = Script(response(0, Response.SESSION_ALREADY_OPEN), response(1), response(0))
    Session(script, clock).open()
    assert [container.code for container in script.sent] == [0x1002, 0x1003, 0x1002]
    assert script.sent[-1].transaction == 0


def test_a_camera_that_is_busy_getting_up_is_asked_again_for_a_session(clock: Clock) -> None:
    busy = response(0, Response.DEVICE_BUSY)
    open_already = response(0, Response.SESSION_ALREADY_OPEN)
    script = Script(busy, open_already, response(1), busy, response(0))
    Session(script, clock).open()
    assert [container.code for container in script.sent] == [0x1002, 0x1002, 0x1003, 0x1002, 0x1002]
    assert [container.transaction for container in script.sent] == [0, 0, 1, 0, 0]
    assert clock.monotonic() == pytest.approx(0.15)


def test_a_camera_that_is_too_busy_for_a_session_is_given_up(clock: Clock) -> None:
    script = Script(*7 * [response(0, Response.DEVICE_BUSY)])
    with pytest.raises(CameraBusyError, match="kept saying that it is busy"):
        Session(script, clock).open()
    assert clock.monotonic() == pytest.approx(3.15)


def test_a_session_that_cannot_be_opened_is_an_error(clock: Clock) -> None:
    script = Script(response(0, Response.GENERAL_ERROR))
    with pytest.raises(ProtocolError, match="OPEN_SESSION with the response 0x2002"):
        Session(script, clock).open()


def test_closing_lets_go_once_of_the_session_and_always_of_the_transport(clock: Clock) -> None:
    session, script = opened(clock, response(1))
    session.close()
    session.close()
    assert [container.code for container in script.sent] == [0x1002, 0x1003]
    assert script.closed == 2
    assert script.afresh == []


def test_closing_a_camera_that_is_gone_is_fine(clock: Clock) -> None:
    session, script = opened(clock)
    session.close()
    assert script.closed == 1


@pytest.mark.parametrize("answers", [(), (response(2),), (Container(DATA, 0x1004, 1),)])
def test_what_a_cut_transaction_left_is_thrown_away_before_the_session_is_closed(
    clock: Clock, answers: tuple[Container, ...]
) -> None:
    session, script = opened(clock, *answers)
    with pytest.raises(DriverError):
        session.request(Operation.GET_STORAGE_IDS)
    session.close()
    assert [container.code for container in script.sent] == [0x1002, 0x1004, 0x1003]
    assert script.afresh == [2]


def test_after_a_cut_transaction_nothing_is_asked_where_hanging_up_ends_the_session(
    clock: Clock,
) -> None:
    session, script = opened(clock)
    script.outlasted = False
    with pytest.raises(CameraDisconnectedError):
        session.request(Operation.GET_STORAGE_IDS)
    session.close()
    assert [container.code for container in script.sent] == [0x1002, 0x1004]
    assert (script.afresh, script.closed) == ([2], 1)
