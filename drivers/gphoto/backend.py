"""Cameras that only libgphoto2 knows, behind a process of their own.

libgphoto2 hangs on some faults of cameras, so that it works in a child process, and every call has
a deadline after which the child is ended.
"""

from __future__ import annotations

import contextlib
import importlib.util
import pickle
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

from drivers import errors
from drivers.camera import (
    Camera,
    CameraInfo,
    CameraObject,
    Event,
    Setting,
    SettingName,
    SettingValue,
    meant,
)
from drivers.contract import require_kept, require_size
from drivers.errors import (
    BadAddressError,
    CameraDisconnectedError,
    CameraTimeoutError,
    MissingPackageError,
)
from drivers.gphoto.messages import LENGTH, ROOT, packed

CALL_S = 20.0
"""How long a call may take, in seconds, beyond the wait that it was asked for."""

FIRST_LISTING_S = 180.0
"""How much longer a folder may take that is listed for the first time, in seconds.

libgphoto2 then asks about each file by itself, and remembers the answers.
"""

SLOWEST = 500_000
"""Bytes a second that a file may come with from a camera that gives no parts of it."""

_DEEPEST = 16  # folders in each other; no camera has more, but one with nonsense may tell of more
_PORTS = ("usb", "ptpip")  # others would read files of this computer, or its serial ports


