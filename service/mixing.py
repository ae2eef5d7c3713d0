"""What a mix asks of the job whose layers it mixes."""

from __future__ import annotations

import json
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from pipeline.errors import OptionError
from pipeline.mixes.mix_options import Mix, MixRequest, check_lamps, read_basis
from pipeline.result_names import LAYERS, MANIFEST
from service.object_keys import results_key
from service.rows import jobs
from service.rows.availability import check_succeeded, deleted_meanwhile
from service.storage.base import Storage


class MixOptions(BaseModel):
    """The options of a mix, as its job shows them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Literal["mix"]
    of: str = Field(description="Id of the job whose layers are mixed.")
    mix: MixRequest


def check_mix(storage: Storage, source: jobs.Job, mix: Mix) -> None:
    """Refuse what could never be mixed of the layers of a job.

    Raises OptionError where it has no layers, or other lamps, InputError where its manifest is of
    an earlier version, GoneError, BaseError while the store is away, and what check_succeeded
    raises.
    """
    check_succeeded(source)
    if not {LAYERS, MANIFEST} <= {result["name"] for result in source.results or []}:
        raise OptionError(f"The job has no {LAYERS} to mix; separate the pair with that output.")
    with deleted_meanwhile():
        manifest = storage.get(results_key(source.id, source.attempt, MANIFEST))
    check_lamps(read_basis(json.loads(manifest)), mix)
