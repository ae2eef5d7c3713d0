from __future__ import annotations

import pytest

from drivers.clock import Clock
from drivers.errors import ProtocolError
from drivers.ptp import containers
from drivers.ptp.codes import ContainerType, EventCode, Operation, Property, Response
from drivers.ptp.containers import Container
from drivers.ptp.datasets import DeviceInfo, ObjectInfo, PropertyDescription
from drivers.ptp.wire import Reader
from drivers.sim.address import SimulatedCamera
from drivers.sim.body import FOLDER, STORAGE, Body
from drivers.sim.responder import Responder


class Initiator:
    """Speaks to a responder in raw containers, as well or as badly as a test wants."""

    def __init__(self, clock: Clock, **options: object) -> None:
        fields = {"width": 64, "height": 64, "noise": "off", **options}
        self.body = Body(SimulatedCamera.model_validate(fields), clock)
        self.responder = Responder(self.body)
        self.clock = clock
        self.transaction = 0

    def ask(
        self, operation: int, *parameters: int, transaction: int | None = None
    ) -> tuple[int, bytes, tuple[int, ...]]:
        number = self.transaction if transaction is None else transaction
        command = Container.with_parameters(ContainerType.COMMAND, operation, number, parameters)
        *data, response = map(containers.decode, self.responder.accept(command.encode()))
        self.transaction = number + 1
        assert (response.type, response.transaction) == (ContainerType.RESPONSE, number)
        for container in data:
            assert (container.type, container.code) == (ContainerType.DATA, operation)
        return response.code, b"".join(item.payload for item in data), response.parameters

    def give(self, code: int, value: bytes, data_transaction: int | None = None) -> int:
        number, self.transaction = self.transaction, self.transaction + 1
        operation = Operation.SET_DEVICE_PROP_VALUE
        command = Container.with_parameters(ContainerType.COMMAND, operation, number, (code,))
        assert self.responder.accept(command.encode()) == []
        sent = number if data_transaction is None else data_transaction
        data = Container(ContainerType.DATA, operation, sent, value)
        (answer,) = self.responder.accept(data.encode())
        return containers.decode(answer).code

    def photograph(self) -> list[tuple[int, tuple[int, ...]]]:
        assert self.ask(Operation.INITIATE_CAPTURE)[0] == Response.OK
        self.clock.sleep(5)
        events = []
        while (raw := self.responder.next_event()) is not None:
            event = containers.decode(raw)
            assert event.type is ContainerType.EVENT
            events.append((event.code, event.parameters))
        return events


@pytest.fixture
def initiator(clock: Clock) -> Initiator:
    initiator = Initiator(clock)
    assert initiator.ask(Operation.OPEN_SESSION, 1)[0] == Response.OK
    return initiator


def test_device_info_needs_no_session(clock: Clock) -> None:
    code, data, _ = Initiator(clock).ask(Operation.GET_DEVICE_INFO)
    info = DeviceInfo.decode(data)
    assert code == Response.OK
    assert (info.manufacturer, info.model) == ("NIKON CORPORATION", "NIKON D5100")
    assert set(info.operations) == {code for code in Operation if code < 0x9000}
    assert set(info.events) == set(EventCode)
    assert set(info.properties) == set(Property)


@pytest.mark.parametrize("operation", sorted(set(Operation) - {0x1001, 0x1002, 0x1016}))
def test_everything_else_needs_a_session(clock: Clock, operation: int) -> None:
    initiator = Initiator(clock, camera="native")
    assert initiator.ask(operation, 1)[0] == Response.SESSION_NOT_OPEN


def test_calls_of_a_maker_are_offered_by_its_cameras_alone(initiator: Initiator) -> None:
    code, _, _ = initiator.ask(Operation.NIKON_CAPTURE_TO_CARD)
    assert code == Response.OPERATION_NOT_SUPPORTED


def test_setting_a_property_needs_a_session(clock: Clock) -> None:
    assert Initiator(clock).give(Property.FLASH_MODE, b"\2\0") == Response.SESSION_NOT_OPEN


def test_sessions_open_once_and_close(initiator: Initiator) -> None:
    assert initiator.ask(Operation.OPEN_SESSION, 2)[0] == Response.SESSION_ALREADY_OPEN
    assert initiator.ask(Operation.CLOSE_SESSION)[0] == Response.OK
    assert initiator.ask(Operation.OPEN_SESSION, 0)[0] == Response.INVALID_PARAMETER
    assert initiator.ask(Operation.OPEN_SESSION, 1)[0] == Response.OK


