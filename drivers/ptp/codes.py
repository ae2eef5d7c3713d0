"""Numbers of the Picture Transfer Protocol. Source: ISO 15740; vendor codes as observed."""

from __future__ import annotations

from enum import IntEnum


class ContainerType(IntEnum):
    """What a container carries."""

    COMMAND = 1
    DATA = 2
    RESPONSE = 3
    EVENT = 4


class Operation(IntEnum):
    """What an initiator may ask for."""

    GET_DEVICE_INFO = 0x1001
    OPEN_SESSION = 0x1002
    CLOSE_SESSION = 0x1003
    GET_STORAGE_IDS = 0x1004
    GET_STORAGE_INFO = 0x1005
    GET_NUM_OBJECTS = 0x1006
    GET_OBJECT_HANDLES = 0x1007
    GET_OBJECT_INFO = 0x1008
    GET_OBJECT = 0x1009
    DELETE_OBJECT = 0x100B
    INITIATE_CAPTURE = 0x100E
    GET_DEVICE_PROP_DESC = 0x1014
    GET_DEVICE_PROP_VALUE = 0x1015
    SET_DEVICE_PROP_VALUE = 0x1016
    GET_PARTIAL_OBJECT = 0x101B
    NIKON_GET_EVENTS = 0x90C7
    NIKON_DEVICE_READY = 0x90C8
    NIKON_CAPTURE_TO_CARD = 0x9207


class Response(IntEnum):
    """How a responder ends a transaction."""

    OK = 0x2001
    GENERAL_ERROR = 0x2002
    SESSION_NOT_OPEN = 0x2003
    INVALID_TRANSACTION_ID = 0x2004
    OPERATION_NOT_SUPPORTED = 0x2005
    PARAMETER_NOT_SUPPORTED = 0x2006
    INCOMPLETE_TRANSFER = 0x2007
    INVALID_STORAGE_ID = 0x2008
    INVALID_OBJECT_HANDLE = 0x2009
    DEVICE_PROP_NOT_SUPPORTED = 0x200A
    STORE_FULL = 0x200C
    STORE_READ_ONLY = 0x200E
    ACCESS_DENIED = 0x200F
    STORE_NOT_AVAILABLE = 0x2013
    DEVICE_BUSY = 0x2019
    INVALID_PROP_FORMAT = 0x201B
    INVALID_PROP_VALUE = 0x201C
    INVALID_PARAMETER = 0x201D
    SESSION_ALREADY_OPEN = 0x201E
    NIKON_OUT_OF_FOCUS = 0xA002
    NIKON_SET_NOT_SUPPORTED = 0xA005
    NIKON_BULB = 0xA008
    NIKON_MIRROR_UP = 0xA009
    NIKON_BULB_RELEASE_BUSY = 0xA200
    NIKON_SILENT_RELEASE_BUSY = 0xA201
    NIKON_TIME = 0xA204


class EventCode(IntEnum):
    """What a responder tells unasked."""

    OBJECT_ADDED = 0x4002
    DEVICE_PROP_CHANGED = 0x4006
    STORE_FULL = 0x400A
    CAPTURE_COMPLETE = 0x400D


class Property(IntEnum):
    """Device properties."""

    BATTERY_LEVEL = 0x5001
    COMPRESSION_SETTING = 0x5004
    WHITE_BALANCE = 0x5005
    F_NUMBER = 0x5007
    FOCUS_MODE = 0x500A
    FLASH_MODE = 0x500C
    EXPOSURE_TIME = 0x500D
    EXPOSURE_PROGRAM = 0x500E
    EXPOSURE_INDEX = 0x500F
    STILL_CAPTURE_MODE = 0x5013


class ObjectFormat(IntEnum):
    """Kinds of objects."""

    ASSOCIATION = 0x3001
    EXIF_JPEG = 0x3801
    DNG = 0x3811


NIKON = 0x0000000A
"""Vendor extension of Nikon."""


class DataType(IntEnum):
    """Types of property values."""

    UINT8 = 0x0002
    UINT16 = 0x0004
    UINT32 = 0x0006


SENDS_DATA = (Operation.SET_DEVICE_PROP_VALUE,)
"""Operations whose data come from the initiator."""

ALL_STORAGES = 0xFFFFFFFF
"""Stands for every storage in a request for handles."""
