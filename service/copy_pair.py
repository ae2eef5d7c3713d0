"""Copies the photographs of a job for another one, so that deleting one never hurts the other."""

from __future__ import annotations

from typing import Any

from obstore.exceptions import BaseError

from service.errors import EndedError, GoneError, NotReadyError, StorageFullError
from service.frames import FRAMES
from service.object_keys import describe_inputs, inputs_key, job_key
from service.rows import jobs
from service.rows.states import State
from service.storage.base import Storage

_GONE = "The photographs of the job are removed; send them again."


def copy_pair(
    storage: Storage, source: jobs.Job, new_id: str, swapped: bool = False
) -> dict[str, Any]:
    """Copy the photographs of a job for good; all that the new job's row says of them, by column.

    swapped: each becomes the other one.
    Raises NotReadyError where a camera has not taken them yet, EndedError where it never will,
    GoneError where they are removed, StorageFullError, BaseError while the store is away. Nothing
    is left of the copies then.
    """
    if source.state == State.EXPIRED:
        raise GoneError(_GONE)
    if source.inputs is None and source.ended:
        raise EndedError("The job ended before its camera had taken photographs; send a new one.")
    if source.inputs is None:
        raise NotReadyError("The job has no photographs yet; its camera has not taken them.")
    sources = FRAMES[::-1] if swapped else FRAMES
    of = {frame: source.inputs[one] for frame, one in zip(FRAMES, sources, strict=True)}
    keys = {frame: inputs_key(new_id, frame) for frame in FRAMES}
    try:
        for frame, key in keys.items():
            storage.copy(of[frame]["key"], key)
        storage.flush(keys.values())
        size = sum(storage.size(key) for key in keys.values())
    except (BaseError, FileNotFoundError, StorageFullError) as error:
        storage.delete_below(job_key(new_id))
        if isinstance(error, FileNotFoundError):  # it was deleted at this moment
            raise GoneError(_GONE) from error
        raise
    digests = {frame: of[frame]["sha256"] for frame in FRAMES}
    return {
        "capture": source.capture,
        "camera_settings": source.camera_settings,
        "inputs": describe_inputs(new_id, digests),
        "stored_bytes": size,
    }