@pytest.mark.parametrize("transaction", [0, 2, 0xFFFFFFFF])
def test_transaction_ids_must_count_up(initiator: Initiator, transaction: int) -> None:
    code, data, _ = initiator.ask(Operation.GET_STORAGE_IDS, transaction=transaction)
    assert (code, data) == (Response.INVALID_TRANSACTION_ID, b"")
    assert initiator.ask(Operation.GET_STORAGE_IDS, transaction=1)[0] == Response.OK


def test_data_must_be_of_their_commands_transaction(initiator: Initiator) -> None:
    answer = initiator.give(Property.FLASH_MODE, b"\2\0", data_transaction=9)
    assert answer == Response.INVALID_TRANSACTION_ID
    assert initiator.body.properties[Property.FLASH_MODE].current == 3


def test_data_out_of_the_blue_are_refused(initiator: Initiator) -> None:
    data = Container(ContainerType.DATA, Operation.SET_DEVICE_PROP_VALUE, 1, b"\2\0")
    (answer,) = initiator.responder.accept(data.encode())
    assert containers.decode(answer).code == Response.GENERAL_ERROR


def test_a_command_without_its_data_is_forgotten(initiator: Initiator) -> None:
    operation = Operation.SET_DEVICE_PROP_VALUE
    command = Container.with_parameters(ContainerType.COMMAND, operation, 1, (0x500C,))
    assert initiator.responder.accept(command.encode()) == []
    assert initiator.ask(Operation.GET_STORAGE_IDS, transaction=1)[0] == Response.OK
    late = Container(ContainerType.DATA, operation, 1, b"\2\0")
    (answer,) = initiator.responder.accept(late.encode())
    assert containers.decode(answer).code == Response.GENERAL_ERROR
    assert initiator.body.properties[Property.FLASH_MODE].current == 3


@pytest.mark.parametrize("raw", [b"", b"\xff" * 12, b"\x0d" + bytes(11)])
def test_bytes_that_are_no_container_are_refused(initiator: Initiator, raw: bytes) -> None:
    with pytest.raises(ProtocolError, match="PTP container"):
        initiator.responder.accept(raw)


def test_unknown_operations_are_refused(initiator: Initiator) -> None:
    assert initiator.ask(0x9999)[0] == Response.OPERATION_NOT_SUPPORTED


def test_properties_are_described_and_set(initiator: Initiator) -> None:
    description = PropertyDescription.decode(
        initiator.ask(Operation.GET_DEVICE_PROP_DESC, Property.FLASH_MODE)[1]
    )
    assert (description.current, description.values) == (3, (2, 3, 5))
    assert initiator.give(Property.FLASH_MODE, b"\2\0") == Response.OK
    answer = initiator.ask(Operation.GET_DEVICE_PROP_VALUE, Property.FLASH_MODE)
    assert answer == (Response.OK, b"\2\0", ())


@pytest.mark.parametrize(
    ("code", "value", "refusal"),
    [
        (Property.FLASH_MODE, b"\x01\0", Response.INVALID_PROP_VALUE),
        (Property.FLASH_MODE, b"\x02", Response.INVALID_PROP_FORMAT),
        (Property.FLASH_MODE, b"\x02\0\0\0", Response.INVALID_PROP_FORMAT),
        (Property.FLASH_MODE, b"", Response.INVALID_PROP_FORMAT),
        (Property.BATTERY_LEVEL, b"\x64", Response.ACCESS_DENIED),
        (0x5FFF, b"\x02\0", Response.DEVICE_PROP_NOT_SUPPORTED),
    ],
)
def test_bad_properties_are_refused(
    initiator: Initiator, code: int, value: bytes, refusal: int
) -> None:
    before = dict(initiator.body.properties)
    assert initiator.give(code, value) == refusal
    assert initiator.body.properties == before


@pytest.mark.parametrize("operation", [0x1014, 0x1015])
def test_unknown_properties_are_refused(initiator: Initiator, operation: int) -> None:
    assert initiator.ask(operation, 0x5FFF)[0] == Response.DEVICE_PROP_NOT_SUPPORTED


