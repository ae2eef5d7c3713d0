"""The simulated camera's body: settings, shutter, memory card and the faults it was given."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.ptp.codes import DataType, EventCode, ObjectFormat, Property, Response
from drivers.ptp.datasets import Form, ObjectInfo, PropertyDescription
from drivers.sim.address import SimulatedCamera
from drivers.sim.files import Shooting, write_dng, write_jpeg
from drivers.sim.render import Image
from drivers.sim.scene import load_scene
from drivers.sim.sensor import BASE_ISO, digitise
from drivers.sim.studio import Studio

STORAGE = 0x00010001
FOLDER = 1
"""Handle of the folder that all photographs go into."""

_WRITE_S = 0.2  # from the end of the exposure to the card
_BUSY_RELEASES = 2
_FLASH_FIRES = (3, 5)  # fill, red-eye fill
_ROWS = 256  # read out at once

_METERED_TIME = Fraction(1, 50)
_METERED_F_NUMBER = 8
"""Settings for which the studio's light is metered, at base ISO."""


class Refusal(Exception):  # noqa: N818  an answer, not an error
    """The camera refuses with a response code."""

    def __init__(self, response: Response) -> None:
        super().__init__(response.name)
        self.response = response


@dataclass(frozen=True)
class StoredObject:
    """A file or folder on the card."""

    info: ObjectInfo
    data: bytes


