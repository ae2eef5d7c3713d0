"""Addresses of the simulated camera: sim://studio?lights=2&width=1200&height=800."""

from __future__ import annotations

from collections import Counter
from typing import Literal
from urllib.parse import parse_qsl

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.errors import BadAddressError, CameraNotFoundError
from drivers.sim.faults import Fault


class SimulatedCamera(BaseModel):
    """What the address of a simulated camera says.

    lights: lamps that are on. width, height: pixels, even because of the colour filter mosaic.
    seed: of the noise. format: files per photograph, until another one is set. noise: off gives
    the exact light, only rounded. scene: studio, a still life; objects, one material for normals;
    chart, card, sphere and mirror, what calibrations are made of. camera: which file of the folder
    cameras. cable: direct hands the protocol over as it is, usb through pyusb. fault: what goes
    wrong, to rehearse it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    lights: int = Field(default=2, ge=1, le=3)
    width: int = Field(default=1200, ge=64, le=6000, multiple_of=2)
    height: int = Field(default=800, ge=64, le=6000, multiple_of=2)
    seed: int = Field(default=1, ge=0, le=2**32 - 1)
    format: Literal["dng", "jpeg", "both"] = "dng"
    noise: Literal["on", "off"] = "on"
    scene: Literal["studio", "objects", "chart", "card", "sphere", "mirror"] = "studio"
    camera: Literal["standard", "native", "switchless"] = "standard"
    cable: Literal["direct", "usb"] = "direct"
    fault: Fault = "none"


def parse(address: str) -> SimulatedCamera:
    """Read an address.

    Raises BadAddressError for a parameter or value that does not exist, CameraNotFoundError for
    any place but sim://studio.
    """
    place, _, query = address.partition("?")
    if place.rstrip("/") != "sim://studio":
        raise CameraNotFoundError(
            f"There is no simulated camera at {place}: the only one is sim://studio."
        )
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=bool(query))
        repeated = [name for name, count in Counter(name for name, _ in pairs).items() if count > 1]
        if repeated:
            raise BadAddressError(f"{address} says {repeated[0]} more than once: say it once.")
        return SimulatedCamera.model_validate(dict(pairs))
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(map(str, first["loc"]))
        if first["type"] == "extra_forbidden":
            known = ", ".join(SimulatedCamera.model_fields)
            raise BadAddressError(
                f"sim://studio has no parameter {name!r}; it has {known}."
            ) from error
        message = first["msg"][0].lower() + first["msg"][1:]
        raise BadAddressError(
            f"sim://studio cannot take {name}={first['input']}: {message}."
        ) from error
    except ValueError as error:
        raise BadAddressError(
            f"The parameters of {address} cannot be read: write ?name=value&name=value."
        ) from error