def test_a_release_puts_objects_on_the_card_and_tells(clock: Clock) -> None:
    initiator = Initiator(clock, format="both")
    initiator.ask(Operation.OPEN_SESSION, 1)
    events = initiator.photograph()
    assert events == [
        (EventCode.OBJECT_ADDED, (2,)),
        (EventCode.OBJECT_ADDED, (3,)),
        (EventCode.CAPTURE_COMPLETE, ()),
    ]
    handles = Reader(initiator.ask(Operation.GET_OBJECT_HANDLES, 0xFFFFFFFF)[1]).uints(4)
    assert handles == (FOLDER, 2, 3)
    for kind, expected in ((0x3811, (2,)), (0x3801, (3,)), (0x3001, (FOLDER,)), (0x3000, ())):
        answer = initiator.ask(Operation.GET_OBJECT_HANDLES, STORAGE, kind)
        assert Reader(answer[1]).uints(4) == expected
        count = initiator.ask(Operation.GET_NUM_OBJECTS, STORAGE, kind)
        assert count == (Response.OK, b"", (len(expected),))
    names = [ObjectInfo.decode(initiator.ask(0x1008, handle)[1]).name for handle in handles]
    assert names == ["100STUDI", "DSC_0001.DNG", "DSC_0001.JPG"]


def test_objects_come_whole_and_in_parts(initiator: Initiator) -> None:
    initiator.photograph()
    info = ObjectInfo.decode(initiator.ask(Operation.GET_OBJECT_INFO, 2)[1])
    whole = initiator.ask(Operation.GET_OBJECT, 2)[1]
    assert len(whole) == info.size
    assert (info.width, info.height, info.captured) == (64, 64, "20240229T235958")
    part = Operation.GET_PARTIAL_OBJECT
    assert initiator.ask(part, 2, 100, 50) == (Response.OK, whole[100:150], (50,))
    assert initiator.ask(part, 2, info.size - 3, 50)[1:] == (whole[-3:], (3,))
    assert initiator.ask(part, 2, info.size, 50)[1:] == (b"", (0,))
    assert initiator.ask(part, 2, 0, 0xFFFFFFFF)[1] == whole
    assert initiator.ask(part, 2, info.size + 1, 1)[0] == Response.INVALID_PARAMETER


@pytest.mark.parametrize("operation", [0x1008, 0x1009, 0x100B, 0x101B])
@pytest.mark.parametrize("handle", [0, 99, 0xFFFFFFFF])
def test_unknown_handles_are_refused(initiator: Initiator, operation: int, handle: int) -> None:
    assert initiator.ask(operation, handle)[0] == Response.INVALID_OBJECT_HANDLE


def test_photographs_can_be_deleted_and_the_folder_cannot(initiator: Initiator) -> None:
    initiator.photograph()
    assert initiator.ask(Operation.DELETE_OBJECT, 2)[0] == Response.OK
    assert initiator.ask(Operation.GET_OBJECT, 2)[0] == Response.INVALID_OBJECT_HANDLE
    assert initiator.ask(Operation.DELETE_OBJECT, FOLDER)[0] == Response.ACCESS_DENIED
    assert initiator.photograph()[0] == (EventCode.OBJECT_ADDED, (3,))  # handles are not reused


def test_parents_and_storages_choose_objects(initiator: Initiator) -> None:
    initiator.photograph()
    ask = Operation.GET_OBJECT_HANDLES
    assert Reader(initiator.ask(ask, STORAGE, 0, FOLDER)[1]).uints(4) == (2,)
    assert Reader(initiator.ask(ask, STORAGE, 0, 0xFFFFFFFF)[1]).uints(4) == (FOLDER,)
    assert initiator.ask(ask, STORAGE, 0, 77)[0] == Response.INVALID_OBJECT_HANDLE
    assert initiator.ask(ask, 5)[0] == Response.INVALID_STORAGE_ID
    assert initiator.ask(Operation.GET_STORAGE_INFO, 5)[0] == Response.INVALID_STORAGE_ID
    assert Reader(initiator.ask(Operation.GET_STORAGE_IDS)[1]).uints(4) == (STORAGE,)


@pytest.mark.parametrize(("fault", "room"), [("none", True), ("store_full", False)])
def test_the_storage_tells_its_room(clock: Clock, fault: str, room: bool) -> None:
    initiator = Initiator(clock, fault=fault)
    initiator.ask(Operation.OPEN_SESSION, 1)
    reader = Reader(initiator.ask(Operation.GET_STORAGE_INFO, STORAGE)[1])
    reader.take(6)
    assert reader.uint(8) == 2 * 10**9
    assert (reader.uint(8) > 0) == room


def test_a_second_release_during_the_first_is_refused(initiator: Initiator) -> None:
    assert initiator.ask(Operation.INITIATE_CAPTURE)[0] == Response.OK
    assert initiator.ask(Operation.INITIATE_CAPTURE)[0] == Response.DEVICE_BUSY
    initiator.clock.sleep(5)
    assert initiator.ask(Operation.INITIATE_CAPTURE)[0] == Response.OK