class Body:
    """State of the camera between the operations of the protocol."""

    def __init__(self, options: SimulatedCamera, clock: Clock) -> None:
        self.fault = options.fault
        self.properties = {description.code: description for description in _properties()}
        if self.fault == "flash_locked":
            locked = replace(self.properties[Property.FLASH_MODE], writable=False)
            self.properties[Property.FLASH_MODE] = locked
        folder = ObjectInfo(STORAGE, ObjectFormat.ASSOCIATION, 0, 0, 0, 0, "100STUDI", "")
        self.objects = {FOLDER: StoredObject(folder, b"")}
        self.events: deque[tuple[EventCode, int]] = deque()
        self._options, self._clock = options, clock
        self._last_handle = FOLDER
        self._releases = 0
        self._refused = 0
        self._due: float | None = None
        self._light: tuple[Image, Image] | None = None

    def set_property(self, code: int, value: int) -> None:
        """Set a property. Raises Refusal for values that it does not offer."""
        description = self.properties[code]
        if not description.writable:
            raise Refusal(Response.ACCESS_DENIED)
        if value not in description.values:
            raise Refusal(Response.INVALID_PROP_VALUE)
        self.properties[code] = replace(description, current=value)

    def release(self) -> None:
        """Press the release; the photograph is on the card when its time has come."""
        if self.fault == "focus":
            raise Refusal(Response.NIKON_OUT_OF_FOCUS)
        self._refused += 1
        briefly = self.fault == "busy_briefly" and self._refused <= _BUSY_RELEASES
        if briefly or self.fault == "busy" or self._due is not None:
            raise Refusal(Response.DEVICE_BUSY)
        exposure_s = float(self._shooting().time_s)
        self._due = self._clock.monotonic() + exposure_s + _WRITE_S

    def seconds_to_wait(self) -> float | None:
        """Until the photograph under way is on the card; None if there is none."""
        return None if self._due is None else max(0.0, self._due - self._clock.monotonic())

    def advance(self) -> None:
        """Let happen what is due."""
        if self._due is None or self._clock.monotonic() < self._due:
            return
        self._due = None
        if self.fault == "store_full":
            self._tell(EventCode.STORE_FULL, STORAGE)
            return
        if self.fault == "no_photograph":
            return
        self._refused = 0
        self._releases += 1
        for kind, extension, data in self._photograph():
            self._last_handle += 1
            info = ObjectInfo(
                storage=STORAGE,
                format=kind,
                size=2 * len(data) if self.fault == "truncated" else len(data),
                width=self._options.width,
                height=self._options.height,
                parent=FOLDER,
                name=f"DSC_{self._releases:04}.{extension}",
                captured=self._clock.now().strftime("%Y%m%dT%H%M%S"),
            )
            self.objects[self._last_handle] = StoredObject(info, data)
            self._tell(EventCode.OBJECT_ADDED, self._last_handle)
        self._tell(EventCode.CAPTURE_COMPLETE, 0)

    def _tell(self, code: EventCode, parameter: int) -> None:
        if self.fault != "lost_events":
            self.events.append((code, parameter))

    def _photograph(self) -> list[tuple[ObjectFormat, str, bytes]]:
        shooting = self._shooting()
        raw = self._expose(shooting)
        files = []
        if self._options.format in ("dng", "both"):
            files.append((ObjectFormat.DNG, "DNG", write_dng(raw, shooting)))
        if self._options.format in ("jpeg", "both"):
            files.append((ObjectFormat.EXIF_JPEG, "JPG", write_jpeg(raw, shooting)))
        return files

    def _expose(self, shooting: Shooting) -> NDArray[np.uint16]:
        if self._light is None:
            self._light = Studio(self._options).sensor_light()
        lamps, flash = self._light
        opening = float(_METERED_F_NUMBER / shooting.f_number) ** 2
        of_lamps = np.float32(opening * float(shooting.time_s / _METERED_TIME))
        # a flash is far shorter than the exposure, so the time does not count
        of_flash = np.float32(opening if shooting.flash_fired else 0)
        noise = None
        if self._options.noise == "on":
            noise = np.random.default_rng((self._options.seed, self._releases))
        raw = np.empty(lamps.shape, np.uint16)
        for top in range(0, len(raw), _ROWS):
            rows = slice(top, top + _ROWS)
            light = lamps[rows] * of_lamps + flash[rows] * of_flash
            raw[rows] = digitise(light, shooting.iso, noise)
        return raw

    def _shooting(self) -> Shooting:
        value = {code: description.current for code, description in self.properties.items()}
        fires = value[Property.FLASH_MODE] in _FLASH_FIRES
        time_s = Fraction(value[Property.EXPOSURE_TIME], 10_000)
        if self.fault == "auto_exposure" and fires:
            time_s /= 2
        if self.fault in ("flash_dead", "flash_always"):
            fires = self.fault == "flash_always"
        return Shooting(
            time_s=time_s,
            f_number=Fraction(value[Property.F_NUMBER], 100),
            iso=value[Property.EXPOSURE_INDEX],
            flash_fired=fires,
            focal_35mm=load_scene(self._options.scene).view.focal_35mm,
            taken=self._clock.now(),
        )


def _properties() -> list[PropertyDescription]:
    """As the camera wakes up: automatic wherever that is usual."""

    def choice(code: Property, kind: DataType, now: int, *values: int) -> PropertyDescription:
        return PropertyDescription(code, kind, True, now, now, Form.ENUMERATION, values)

    u16, u32 = DataType.UINT16, DataType.UINT32
    return [
        PropertyDescription(Property.BATTERY_LEVEL, DataType.UINT8, False, 100, 87),
        choice(Property.WHITE_BALANCE, u16, 2, 2, 4, 5, 6, 7),
        choice(Property.F_NUMBER, u16, 800, 280, 400, 560, 800, 1100, 1600, 2200),
        choice(Property.FOCUS_MODE, u16, 2, 1, 2),
        choice(Property.FLASH_MODE, u16, 3, 2, 3, 5),
        choice(Property.EXPOSURE_TIME, u32, 200, 50, 100, 200, 400, 1000, 2000, 5000, 10000),
        choice(Property.EXPOSURE_PROGRAM, u16, 2, 1, 2, 3, 4),
        choice(Property.EXPOSURE_INDEX, u16, BASE_ISO, 100, 200, 400, 800, 1600, 3200, 6400),
        choice(Property.STILL_CAPTURE_MODE, u16, 1, 1, 2),
    ]
