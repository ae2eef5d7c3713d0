"""Ways to switch the flash between the two photographs of a pair.

Cameras differ most in this: many take no order for their flash, so that something or somebody
else must switch it. `check` looks before the first photograph whether that will work.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import shlex
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import httpx

from drivers.camera import Camera, SettingName, SettingValue
from drivers.clock import Clock
from drivers.errors import FlashError, SettingError, UnconfirmedError
from drivers.look_up import LookUpLoop

log = logging.getLogger("drivers.flash")

State = Literal["off", "on"]

_URLS = ("http://", "https://")

SWITCH_S = 10.0
"""How long a switch outside the camera may take to obey."""

OTHERWISE = (
    "have a switch of its own told (external over HTTP, its command or URL on the command line), "
    "or somebody asked between the photographs (operator)"
)


def check_flash_order(order: str) -> None:
    """Look whether an order for the flash says what state is wanted, and can be read.

    Raises ValueError with a clause, to be put into a sentence.
    """
    if "{state}" not in order:
        raise ValueError("write {state} where on or off is to stand")
    try:
        words = shlex.split(order)
    except ValueError as error:
        raise ValueError(f"the command cannot be read ({str(error).lower()})") from error
    if "://" in words[0] and not order.startswith(_URLS):
        raise ValueError("a URL begins with http:// or https://")


class Flash(ABC):
    """Something that switches the flash.

    brightness: tells how bright a photograph is, linear, 1 where it is white, to check the pair by
    where the camera does not know of the flash; None where its EXIF must tell.
    """

    brightness: Callable[[bytes], float] | None = None

    @abstractmethod
    def check(self, camera: Camera) -> None:
        """Look whether this will work. Raises SettingError, FlashError."""

    @abstractmethod
    def switch(self, camera: Camera, state: State, clock: Clock) -> None:
        """Switch the flash for the next photograph. Raises SettingError, FlashError."""

    def leave_off(self) -> None:  # noqa: B027  most flashes give no light between photographs
        """Switch off what would stay on after the pair; a failure is told to the log alone."""


class PropertyFlash(Flash):
    """The camera's own setting."""

    def check(self, camera: Camera) -> None:
        """Look whether the camera offers a mode without and one that always fires."""
        if SettingName.FLASH not in {setting.name for setting in camera.settings()}:
            raise SettingError(f"The camera lets no computer switch its flash: {OTHERWISE}.")
        setting = camera.read(SettingName.FLASH)
        if not setting.writable:
            raise SettingError(f"The camera's flash can be set on the camera alone: {OTHERWISE}.")
        offered = ", ".join(map(str, setting.choices))
        if setting.choices and "off" not in setting.choices:
            raise SettingError(
                f"The camera's flash cannot be switched off from a computer, it offers {offered}: "
                f"{OTHERWISE}."
            )
        _firing(setting.choices)

    def switch(self, camera: Camera, state: State, clock: Clock) -> None:  # noqa: ARG002
        """Set it."""
        choices = camera.read(SettingName.FLASH).choices
        camera.write(SettingName.FLASH, "off" if state == "off" else _firing(choices))


@dataclass(frozen=True)
class ExternalFlash(Flash):
    """A relay, a radio trigger or the like, told by a command or a URL.

    order: a command, which no shell sees, or an http(s) URL, which is fetched; {state} in it
    becomes on or off. settle_s: how long the flash takes to obey or to charge, in seconds.
    """

    order: str
    brightness: Callable[[bytes], float]
    settle_s: float = 1.0

    def check(self, camera: Camera) -> None:  # noqa: ARG002
        """Look whether the order says what state is wanted."""
        try:
            check_flash_order(self.order)
        except ValueError as error:
            raise FlashError(f"The order for the flash cannot be used: {error}.") from error

    def switch(self, camera: Camera, state: State, clock: Clock) -> None:  # noqa: ARG002
        """Give the order and let the flash settle."""
        _give(self.order, state)
        clock.sleep(self.settle_s)

    def leave_off(self) -> None:
        """Order it off. Neither the pair nor what it failed by is lost where that fails."""
        leave_flash_off(self.order)


