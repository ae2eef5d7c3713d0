"""The process that libgphoto2 works in: python -m drivers.gphoto.child.

Calls come on stdin, answers go to stdout, each a pickle after its length. A driver of libgphoto2
may print, so that stdout is taken away from it.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import sys
import time
from collections.abc import Iterator
from typing import Any

import gphoto2 as gp

from drivers.camera import (
    CameraObject,
    Event,
    EventKind,
    Setting,
    SettingName,
    SettingValue,
    kind_of_name,
)
from drivers.contract import MOST_EVENTS, lacking, not_offered, require_writable
from drivers.errors import (
    CameraBusyError,
    CameraDisconnectedError,
    CameraNotFoundError,
    CaptureError,
    DriverError,
    SettingError,
)
from drivers.gphoto import names
from drivers.gphoto.messages import LENGTH, ROOT, packed

_CHUNK_BYTES = 1 << 20
_TARGET, _CARD = "capturetarget", "card"  # as in "Memory card" and "card"
_TARGET_LOOKS = 10  # how often it is read back: a camera may take a moment to change it
_TARGET_PAUSE_S = 0.1
_EVENTS = {
    gp.GP_EVENT_FILE_ADDED: EventKind.OBJECT_ADDED,
    gp.GP_EVENT_CAPTURE_COMPLETE: EventKind.CAPTURE_COMPLETE,
}


class Calls:
    """One camera of libgphoto2; its methods are those of drivers.camera.Camera, nearly."""

    def __init__(self) -> None:
        self._camera = gp.Camera()
        self._handles: dict[str, int] = {}

    def open(self, port: str) -> None:
        """Open the camera at a port of libgphoto2, or the first one.

        Raises SettingError where it does not put its photographs onto its card.
        """
        if port:
            ports = gp.PortInfoList()
            ports.load()
            self._camera.set_port_info(ports[ports.lookup_path(port)])
            if port.startswith("ptpip:"):
                models = gp.CameraAbilitiesList()
                models.load()
                self._camera.set_abilities(models[models.lookup_model("PTP/IP Camera")])
        self._camera.init()
        try:
            self._store_on_card()
        except BaseException:
            self._camera.exit()
            raise

    def _store_on_card(self) -> None:
        """Have photographs go to the card, and not to the computer, where the list never has them.

        Canon's go to the computer unless told otherwise. Other cameras have no such choice.
        """
        try:
            widget = self._camera.get_single_config(_TARGET)
            cards = [text for text in widget.get_choices() if _CARD in text.lower()]
        except gp.GPhoto2Error:
            return
        if not cards or widget.get_value() in cards:
            return
        try:
            widget.set_value(cards[0])
            self._camera.set_single_config(_TARGET, widget)
            for _ in range(_TARGET_LOOKS):
                if self._camera.get_single_config(_TARGET).get_value() in cards:
                    return
                time.sleep(_TARGET_PAUSE_S)
            reason = "it keeps them for the computer"
        except gp.GPhoto2Error as error:
            reason = error.string
        raise SettingError(
            f"The camera does not put its photographs onto its memory card ({reason}): insert a "
            "card, choose it in the camera's menu and try again."
        )

    def info(self) -> tuple[str, str, str, int | None, int | None]:
        """Make, model, serial, battery, room on the cards."""
        texts = {
            name: self._text(name)
            for name in ("manufacturer", "cameramodel", "serialnumber", "batterylevel")
        }
        battery = texts["batterylevel"].rstrip("% ")
        return (
            texts["manufacturer"],
            texts["cameramodel"],
            texts["serialnumber"],
            int(battery) if battery.isdecimal() else None,
            self._free_bytes(),
        )

    def _free_bytes(self) -> int | None:
        """Ask for the room on the cards: other answers come from a camera that is gone, too."""
        try:
            stores = self._camera.get_storageinfo()
        except gp.GPhoto2Error as error:
            if error.code == gp.GP_ERROR_NOT_SUPPORTED:
                return None
            raise explain(error, "info") from error
        told = [store for store in stores if store.fields & gp.GP_STORAGEINFO_FREESPACEKBYTES]
        return 1024 * sum(store.freekbytes for store in told) if told else None

    def _text(self, name: str) -> str:
        try:
            return str(self._camera.get_single_config(name).get_value())
        except gp.GPhoto2Error:
            return ""

    def settings(self) -> list[Setting]:
        """Those settings that the camera has."""
        found = []
        for name in SettingName:
            try:
                found.append(self.read(name))
            except SettingError:
                continue
        return found

    def read(self, name: SettingName) -> Setting:
        """One setting."""
        widget = self._widget(name)
        choices: tuple[SettingValue, ...] = ()
        if _is_list(widget):
            choices = tuple(names.decode(name, text) for text in widget.get_choices())
        value = names.decode(name, str(widget.get_value()))
        return Setting(name, value, choices, not widget.get_readonly())

    def write(self, name: SettingName, value: SettingValue) -> None:
        """Set one setting to the choice that means the value, or to the value itself."""
        widget = self._widget(name)
        require_writable(name, value, not widget.get_readonly())
        if _is_list(widget):
            texts = [text for text in widget.get_choices() if names.decode(name, text) == value]
            if not texts:
                offered = (names.decode(name, text) for text in widget.get_choices())
                raise not_offered(name, value, offered)
            widget.set_value(texts[0])
        elif names.decode(name, str(widget.get_value())) == value:
            return  # what else may be written is not known
        elif widget.get_type() == gp.GP_WIDGET_RANGE and not isinstance(value, str):
            widget.set_value(float(value))
        else:
            raise SettingError(
                f"libgphoto2 does not say what {name} may be: set it to {value} on the camera "
                "itself."
            )
        with self._not_gone():
            self._camera.set_single_config(widget.get_name(), widget)

    def _widget(self, name: SettingName) -> Any:
        for candidate in names.WIDGETS[name]:
            try:
                return self._camera.get_single_config(candidate)
            except gp.GPhoto2Error:
                continue
        self._free_bytes()  # a camera that is gone seems to lack its settings, too
        raise lacking(name)

    @contextlib.contextmanager
    def _not_gone(self) -> Iterator[None]:
        """Let an error stand as a refusal only where the camera still answers."""
        try:
            yield
        except gp.GPhoto2Error:
            self._free_bytes()
            raise

    def list_folder(self, folder: str) -> tuple[set[int], list[str]]:
        """Handles of the files in a folder, and the folders in it; a path keeps its handle."""
        prefix = folder.rstrip("/")
        names = sorted(name for name, _ in self._camera.folder_list_files(folder))
        paths = [f"{prefix}/{name}" for name in names]
        for path in paths:
            self._handles.setdefault(path, len(self._handles) + 1)
        folders = [f"{prefix}/{name}" for name, _ in self._camera.folder_list_folders(folder)]
        return {self._handles[path] for path in paths}, sorted(folders)

    def describe(self, handle: int) -> CameraObject:
        """Kind, size, name and card."""
        folder, name = self._place(handle)
        size = self._camera.file_get_info(folder, name).file.size
        card = folder.split("/")[1]  # as in /store_00010001/DCIM/100CANON
        return CameraObject(handle, kind_of_name(name), size, name, card)

    def delete(self, handle: int) -> None:
        """Delete a file."""
        self._camera.file_delete(*self._place(handle))

    def check_release(self) -> None:
        """Look whether libgphoto2 can release it: of many cameras it only fetches photographs."""
        releases = gp.GP_OPERATION_CAPTURE_IMAGE | gp.GP_OPERATION_TRIGGER_CAPTURE
        if not self._camera.get_abilities().operations & releases:
            raise SettingError(
                "libgphoto2 cannot release this camera, it only fetches its photographs: take the "
                "pair by hand and send its files, or use another camera."
            )

    def trigger(self) -> None:
        """Press the release."""
        with self._not_gone():
            self._camera.trigger_capture()

    def events(self, timeout_s: float) -> list[Event]:
        """Everything told; libgphoto2 gives one event at a time."""
        told: list[Event] = []
        while len(told) < MOST_EVENTS:
            kind, _ = self._camera.wait_for_event(0 if told else round(1000 * timeout_s))
            if kind == gp.GP_EVENT_TIMEOUT:
                break
            told.append(Event(_EVENTS.get(kind, EventKind.OTHER)))
        return told

    def chunk(self, handle: int, offset: int) -> bytes | None:
        """Some bytes of a file; None from a camera that gives files as a whole alone."""
        buffer, place = bytearray(_CHUNK_BYTES), self._place(handle)
        try:
            count = self._camera.file_read(*place, gp.GP_FILE_TYPE_NORMAL, offset, buffer)
        except gp.GPhoto2Error as error:
            if error.code == gp.GP_ERROR_NOT_SUPPORTED:
                return None
            raise
        return bytes(buffer[:count])

    def whole(self, handle: int) -> bytes:
        """All bytes of a file."""
        file = self._camera.file_get(*self._place(handle), gp.GP_FILE_TYPE_NORMAL)
        return bytes(file.get_data_and_size())

    def close(self) -> None:
        """Give the camera back."""
        self._camera.exit()

    def _place(self, handle: int) -> tuple[str, str]:
        path = next(path for path, known in self._handles.items() if known == handle)
        folder, _, name = path.rpartition("/")
        return folder or ROOT, name


def _is_list(widget: Any) -> bool:
    return widget.get_type() in (gp.GP_WIDGET_RADIO, gp.GP_WIDGET_MENU)


def explain(error: gp.GPhoto2Error, method: str) -> DriverError:
    """Turn an error of libgphoto2 into one of the drivers."""
    if error.code in (gp.GP_ERROR_CAMERA_BUSY, gp.GP_ERROR_IO_USB_CLAIM, gp.GP_ERROR_IO_LOCK):
        return CameraBusyError(
            "The camera is busy or in use by another program: close that one and try again."
        )
    if method == "open":
        return CameraNotFoundError(
            f"libgphoto2 finds no camera there ({error.string}): switch it on, connect it and try "
            "again."
        )
    if method == "trigger":
        return CaptureError(
            f"The camera did not release ({error.string}): check focus, card and flash and try "
            "again."
        )
    if method in ("read", "write"):
        return SettingError(
            f"The camera refused a setting ({error.string}): set it on the camera itself."
        )
    return CameraDisconnectedError(
        f"The connection to the camera broke ({error.string}): connect it again and take the pair "
        "anew."
    )


def main() -> None:
    """Answer calls until stdin ends."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # they are for the driver, which then closes
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    calls = Calls()
    while head := sys.stdin.buffer.read(LENGTH.size):
        method, arguments = pickle.loads(sys.stdin.buffer.read(LENGTH.unpack(head)[0]))
        try:
            answer = ("result", getattr(calls, method)(*arguments))
        except gp.GPhoto2Error as error:
            told = explain(error, method)
            answer = ("error", (type(told).__name__, str(told)))
        except DriverError as error:
            answer = ("error", (type(error).__name__, str(error)))
        answers.write(packed(answer))
        answers.flush()


if __name__ == "__main__":
    main()
