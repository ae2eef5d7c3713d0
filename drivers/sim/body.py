"""The simulated camera's body: settings, shutter, memory card and the faults it was given."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.ptp.codes import EventCode, ObjectFormat, Property, Response
from drivers.ptp.datasets import ObjectInfo
from drivers.sim.address import SimulatedCamera
from drivers.sim.faults import Fault
from drivers.sim.files import Shooting, write_dng, write_jpeg
from drivers.sim.model import load_model
from drivers.sim.render import Image
from drivers.sim.scene import load_scene
from drivers.sim.sensor import digitise
from drivers.sim.studio import Studio

STORAGE = 0x00010001
FOLDER = 1
"""Handle of the folder that all photographs go into."""

CARD_BYTES = 2 * 10**9
PHOTOGRAPH_BYTES = 30 * 10**6
"""What the camera reckons for a photograph that still has to fit."""

_BUSY_RELEASES = 2
_FLASH_FIRES = (3, 5)  # fill, red-eye fill
_FORMATS = {"jpeg": 2, "dng": 3, "both": 6}  # as Nikon numbers fine JPEGs, RAW, and the two
_ROWS = 256  # read out at once

_METERED_TIME = Fraction(1, 50)
_METERED_F_NUMBER = 8
"""Settings for which the studio's light is metered, at base ISO."""


FlashSwitch = Literal["mode", "off", "external"]
"""The flash fires as its mode says, is switched off by hand, or is one the camera does not know."""


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
        self.fault: Fault = options.fault
        self.model = load_model(options.camera)
        self.properties = {int(item.code): item.describe() for item in self.model.properties}
        self.set_property(Property.COMPRESSION_SETTING, _FORMATS[options.format])
        folder = ObjectInfo(STORAGE, ObjectFormat.ASSOCIATION, 0, 0, 0, 0, "100STUDI", "")
        self.objects = {FOLDER: StoredObject(folder, b"")}
        self.events: deque[tuple[EventCode, int]] = deque()
        self.flash: FlashSwitch = "mode"
        self._options, self._clock = options, clock
        self._late: list[tuple[EventCode, int]] = []
        self._external = False
        self._last_handle = FOLDER
        self._releases = 0
        self._refused = 0
        self._due: float | None = None
        self._shooting: Shooting | None = None
        self._charged_at = clock.monotonic()
        self._misfired = False
        self._light: tuple[Image, Image] | None = None

    def writable(self, code: int) -> bool:
        """Tell whether a property can be set from a computer."""
        locked = self.fault == "flash_locked" and code == Property.FLASH_MODE
        return self.properties[code].writable and not locked

    def set_property(self, code: int, value: int) -> None:
        """Set a property. Raises Refusal for values that it does not offer."""
        description = self.properties[code]
        if not self.writable(code):
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
        now = self._clock.monotonic()
        shooting = self._set_up()
        if shooting.flash_fired:
            if now < self._charged_at:
                raise Refusal(Response.DEVICE_BUSY)
            self._charged_at = now + self.model.timing.recharge_s
        self.events.extend(self._late)
        self._late.clear()
        self._shooting = shooting
        self._due = now + float(shooting.time_s) + self.model.timing.write_s

    def seconds_to_wait(self) -> float | None:
        """Until the photograph under way is on the card; None if there is none."""
        return None if self._due is None else max(0.0, self._due - self._clock.monotonic())

    def advance(self) -> None:
        """Let happen what is due."""
        if self._due is None or self._clock.monotonic() < self._due:
            return
        shooting, self._due = self._shooting, None
        if shooting is None:
            return
        if self.fault == "store_full" or self.free_bytes < PHOTOGRAPH_BYTES:
            self._tell(EventCode.STORE_FULL, STORAGE)
            return
        if self.fault == "no_photograph":
            return
        self._refused = 0
        self._releases += 1
        for kind, extension, data in self._photograph(shooting):
            self._last_handle += 1
            info = ObjectInfo(
                storage=STORAGE,
                format=kind,
                size=self._told_size(len(data)),
                width=self._options.width,
                height=self._options.height,
                parent=FOLDER,
                name=f"DSC_{self._releases:04}.{extension}",
                captured=self._clock.now().strftime("%Y%m%dT%H%M%S"),
            )
            self.objects[self._last_handle] = StoredObject(info, data)
            self._tell(EventCode.OBJECT_ADDED, self._last_handle)
        self._tell(EventCode.CAPTURE_COMPLETE, 0)

    @property
    def free_bytes(self) -> int:
        """Room on the card."""
        if self.fault == "store_full":
            return 0
        return CARD_BYTES - sum(len(stored.data) for stored in self.objects.values())

    def _told_size(self, size: int) -> int:
        return {"truncated": 2 * size, "huge_size": 0xFFFFFFFF}.get(self.fault, size)

    def _tell(self, code: EventCode, parameter: int) -> None:
        if self.fault == "late_events":
            self._late.append((code, parameter))
        elif self.fault != "lost_events":
            self.events.append((code, parameter))

    def prepare(self) -> None:
        """Render the light of the scene now, rather than while somebody waits."""
        if self._light is None:
            self._light = Studio(self._options).sensor_light()

    def _photograph(self, shooting: Shooting) -> list[tuple[ObjectFormat, str, bytes]]:
        raw = self._expose(shooting)
        wanted = self.properties[Property.COMPRESSION_SETTING].current
        files = []
        if wanted in (_FORMATS["dng"], _FORMATS["both"]):
            files.append((ObjectFormat.DNG, "DNG", write_dng(raw, shooting)))
        if wanted in (_FORMATS["jpeg"], _FORMATS["both"]):
            files.append((ObjectFormat.EXIF_JPEG, "JPG", write_jpeg(raw, shooting)))
        return files

    def _expose(self, shooting: Shooting) -> NDArray[np.uint16]:
        self.prepare()
        assert self._light is not None
        lamps, flash = self._light
        opening = float(_METERED_F_NUMBER / shooting.f_number) ** 2
        of_lamps = np.float32(opening * float(shooting.time_s / _METERED_TIME))
        # a flash is far shorter than the exposure, so the time does not count
        of_flash = np.float32(opening if shooting.flash_fired or self._external else 0)
        noise = None
        if self._options.noise == "on":
            noise = np.random.default_rng((self._options.seed, self._releases))
        raw = np.empty(lamps.shape, np.uint16)
        for top in range(0, len(raw), _ROWS):
            rows = slice(top, top + _ROWS)
            light = lamps[rows] * of_lamps + flash[rows] * of_flash
            raw[rows] = digitise(light, shooting.iso, noise)
        return raw

    def _set_up(self) -> Shooting:
        value = {code: description.current for code, description in self.properties.items()}
        fires = value[Property.FLASH_MODE] in _FLASH_FIRES
        time_s = Fraction(value[Property.EXPOSURE_TIME], 10_000)
        if self.fault == "auto_exposure" and fires:
            time_s /= 2
        if self.fault in ("flash_dead", "flash_always"):
            fires = self.fault == "flash_always"
        if self.fault == "flash_not_ready" and fires and not self._misfired:
            fires, self._misfired = False, True
        if self.flash != "mode":
            fires = False
        self._external = self.flash == "external"
        return Shooting(
            time_s=time_s,
            f_number=Fraction(value[Property.F_NUMBER], 100),
            iso=value[Property.EXPOSURE_INDEX],
            flash_fired=fires,
            focal_35mm=load_scene(self._options.scene).view.focal_35mm,
            taken=self._clock.now(),
        )
