"""What of a job the operator's settings allow: the webhook that it tells, the camera that it uses.

They may have changed since an earlier job like it.
"""

from __future__ import annotations

from pipeline.errors import OptionError
from service.addresses import ForbiddenAddressError, check_url, parse_networks
from service.capture import FlashStrategy
from service.errors import ForeignCameraError
from service.settings import Settings


def check_webhook(settings: Settings, url: str | None) -> None:
    """Refuse a webhook that is not called; None: there is none. Raises OptionError."""
    if url is None:
        return
    try:
        check_url(url, parse_networks(settings.webhook_private), settings.webhook_https)
    except ForbiddenAddressError as error:
        raise OptionError(f"webhook.url: {error}.") from error


def is_camera_allowed(settings: Settings, address: str) -> bool:
    """Whether the operator allows a camera: by its address, or its beginning up to :, / or ?."""
    for allowed in settings.cameras.split():
        rest = address.removeprefix(allowed)
        whole = rest == "" or allowed.endswith("://") or rest[0] in ":/?"
        if address.startswith(allowed) and whole:
            return True
    return False


def check_camera(settings: Settings, address: str) -> None:
    """Refuse a camera that the operator has not allowed. Raises ForeignCameraError."""
    if not is_camera_allowed(settings, address):
        raise ForeignCameraError(
            "This camera is none that jobs of this service may name; its operator can allow it in "
            "LIGHTLAYERS_CAMERAS."
        )


def check_flash(settings: Settings, flash: FlashStrategy) -> None:
    """Refuse the operator's switch where there is none. Raises OptionError."""
    if flash == "external" and settings.flash_switch is None:
        raise OptionError(
            "flash: this service has no switch for a flash; its operator can name one in "
            "LIGHTLAYERS_FLASH_SWITCH."
        )
