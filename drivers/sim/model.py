"""What a camera's file says: who it is, its settings, its timing and the calls of its maker."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from drivers.ptp.codes import DataType, Operation, Property
from drivers.ptp.datasets import Form, PropertyDescription


def _by_name(kind: Any) -> BeforeValidator:
    return BeforeValidator(lambda name: kind[name])


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Timing(_Strict):
    """How long things take, in seconds.

    write_s: from the end of the exposure to the card. recharge_s: of the flash, after it fired.
    """

    write_s: float = Field(ge=0)
    recharge_s: float = Field(ge=0)


class ModelProperty(_Strict):
    """A setting. default: as current where it is left out. values: none for no choice."""

    code: Annotated[Property, _by_name(Property)]
    type: Annotated[DataType, _by_name(DataType)]
    current: int
    default: int | None = None
    writable: bool = True
    values: tuple[int, ...] = ()

    def describe(self) -> PropertyDescription:
        """As the protocol has it."""
        form = Form.ENUMERATION if self.values else Form.NONE
        default = self.current if self.default is None else self.default
        return PropertyDescription(
            self.code, self.type, self.writable, default, self.current, form, self.values
        )


class Model(_Strict):
    """A camera. vendor: whose extension it speaks, 0 for none. calls: operations of that."""

    version: Literal[1]
    make: str
    model: str
    serial: str
    vendor: int = 0
    calls: tuple[Annotated[Operation, _by_name(Operation)], ...] = ()
    timing: Timing
    properties: tuple[ModelProperty, ...]


@cache
def load_model(name: str) -> Model:
    """Load one of the files in the folder cameras."""
    text = (Path(__file__).parent / "cameras" / f"{name}.yaml").read_text(encoding="utf-8")
    return Model.model_validate(yaml.safe_load(text))
