"""What can go wrong between this computer and a camera.

DriverError
├── BadAddressError            the address names no camera that could exist
├── CameraNotFoundError        the address is sound, but no camera answers there
│   └── MissingPackageError    nor will one until a package is installed on this host
├── CameraBusyError            the camera kept saying that it is busy
├── CameraDisconnectedError    the connection broke in the middle
├── CameraTimeoutError         the camera stopped answering
├── ProtocolError              the camera's answer is not valid, or refuses without a known reason
├── SettingError               a setting or the release is missing, read-only, or not taken over
├── CaptureError               the release was pressed and no usable photograph came
│   ├── FocusError             the camera could not focus and did not release
│   ├── StoreFullError         the memory card has no room
│   └── PairVerificationError  two photographs came, but they are not a flash/no-flash pair
│       └── NoFlashError       because the flash did not fire
├── FlashError                 what switches the flash did not obey
│   └── UnconfirmedError       a person was asked to switch it, and nobody confirmed in time
└── TransferError              a photograph could not be fetched whole

Each message is one sentence for people: what, where, and what to do.
"""

from __future__ import annotations


class DriverError(Exception):
    """Root of everything the drivers raise on purpose."""


class BadAddressError(DriverError):
    """The address names no camera that could exist."""


class CameraNotFoundError(DriverError):
    """No camera answers at the address."""


class MissingPackageError(CameraNotFoundError):
    """What opens such a camera is not installed on this host; another host may have it."""


class CameraBusyError(DriverError):
    """The camera kept saying that it is busy."""


class CameraDisconnectedError(DriverError):
    """The connection to the camera broke."""


class CameraTimeoutError(DriverError):
    """The camera stopped answering."""


class ProtocolError(DriverError):
    """The camera's answer is not valid, or it refuses without a known reason.

    what: what is wrong, without a full stop; what to do is always the same.
    """

    def __init__(self, what: str) -> None:
        super().__init__(f"{what}: switch the camera off and on, connect it anew and try again.")


class SettingError(DriverError):
    """A setting or the release is missing, read-only, or was not taken over."""


class CaptureError(DriverError):
    """The release was pressed and no usable photograph came."""


class FocusError(CaptureError):
    """The camera could not focus and did not release."""


class StoreFullError(CaptureError):
    """The memory card has no room."""


class PairVerificationError(CaptureError):
    """The two photographs are not a flash/no-flash pair."""


class NoFlashError(PairVerificationError):
    """The flash did not fire in the photograph that was to have it."""


class FlashError(DriverError):
    """What switches the flash, other than the camera, did not obey."""


class UnconfirmedError(FlashError):
    """Nobody confirmed in time that the flash is switched."""


class TransferError(DriverError):
    """A photograph could not be fetched whole."""
