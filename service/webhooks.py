"""Delivers ends of jobs to their webhooks, after the Standard Webhooks specification.

An ended job with a webhook and no `delivery` is due for one; that is the same write as its end, so
that none is lost. A worker that finds it queues the first attempt and writes the delivery in one
transaction. Every attempt is a durable entry of the queue's; one that fails queues the next.
"""

from __future__ import annotations

import importlib.metadata
import json
import logging
import random
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any, TypeVar

import sqlalchemy as sa
from standardwebhooks import Webhook

from service.addresses import ForbiddenAddressError, check_url, parse_networks
from service.answers import JobAnswer
from service.dbos_queue.queue import Queue
from service.outgoing import Answer, UnansweredError, post
from service.patience import note
from service.retry_after import retry_after
from service.rows import deliveries, jobs
from service.rows.database import AWAY
from service.rows.states import State
from service.settings import Settings

_GROWTH = 2.5  # of each pause over the one before
_LONGEST_SECONDS = 86400.0  # of a pause
_AT_ONCE = 100  # enqueued in a transaction
_OPTION_BYTES = 1000  # of JSON; longer ones, such as tables of spectra, are left out
_RETRY_SECONDS = 1.0  # when the database is away

T = TypeVar("T")

log = logging.getLogger("service.webhooks")


def queue_deliveries(connection: sa.Connection, queue: Queue) -> int:
    """Queue the first attempts that are due, within a transaction; of how many jobs."""
    begun = _delivery("pending", 0, None)
    found = deliveries.due(connection, _AT_ONCE)
    due = [job_id for job_id in found if deliveries.write(connection, job_id, begun)]
    for job_id in due:
        queue.submit_delivery(connection, job_id, 1, 0.0)
    return len(due)


def _delivery(state: str, attempts: int, last_status: int | None) -> dict[str, Any]:
    return {"state": state, "attempts": attempts, "last_status": last_status}


class Deliverer:
    """Delivers to webhooks; `deliver` is what the queue calls."""

    def __init__(self, engine: sa.Engine, queue: Queue, settings: Settings) -> None:
        self._engine = engine
        self._queue = queue
        self._settings = settings
        self._private = parse_networks(settings.webhook_private)

    def deliver(self, job_id: str, number: int) -> None:
        """Make the `number`th attempt at a job's delivery, and write what came of it."""
        job = self._patiently(job_id, lambda connection: jobs.find(connection, job_id))
        if job is None or not _awaits(job, number):
            return
        try:
            answer = self._post(job)
        except Exception:  # a fault of ours: the next attempt may go better
            log.exception("webhook not delivered", extra={"job": job_id})
            answer = None
        self._patiently(job_id, lambda connection: self._record(connection, job_id, number, answer))

    def _patiently(self, job_id: str, work: Callable[[sa.Connection], T]) -> T:
        """Do it in a transaction, however long the database is away: a return would end it."""
        hindered = False
        while True:
            try:
                with self._engine.begin() as connection:
                    return work(connection)
            except (sa.exc.DBAPIError, *AWAY) as error:
                if not hindered:  # one line, not one for each try
                    note(log, "the delivery to a webhook is hindered", error, job=job_id)
                hindered = True
                time.sleep(_RETRY_SECONDS)

    def _post(self, job: jobs.Job) -> Answer | None:
        fields = {"job": job.id, "trace_id": job.trace_id}
        assert job.webhook is not None
        url = job.webhook["url"]
        body = _payload(job)
        headers = _headers(f"job_{job.id}", job.webhook["secret"], body)
        try:
            # Settings may forbid by now what they allowed when the job was asked for.
            check_url(url, self._private, self._settings.webhook_https)
            answer = post(url, headers, body, self._private, self._settings.webhook_seconds)
        except (UnansweredError, ForbiddenAddressError) as error:
            log.info("webhook not delivered: %s", error, extra=fields)
            return None
        log.info("webhook answered %s", answer.status, extra=fields)
        return answer

    def _record(
        self, connection: sa.Connection, job_id: str, number: int, answer: Answer | None
    ) -> None:
        status = answer.status if answer else None
        if status and 200 <= status < 300:
            state = "delivered"
        elif status == 410 or number >= self._settings.webhook_tries:
            state = "failed"
        else:
            state = "pending"
        written = deliveries.write(connection, job_id, _delivery(state, number, status))
        if written and state == "pending":
            self._queue.submit_delivery(connection, job_id, number + 1, self._pause(number, answer))

    def _pause(self, number: int, answer: Answer | None) -> float:
        """Seconds until the next attempt: longer each time, and not the same for all."""
        usual = self._settings.webhook_retry_seconds * _GROWTH ** (number - 1)
        asked = retry_after(answer.retry_after) if answer and answer.status in (429, 503) else 0.0
        return min(max(usual * random.uniform(0.8, 1.2), asked), _LONGEST_SECONDS)


def _awaits(job: jobs.Job, number: int) -> bool:
    """Whether this attempt is still to be made.

    Another copy may have been quicker, or the job deleted and its removal not be over.
    """
    if job.state == State.EXPIRED or job.delivery is None:
        return False
    return job.delivery["state"] == "pending" and bool(job.delivery["attempts"] < number)


def _headers(message_id: str, secret: str, body: bytes) -> dict[str, str]:
    sent = datetime.now(UTC)
    return {
        "content-type": "application/json",
        "user-agent": f"lightlayers/{importlib.metadata.version('lightlayers')}",
        "webhook-id": message_id,
        "webhook-timestamp": str(int(sent.timestamp())),
        "webhook-signature": Webhook(secret).sign(message_id, sent, body.decode()),
    }


def _payload(job: jobs.Job) -> bytes:
    shown = JobAnswer.of(job).model_dump(mode="json", exclude={"webhook"})
    shown["options"] = {
        name: value
        for name, value in shown["options"].items()
        if len(json.dumps(value)) <= _OPTION_BYTES
    }
    event = {"type": f"job.{job.state}", "timestamp": shown["finished"], "data": shown}
    return json.dumps(event).encode()
