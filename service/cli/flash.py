"""What switches the flash of a camera that the command line drives."""

from __future__ import annotations

import select
import sys

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
    try:
        drivers.check_flash_order(text)
    except ValueError as error:
        raise OptionError(
            f"--flash {text} is neither property nor operator, and no command or URL for a flash: "
            f"{error}."
        ) from error
    return drivers.ExternalFlash(text, brightness, settle_s)


def _ask(request: str, timeout_s: float) -> bool:
    """Ask on the terminal; Enter confirms."""
    print(f"{request.removesuffix(', then confirm.')}, then press Enter.", file=sys.stderr)
    ready, _, _ = select.select([sys.stdin], [], [], timeout_s)
    return bool(ready and sys.stdin.readline())