def leave_flash_off(order: str) -> None:
    """Give an order of ExternalFlash for "off", also for a capture that was cut short.

    A failure is told to the log alone. What interrupts it has the order given once more.
    """
    try:
        _give(order, "off")
    except FlashError as error:
        log.warning("The flash was not switched off after the pair. %s", error)
    except BaseException:  # Ctrl-C: it may have cut off the order
        with contextlib.suppress(FlashError):
            _give(order, "off")
        raise


def _give(order: str, state: State) -> None:
    if order.startswith(_URLS):
        _fetch(order.replace("{state}", state))
    else:
        _run([part.replace("{state}", state) for part in shlex.split(order)])


def _fetch(url: str) -> None:
    try:
        with asyncio.Runner(loop_factory=LookUpLoop) as runner:
            # run() would leave a Ctrl-C in a task that nobody asks for it, which is then logged
            runner.get_loop().run_until_complete(_fetch_whole(url))
    except httpx.HTTPStatusError as error:
        raise FlashError(
            f"The switch of the flash answers {error.response.status_code}: check its URL and "
            "try again."
        ) from error
    # the third: of a host
    except (httpx.HTTPError, httpx.InvalidURL, UnicodeError, TimeoutError) as error:
        if "CERTIFICATE_VERIFY_FAILED" in str(error):
            raise FlashError(
                "The certificate of the flash's switch is none that this computer trusts: have it "
                "trusted (SSL_CERT_FILE), or use http:// where the network is your own."
            ) from error
        raise FlashError(
            "The switch of the flash does not answer: check that it is on, and its URL, and "
            "try again."
        ) from error


async def _fetch_whole(url: str) -> None:
    async with (
        asyncio.timeout(SWITCH_S),  # drop by drop is no longer
        httpx.AsyncClient(timeout=SWITCH_S, follow_redirects=False) as client,
        client.stream("GET", url) as answer,
    ):
        answer.raise_for_status()
        async for _ in answer.aiter_raw():  # it may have obeyed at the end alone
            pass


def _run(command: list[str]) -> None:
    try:
        # To no pipe: what the command leaves running would hold it, and be waited for.
        nowhere = subprocess.DEVNULL
        subprocess.run(
            command,
            check=True,
            timeout=SWITCH_S,
            stdin=nowhere,
            stdout=nowhere,
            stderr=nowhere,
        )
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        raise FlashError(
            f"The command that switches the flash failed, {_reason(error)}: run it by hand, "
            "mend it and try again."
        ) from error


def _reason(error: Exception) -> str:
    """What became of a command, as people say it."""
    match error:
        case subprocess.CalledProcessError(returncode=code) if code < 0:
            return f"as signal {-code} ended it"
        case subprocess.CalledProcessError(returncode=code):
            return f"with exit status {code}"
        case subprocess.TimeoutExpired():
            return f"as it did not end within {SWITCH_S:g} seconds"
        case OSError(strerror=str(words)):
            return f"as it cannot be run ({words.lower()})"
    return "as it cannot be run"


@dataclass(frozen=True)
class OperatorFlash(Flash):
    """A person at the camera.

    ask: puts a request to the person and waits at most timeout_s seconds; true once it is
    confirmed, false where nobody did.
    """

    ask: Callable[[str, float], bool]
    brightness: Callable[[bytes], float]
    timeout_s: float = 300.0

    def check(self, camera: Camera) -> None:
        """A person can always be asked."""

    def switch(self, camera: Camera, state: State, clock: Clock) -> None:  # noqa: ARG002
        """Ask."""
        if not self.ask(f"Switch the flash {state}, then confirm.", self.timeout_s):
            raise UnconfirmedError(
                f"Nobody confirmed that the flash is {state}: take the pair again with somebody at "
                "the camera."
            )


def _firing(choices: tuple[SettingValue, ...]) -> SettingValue:
    for mode in ("fill", "external"):
        if mode in choices or not choices:
            return mode
    raise SettingError(
        "The camera offers no flash mode that always fires: put up or attach its flash, or "
        f"{OTHERWISE}."
    )
