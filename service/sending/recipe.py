"""The settings of a pair, kept to take others like it."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, StrictFloat, StrictInt, StrictStr

import drivers


class RecipeCamera(BaseModel):
    """The camera that took the pair."""

    make: str = ""
    model: str = ""
    serial: str = ""


class Recipe(BaseModel):
    """What stood in the camera for both photographs, the flash apart."""

    model_config = ConfigDict(allow_inf_nan=False)

    settings: dict[drivers.SettingName, StrictStr | StrictInt | StrictFloat]
    camera: RecipeCamera = Field(default_factory=RecipeCamera)

    @classmethod
    def of(cls, pair: drivers.CapturedPair, camera: drivers.CameraInfo) -> Recipe:
        """Make the recipe of a pair."""
        taker = RecipeCamera(make=camera.make, model=camera.model, serial=camera.serial)
        return cls(settings=dict(pair.settings), camera=taker)
