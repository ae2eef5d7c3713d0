from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from pydantic import ValidationError

from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.errors import InputError, OptionError
from pipeline.mixes.mix_options import LampMix, Mix
from service.errors import EndedError, GoneError, NotReadyError
from service.mixing import MixOptions, check_mix
from service.rows import jobs
from service.rows.states import State
from service.storage.base import Storage
from tests.unit.service.job_rows import added

EYE = np.linalg.inv(XYZ_TO_SRGB).tolist()
LAMP = {"white": [0.95, 1.0, 1.09], "neutral_to_xyz": EYE}
MANIFEST = {"mix": {"to_xyz": EYE, "neutral": [0.95, 1.0, 1.09], "lamps": [LAMP, LAMP]}}
TWO = Mix(lamps=[LampMix(), LampMix(on=False)])
BOTH = ("layers.exr", "manifest.json")

Separated = Callable[..., jobs.Job]


@pytest.fixture
def separated(engine: sa.Engine, storage: Storage) -> Separated:
    """A job in its third attempt, whose manifest is stored; names: of its results."""

    def make(
        state: State = State.SUCCEEDED,
        names: tuple[str, ...] = BOTH,
        manifest: Any = MANIFEST,
    ) -> jobs.Job:
        storage.put("jobs/a/2/manifest.json", b"of an attempt that was lost")
        storage.put("jobs/a/3/manifest.json", json.dumps(manifest).encode())
        results = [{"name": name, "size": 1} for name in names]
        return added(engine, "a", state=state, attempt=3, results=results)

    return make


def test_a_mix_of_as_many_lamps_is_taken(separated: Separated, storage: Storage) -> None:
    check_mix(storage, separated(), TWO)


@pytest.mark.parametrize(("lamps", "told_of"), [(1, "1 lamp"), (3, "3 lamps")])
def test_a_mix_of_other_lamps_is_refused(
    lamps: int, told_of: str, separated: Separated, storage: Storage
) -> None:
    with pytest.raises(OptionError) as told:
        check_mix(storage, separated(), Mix(lamps=[LampMix()] * lamps))
    assert str(told.value) == (
        f"The mix has settings for {told_of}, and the photograph has 2: give as many."
    )


@pytest.mark.parametrize("names", [(), ("manifest.json",), ("layers.exr",), ("lamp1.exr",)])
def test_a_job_without_layers_is_refused(
    names: tuple[str, ...], separated: Separated, storage: Storage
) -> None:
    with pytest.raises(OptionError) as told:
        check_mix(storage, separated(names=names), TWO)
    assert str(told.value) == (
        "The job has no layers.exr to mix; separate the pair with that output."
    )


@pytest.mark.parametrize("manifest", [{}, {"mix": None}, {"mix": {"lamps": []}}, []])
def test_a_manifest_of_an_earlier_version_is_told(
    manifest: Any, separated: Separated, storage: Storage
) -> None:
    with pytest.raises(InputError, match="separate the pair anew with this version"):
        check_mix(storage, separated(manifest=manifest), TWO)


@pytest.mark.parametrize(
    ("state", "error"),
    [(State.RUNNING, NotReadyError), (State.FAILED, EndedError), (State.EXPIRED, GoneError)],
)
def test_a_job_that_has_not_succeeded_is_told_before_what_it_lacks(
    state: State, error: type[Exception], separated: Separated, storage: Storage
) -> None:
    with pytest.raises(error):
        check_mix(storage, separated(state, names=()), TWO)


def test_a_job_whose_files_go_at_this_moment_is_gone(
    separated: Separated, storage: Storage
) -> None:
    job = separated()
    storage.delete("jobs/a/3/manifest.json")
    with pytest.raises(GoneError):
        check_mix(storage, job, TWO)


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "mix", "of": "a"},
        {"kind": "separate", "of": "a", "mix": {"lamps": [{}]}},
        {"kind": "mix", "of": "a", "mix": {"lamps": [{}]}, "lights": 2},
    ],
)
def test_what_is_no_mix_is_not_read_as_one(options: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        MixOptions.model_validate(options)
