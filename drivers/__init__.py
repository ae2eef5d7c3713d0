"""Cameras in, bytes out. Everything else in this package is private to it."""

from drivers.camera import (
    Camera,
    CameraInfo,
    SettingName,
    SettingValue,
)
from drivers.capture import CAPTURE_STAGES, capture_pair, check_settings, write_settings
from drivers.errors import (
    BadAddressError,
    CameraDisconnectedError,
    CameraNotFoundError,
    CameraTimeoutError,
    CaptureError,
    DriverError,
    FlashError,
    ProtocolError,
    SettingError,
    UnconfirmedError,
)
from drivers.flash import (
    SWITCH_S,
    ExternalFlash,
    Flash,
    OperatorFlash,
    PropertyFlash,
    check_flash_order,
    leave_flash_off,
)
from drivers.pair import CapturedPair
from drivers.registry import (
    SCHEMES,
    announce_simulated,
    canonical_address,
    check_address,
    list_cameras,
    listen_to_network,
    names_one_camera,
    open_camera,
    serve_simulated,
    simulated_truth,
)
from drivers.returning import ReturningCamera
from drivers.shot import Shot

__all__ = [
    "CAPTURE_STAGES",
    "SCHEMES",
    "SWITCH_S",
    "BadAddressError",
    "Camera",
    "CameraDisconnectedError",
    "CameraInfo",
    "CameraNotFoundError",
    "CameraTimeoutError",
    "CaptureError",
    "CapturedPair",
    "DriverError",
    "ExternalFlash",
    "Flash",
    "FlashError",
    "OperatorFlash",
    "PropertyFlash",
    "ProtocolError",
    "ReturningCamera",
    "SettingError",
    "SettingName",
    "SettingValue",
    "Shot",
    "UnconfirmedError",
    "announce_simulated",
    "canonical_address",
    "capture_pair",
    "check_address",
    "check_flash_order",
    "check_settings",
    "leave_flash_off",
    "list_cameras",
    "listen_to_network",
    "names_one_camera",
    "open_camera",
    "serve_simulated",
    "simulated_truth",
    "write_settings",
]
