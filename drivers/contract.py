"""Checks that all drivers share: a fault reads the same, whichever cable the camera hangs on."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterable

from drivers.camera import Setting, SettingName, SettingValue, meant
from drivers.errors import SettingError, TransferError

MOST_EVENTS = 1000
"""Events taken at once: a camera may tell more, and quicker than they are taken."""

_MOST_SPELT = 30
"""Values that a sentence spells out; a range of ISO speeds may have hundreds."""
_NEAR = 2


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
    known = tuple(offered)
    if len(known) > _MOST_SPELT:
        near = ", ".join(map(_said, _near(value, known)))
        spelt = f"{len(known)} values from {_said(known[0])} to {_said(known[-1])}, like {near}"
    else:
        spelt = ", ".join(map(_said, known))
    return SettingError(f"The camera offers no {name} of {_said(value)}; it offers {spelt}.")


def _near(value: SettingValue, known: tuple[SettingValue, ...]) -> Iterable[SettingValue]:
    """Give the numbers next to one on both sides; the first of what is known where that is none."""
    numbers = sorted(one for one in known if not isinstance(one, str))
    if isinstance(value, str) or not numbers:
        return known[: 2 * _NEAR]
    at = bisect(numbers, value)
    return numbers[max(at - _NEAR, 0) : at + _NEAR]


def _said(value: SettingValue) -> str:
    """Write a value for people, a time that was asked for as 1/60 in a few digits."""
    return f"{value:.4g}" if isinstance(value, float) and abs(value) < 1 else str(value) or "''"
