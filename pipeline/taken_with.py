"""What a calibration was found with, and what of that keeps it from other photographs."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

if TYPE_CHECKING:
    from pipeline.images.frames import Frame

Kind = Literal["flash", "camera", "lamps"]
"""What a calibration finds."""

_FILES = {"raw": "RAW files", "linear": "linear files", "srgb": "sRGB files"}
_OF_COLOURS: tuple[Kind, ...] = ("camera", "lamps")
_NAME_LENGTH = 80  # of a camera in a sentence: files may say anything

_Name = Annotated[str, Field(max_length=200)]
"""Longer than what is read of a photograph, as are names of cameras and lights."""


class TakenWith(BaseModel):
    """Camera, kind of file and way up of a photograph; "" and null where that is not known."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    make: _Name = Field(default="", description="Of the camera, as its photographs say.")
    model: _Name = Field(default="", description="The same.")
    body: _Name = Field(default="", description="A digest of the camera's serial number.")
    rendered: bool = Field(
        default=False,
        description="Values are bent by a rendering, or brought to the colours of a profile.",
    )
    encoding: str = Field(
        default="", pattern="^(raw|linear|srgb)?$", description="raw, linear or srgb."
    )
    upright: bool | None = Field(default=None, description="The picture is higher than wide.")
    orientation: int | None = Field(
        default=None, ge=1, le=8, description="EXIF's, by which the picture was turned."
    )

    @classmethod
    def of(cls, frame: Frame) -> TakenWith:
        """Say what camera a frame is of."""
        digest = hashlib.sha256(frame.serial.encode()).hexdigest()[:12] if frame.serial else ""
        return cls(
            make=frame.make,
            model=frame.model,
            body=digest,
            rendered=frame.in_colour_space,
            encoding=frame.encoding,
            upright=frame.size[1] > frame.size[0],
            orientation=frame.orientation,
        )

    def fits(self, other: TakenWith, kind: Kind) -> bool:
        """Whether what was found with one camera holds for the other."""
        return self.is_of(other) and self.obstacle(other, kind) is None

    def is_of(self, other: TakenWith) -> bool:
        """Whether both are of one make and model, which are known."""
        return bool(self.model) and (self.make, self.model) == (other.make, other.model)

    def obstacle(self, other: TakenWith, kind: Kind) -> str | None:
        """What keeps a calibration from the other's photographs; None if nothing that is known.

        It goes on from "found with".
        """
        return self.of_camera(other) or self.of_pictures(other, kind)

    def of_camera(self, other: TakenWith) -> str | None:
        """What of the camera does: another model, or another body, where both are told."""
        if self.model and other.model and not self.is_of(other):
            return f"the camera {self._name()}, and these are of {other._name()}"
        if len({self.body, other.body} - {""}) > 1:
            return "another camera of this model"
        return None

    def of_pictures(self, other: TakenWith, kind: Kind) -> str | None:
        """What of the kind of files and, of lamps, the way up of pictures does.

        Sensitivities and the lamps' rgb are of the colours of one kind of files: converters make
        linear sRGB of RAW files, and leave the camera's name. A flash's spectrum is its own, but
        approximate and for renderings alone where this is one. Lamps' directions are of the picture
        as it is shown, which a camera that looks down may turn, even by half a turn.
        """
        encodings = {self.encoding, other.encoding} - {""} if kind in _OF_COLOURS else set()
        rendered_alike = self.rendered == other.rendered or (kind == "flash" and not self.rendered)
        if len(encodings) > 1 or not rendered_alike:
            return f"{self._files()}, and these are {other._files()}"
        if kind != "lamps":
            return None
        if len({self.upright, other.upright} - {None}) > 1:
            ways = ("upright pictures, and these lie", "pictures that lie, and these are upright")
            return ways[not self.upright]
        if len({self.orientation, other.orientation} - {None}) > 1:
            return (
                f"pictures that were turned another way (EXIF orientation {self.orientation}, of "
                f"these {other.orientation})"
            )
        return None

    def _name(self) -> str:
        return f"{self.make} {self.model}".strip()[:_NAME_LENGTH]

    def _files(self) -> str:
        if self.rendered and self.encoding != "srgb":
            return "files in the colours of a profile" if self.encoding else "rendered files"
        return _FILES.get(self.encoding, "files that are not rendered")
