"""Cameras in, bytes out. Everything else in this package is private to it."""

from drivers.camera import (
    Camera,
    CameraInfo,
    CameraObject,
    Event,
    EventKind,
    Setting,
    SettingName,
    SettingValue,
)
from drivers.capture import CAPTURE_STAGES, capture_pair, check_settings
from drivers.errors import (
    BadAddressError,
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
    CameraTimeoutError,
    CaptureError,
    DriverError,
    FlashError,
    FocusError,
    NoFlashError,
    PairVerificationError,
    ProtocolError,
    SettingError,
    StoreFullError,
    TransferError,
)
from drivers.exif import ExposureFacts
from drivers.flash import ExternalFlash, Flash, OperatorFlash, PropertyFlash, check_flash_order
from drivers.pair import CapturedPair
from drivers.registry import (
    announce_simulated,
    canonical_address,
    check_address,
    list_cameras,
    listen_to_network,
    open_camera,
    serve_simulated,
    simulated_truth,
)
from drivers.returning import ReturningCamera
from drivers.shot import Shot
from drivers.truth import SimulatedTruth

__all__ = [
    "CAPTURE_STAGES",
    "BadAddressError",
    "Camera",
    "CameraBusyError",
    "CameraDisconnectedError",
    "CameraInfo",
    "CameraNotFoundError",
    "CameraObject",
    "CameraTimeoutError",
    "CaptureError",
    "CapturedPair",
    "DriverError",
    "Event",
    "EventKind",
    "ExposureFacts",
    "ExternalFlash",
    "Flash",
    "FlashError",
    "FocusError",
    "NoFlashError",
    "OperatorFlash",
    "PairVerificationError",
    "PropertyFlash",
    "ProtocolError",
    "ReturningCamera",
    "Setting",
    "SettingError",
    "SettingName",
    "SettingValue",
    "Shot",
    "SimulatedTruth",
    "StoreFullError",
    "TransferError",
    "announce_simulated",
    "canonical_address",
    "capture_pair",
    "check_address",
    "check_flash_order",
    "check_settings",
    "list_cameras",
    "listen_to_network",
    "open_camera",
    "serve_simulated",
    "simulated_truth",
]
