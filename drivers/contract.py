"""What every driver holds its camera to, so that people read the same of all of them."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.camera import Setting, SettingName, SettingValue, meant
from drivers.errors import SettingError, TransferError

MOST_EVENTS = 1000
"""Events taken at once: a camera may tell more, and quicker than they are taken."""


def require_writable(name: SettingName, value: SettingValue, writable: bool) -> None:
    """Raise SettingError where only a dial on the camera sets what is to become the value."""
    if not writable:
        raise SettingError(
            f"The camera's {name} cannot be set from a computer: set it to {value} on the camera "
            "itself."
        )


def require_kept(told: SettingValue, setting: Setting) -> None:
    """Raise SettingError where a setting reads back otherwise than the camera was told.

    Times are rounded, also by cameras that do not say to which.
    """
    if meant(setting.name, told, (setting.value,)) != setting.value:
        raise SettingError(
            f"The camera was told to set {setting.name} to {told} but kept {setting.value}: check "
            "its dials and try again."
        )


def require_size(size: int, into: memoryview | None) -> None:
    """Raise TransferError where `into` was made for another size than the file now has."""
    if into is not None and len(into) != size:
        raise TransferError(
            f"The camera says {size} bytes where it said {len(into)} before: try again."
        )


def lacking(name: SettingName) -> SettingError:
    """Make the error of a setting that the camera does not have."""
    return SettingError(f"The camera has no setting {name}: set it on the camera itself.")


def not_offered(
    name: SettingName, value: SettingValue, offered: Iterable[SettingValue]
) -> SettingError:
    """Make the error of a value that is none of those that the camera offers."""
    known = ", ".join(map(_said, offered))
    return SettingError(f"The camera offers no {name} of {_said(value)}; it offers {known}.")


def _said(value: SettingValue) -> str:
    """Write a value for people, a time that was asked for as 1/60 in a few digits."""
    return f"{value:.4g}" if isinstance(value, float) and abs(value) < 1 else str(value) or "''"
