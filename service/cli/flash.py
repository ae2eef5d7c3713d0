"""What switches the flash of a camera that the command line drives."""

from __future__ import annotations

from collections.abc import Callable

import drivers
from service.cli.enter import await_enter, forget_typed
from service.cli.files import say


def flash_switch(text: str, settle_s: float, tell: Callable[[str], None] = say) -> drivers.Flash:
    """Read --flash: "property", "operator", or a command or URL with {state} in it.

    settle_s: how long a flash takes to obey, in seconds. tell: says what the operator is to do.
    Raises pipeline.errors.OptionError.
    """
    from pipeline.errors import OptionError
    from service.workers.camera_tasks import brightness

    if text == "property":
        return drivers.PropertyFlash()
    if text == "operator":

        def ask(request: str, timeout_s: float) -> bool:
            forget_typed()
            tell(f"{request.removesuffix(', then confirm.')}, then press Enter.")
            return await_enter(timeout_s)

        return drivers.OperatorFlash(ask, brightness)
    try:
        drivers.check_flash_order(text)
    except ValueError as error:
        raise OptionError(
            f"--flash {text} is neither property nor operator, and no command or URL for a flash: "
            f"{error}."
        ) from error
    return drivers.ExternalFlash(text, brightness, settle_s)
