"""A camera that may go and come back: unplugged, switched off, at another place on its bus."""

from __future__ import annotations

from collections.abc import Callable

from drivers.camera import Camera
from drivers.clock import Clock, SystemClock
from drivers.errors import BadAddressError, CameraNotFoundError, DriverError, MissingPackageError
from drivers.registry import check_address, open_camera

LOOK_S = 0.5
"""How often a camera that is away is looked for, in seconds."""


class ReturningCamera:
    """The camera at an address, opened whenever it is needed and not open.

    tell: gets a sentence when it is waited for, and when it is there again. The camera that was
    there first is meant: another one at its address, by serial number, is none. Raises
    BadAddressError, CameraNotFoundError where no camera could ever be.
    """

    def __init__(
        self, address: str, tell: Callable[[str], None], clock: Clock | None = None
    ) -> None:
        check_address(address)
        self._address, self._tell = address, tell
        self._clock = clock or SystemClock()
        self._camera: Camera | None = None
        self._serial: str | None = None

    def connected(
        self, wait_s: float = 0.0, pause: Callable[[float], None] | None = None
    ) -> Camera:
        """Give the camera, which has answered just now.

        wait_s: how long it may be away or answer strangely, in seconds. pause: waits for so many
        seconds between looks, in place of the clock; what it raises ends the waiting. Raises what
        open_camera and Camera.info raise.
        """
        if self._camera and not self._answers(self._camera):
            self.close()
        if self._camera is None:
            self._camera = self._await(wait_s, pause or self._clock.sleep)
        return self._camera

    def close(self) -> None:
        """Let go of the camera; it is opened anew when it is needed."""
        camera, self._camera = self._camera, None
        if camera:
            camera.close()

    def _answers(self, camera: Camera) -> bool:
        try:
            camera.info()
        except DriverError:
            return False
        return True

    def _await(self, wait_s: float, pause: Callable[[float], None]) -> Camera:
        deadline, told = self._clock.monotonic() + wait_s, ""
        while True:
            try:
                camera = self._open()
            except (BadAddressError, MissingPackageError):  # which no waiting mends
                raise
            except DriverError as error:  # a strange answer may pass as an absence does
                if self._clock.monotonic() >= deadline:
                    raise
                if str(error) != told:
                    told = str(error)
                    self._tell(f"{told} It is waited for.")
                pause(LOOK_S)
                continue
            if told:
                self._tell("The camera is there.")
            return camera

    def _open(self) -> Camera:
        camera = open_camera(self._address)
        try:
            serial = camera.info().serial
            if self._serial not in (None, serial):
                raise CameraNotFoundError(
                    f"The camera at {self._address} is another one (serial number {serial} in "
                    f"place of {self._serial}): connect the one that was there."
                )
        except BaseException:
            camera.close()
            raise
        self._serial = serial
        return camera
