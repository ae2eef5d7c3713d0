"""What switches the flash of a camera that the command line drives."""

from __future__ import annotations

import select
import sys
from collections.abc import Callable

import drivers


def flash_switch(text: str, settle_s: float) -> drivers.Flash:
    """Read --flash: "property", "operator", or a command or URL with {state} in it.

    Raises pipeline.errors.OptionError.
    """
    from pipeline.errors import OptionError
    from service.camera_tasks import brightness

    if text == "property":
        return drivers.PropertyFlash()
    if text == "operator":
        return drivers.OperatorFlash(_ask, brightness)
    if "{state}" not in text:
        raise OptionError(
            f"--flash {text}: write property, operator, or a command or URL in which {{state}} "
            "becomes on or off."
        )
    return drivers.ExternalFlash(text, brightness, settle_s)


def _ask(request: str, timeout_s: float) -> bool:
    """Ask on the terminal; Enter confirms."""
    print(f"{request.removesuffix(', then confirm.')}, then press Enter.", file=sys.stderr)
    return _enter_within(timeout_s)


def ask_once() -> Callable[[str, float], bool]:
    """Make what puts each request on the terminal once, however often it is asked."""
    last = ""

    def ask(request: str, timeout_s: float) -> bool:
        nonlocal last
        if request == last:
            return _enter_within(timeout_s)
        last = request
        return _ask(request, timeout_s)

    return ask


def _enter_within(seconds: float) -> bool:
    ready, _, _ = select.select([sys.stdin], [], [], seconds)
    return bool(ready and sys.stdin.readline())