class GphotoCamera(Camera):
    """A camera behind the child process. call_s: seconds that a call may take.

    Raises CameraDisconnectedError where the child cannot be started, and what opening the camera
    raises.
    """

    def __init__(self, address: str, port: str, call_s: float = CALL_S) -> None:
        self._address, self._call_s = address, call_s
        self._child: subprocess.Popen[bytes] | None = None
        self._owed = False  # whether the answer to an interrupted call is still to come
        self._received = bytearray()  # of the answer under way
        self._listed = set[str]()
        self._told: list[Event] = []
        try:
            self._child = subprocess.Popen(
                [sys.executable, "-m", "drivers.gphoto.child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            raise CameraDisconnectedError(
                "The process that libgphoto2 works in cannot be started here "
                f"({(error.strerror or 'unknown reason').lower()}): mend that, or end other "
                "programs if the computer has no room for it, and try again."
            ) from error
        try:
            self._call("open", port)
        except BaseException:
            self._end()
            raise

    @property
    def address(self) -> str:
        """The address it was opened by."""
        return self._address

    def info(self) -> CameraInfo:
        """Make, model, serial number, battery and room on the cards."""
        return CameraInfo(self._address, *self._call("info"))

    def settings(self) -> list[Setting]:
        """Every setting of SettingName that this camera has."""
        settings: list[Setting] = self._call("settings")
        return settings

    def read(self, name: SettingName) -> Setting:
        """Read one setting. Raises SettingError where the camera has none of that name."""
        setting: Setting = self._call("read", name)
        return setting

    def write(self, name: SettingName, value: SettingValue) -> Setting:
        """Write one setting and read it back.

        Raises SettingError where it is missing, read-only, refused, or reads back otherwise.
        """
        wanted = meant(name, value, self.read(name).choices)
        self._call("write", name, wanted)
        setting = self.read(name)
        require_kept(wanted, setting)
        return setting

    def objects(self) -> set[int]:
        """List the handles of everything on the card; libgphoto2 has paths for them."""
        # libgphoto2 lists what it knows, and learns of files by asking for events alone
        self._told = self.events(0.0)
        handles, folders = set[int](), [ROOT]
        while folders:
            found, inside = self._list(folder := folders.pop(0))
            handles |= found
            folders += inside if folder.count("/") < _DEEPEST else []
        return handles

    def _list(self, folder: str) -> tuple[set[int], list[str]]:
        first = folder not in self._listed
        try:
            listed: tuple[set[int], list[str]] = self._call(
                "list_folder", folder, patience_s=FIRST_LISTING_S if first else 0.0
            )
        except CameraTimeoutError as error:
            if not first:
                raise
            raise CameraTimeoutError(
                f"libgphoto2 could not list the folder {folder} of the camera in "
                f"{self._call_s + FIRST_LISTING_S:.0f} s: its card holds many photographs: empty "
                "it, switch the camera off and on and take the pair anew."
            ) from error
        self._listed.add(folder)
        return listed

    def describe(self, handle: int) -> CameraObject:
        """Kind, size and name of an object."""
        described: CameraObject = self._call("describe", handle)
        return described

    def delete(self, handle: int) -> None:
        """Delete an object from the card."""
        self._call("delete", handle)

    def check_release(self) -> None:
        """Look whether libgphoto2 can release this camera. Raises SettingError."""
        self._call("check_release")

    def trigger(self) -> None:
        """Press the release; returns at once, the photograph comes later."""
        self._call("trigger")

    def events(self, timeout_s: float) -> list[Event]:
        """Every event waiting; if there is none, the first that comes within timeout_s seconds."""
        told, self._told = self._told, []
        wait_s = 0.0 if told else timeout_s
        told += self._call("events", wait_s, patience_s=wait_s)
        return told

    def download(
        self, handle: int, offset: int = 0, into: memoryview | None = None
    ) -> Iterator[bytes]:
        """Chunks of an object's bytes from offset to its end.

        into: room for just the whole object, where each chunk is put in its place. Raises
        TransferError where a chunk comes incomplete, or the object has another size than into.
        """
        size = self.describe(handle).size
        require_size(size, into)
        while offset < size:
            chunk: bytes | None = self._call("chunk", handle, offset)
            if chunk is None:
                chunk = self._call("whole", handle, patience_s=size / SLOWEST)[offset:]
            if not 0 < len(chunk) <= size - offset:
                raise errors.TransferError(
                    f"The camera sent {len(chunk)} bytes where {size - offset} are left of a "
                    "photograph: take the pair again."
                )
            if into is not None:
                into[offset : offset + len(chunk)] = chunk
            offset += len(chunk)
            yield chunk

    def close(self) -> None:
        """Give the camera back. Closing twice is fine."""
        try:
            if self._child:
                with contextlib.suppress(errors.DriverError):
                    self._call("close")
        finally:
            self._end()

    def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:
        child = self._child
        if child is None or child.stdin is None or child.stdout is None:
            raise CameraDisconnectedError("The camera was closed: open it again.")
        deadline = time.monotonic() + self._call_s + patience_s
        try:
            if self._owed:
                child.stdin.flush()
                self._answer(deadline)
            self._owed = True
            child.stdin.write(packed((method, arguments)))
            child.stdin.flush()
            kind, answer = self._answer(deadline)
        except (OSError, EOFError) as error:
            self._end()
            raise CameraDisconnectedError(
                "libgphoto2 crashed over the camera: switch the camera off and on and try again."
            ) from error
        if kind == "error":
            raise getattr(errors, answer[0])(answer[1])
        return answer

    def _answer(self, deadline: float) -> tuple[str, Any]:
        """Take the next answer; what came of one is kept where this is interrupted."""
        self._read(LENGTH.size, deadline)
        (length,) = LENGTH.unpack_from(self._received)
        self._read(LENGTH.size + length, deadline)
        raw = bytes(self._received[LENGTH.size :])
        self._owed = False
        self._received.clear()
        answer: tuple[str, Any] = pickle.loads(raw)  # from our own child
        return answer

    def _read(self, count: int, deadline: float) -> None:
        """Have so many bytes of the answer."""
        child, data = self._child, self._received
        assert child is not None and child.stdout is not None
        while len(data) < count:
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([child.stdout], [], [], left)[0]:
                self._end()
                raise CameraTimeoutError(
                    f"libgphoto2 got no answer from the camera for {self._call_s:.0f} s: switch "
                    "the camera off and on and take the pair anew."
                )
            part = child.stdout.raw.read(count - len(data))  # type: ignore[attr-defined]
            if not part:
                raise EOFError
            data += part

    def _end(self) -> None:
        child, self._child = self._child, None
        if child:
            child.kill()
            for pipe in (child.stdin, child.stdout):
                with contextlib.suppress(OSError):
                    if pipe:
                        pipe.close()
            child.wait()


def open_camera(address: str) -> Camera:
    """Open the camera at gphoto2://PORT, or the first that libgphoto2 finds at gphoto2://."""
    check_address(address)
    if importlib.util.find_spec("gphoto2") is None:
        raise MissingPackageError(
            "The Python package gphoto2 is missing here: install it by make setup in the folder of "
            "lightlayers, or by python -m pip install 'gphoto2>=2.6,<3' with the Python that "
            "lightlayers runs in."
        )
    return GphotoCamera(address, _port(address))


def check_address(address: str) -> None:
    """Read the address. Raises BadAddressError."""
    port = _port(address)
    if port and port.partition(":")[0] not in _PORTS:
        raise BadAddressError(
            f"{address!r} is no camera that libgphoto2 may open: write gphoto2://usb:BUS,DEVICE, "
            "gphoto2://ptpip:HOST:PORT:PORT, or gphoto2:// for the first that it finds."
        )


def list_cameras() -> list[CameraInfo]:
    """List none: what libgphoto2 could find on USB is listed by the driver of USB cameras."""
    return []


def _port(address: str) -> str:
    return address.partition("://")[2]
