"""Whether a request is one that was sent before, and the job that was made of it then."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from pydantic import BaseModel

from service.api.accepted_job import Accepted
from service.api.intake import Intake
from service.api.models import Handling
from service.api.submission import Submission
from service.errors import IdempotencyError
from service.mixing import MixOptions
from service.rows import jobs


def replay(submission: Submission, request_hash: str) -> Accepted | None:
    """Give the job that a request with this key has made. Raises IdempotencyError."""
    earlier = find_earlier(submission)
    if earlier is None:
        return None
    if earlier.request_hash != request_hash:
        raise IdempotencyError(
            "This Idempotency-Key belongs to a request with another pair or other options; "
            "use a new key."
        )
    return Accepted(earlier.id, replayed=True)


def find_earlier(submission: Submission) -> jobs.Job | None:
    """Find the job that an earlier request with this key has made, whatever it asked for."""
    if submission.idempotency_key is None:
        return None
    owner = submission.caller.owner
    with submission.context.engine.connect() as connection:
        return jobs.find_by_key(connection, owner, submission.idempotency_key)


def hash_of(wanted: Intake) -> str:
    """Digest a request for one job of a pair."""
    return digest(
        {
            # As they were sent: calibrations that they name may have been deleted since.
            "options": as_asked(wanted.options) | wanted.calibrations,
            "handling": as_asked(wanted.handling),
            "capture": wanted.capture and as_asked(wanted.capture),
            "sha256": wanted.sha256,
            # Their bytes never change, and they go when a job is made of them.
            "uploads": wanted.uploads,
        }
    )


def hash_of_mix(options: MixOptions, handling: Handling) -> str:
    """Digest a request for a mix."""
    # With the places of a pair, as releases before had them: a row keeps the digest of its request.
    pair: dict[str, Any] = {"capture": None, "sha256": {}, "uploads": {}}
    return digest({"options": as_asked(options), "handling": as_asked(handling), **pair})


def digest(same: dict[str, Any]) -> str:
    """Digest what two requests share when they ask for the same."""
    return hashlib.sha256(json.dumps(same, sort_keys=True).encode()).hexdigest()


def as_asked(wanted: BaseModel) -> dict[str, Any]:
    """What a request asks for, to be digested."""
    # Without what it leaves out, else a release that adds an option took no request for an earlier
    # one; with defaults that it names, since these win over a kept calibration.
    return wanted.model_dump(mode="json", exclude_unset=True)
