"""The queues from outside: submit, withdraw, see what is held, put back, forget."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

import sqlalchemy as sa
from dbos import DBOS, DBOSClient, DBOSPortableJSONSerializer, EnqueueOptions

from service.dbos_queue.entries import (
    APPLICATION,
    CAPTURE_PAIR,
    DELIVERIES,
    JOBS,
    RUN_JOB,
    SWEEP,
    TELL_WEBHOOK,
    UPKEEP,
    VERSION,
    Held,
    capture_id,
    captures_on,
    delivery_id,
    run_id,
    sweep_id,
)
from service.dbos_queue.outages import silence_dbos
from service.rows.clock import now

_DONE = ["SUCCESS", "ERROR", "CANCELLED"]
_BATCH = 500  # forgotten in a transaction


def migrate(engine: sa.Engine) -> None:
    """Create or bring up to date the queue's tables; before the first Queue or launch."""
    silence_dbos()  # it warns of what it can do without; whatever else fails is raised
    DBOS.migrate(engine.url.render_as_string(hide_password=False))


class Queue:
    """The queue from outside: it puts in and takes out, and raises when the database is away.

    What DBOS does inside a worker waits for the database instead, and ever longer.
    """

    def __init__(self, engine: sa.Engine) -> None:
        self._client = DBOSClient(
            system_database_engine=engine,
            serializer=DBOSPortableJSONSerializer(),
            application_name=APPLICATION,
            retry_connection_errors=False,
        )

    def submit(
        self,
        connection: sa.Connection,
        job_id: str,
        rank: int,
        again: int = 0,
        delay_seconds: float = 0.0,
    ) -> None:
        """Enqueue a job within the caller's transaction; those of low rank (1…2³¹−1) go first.

        again: how many times a worker has put it back for another one.
        One that is enqueued already stays as it is, here and in submit_capture.
        """
        options = EnqueueOptions(
            workflow_name=RUN_JOB,
            queue_name=JOBS,
            workflow_id=run_id(job_id, again),
            priority=rank,
        )
        self._enqueue(connection, options, delay_seconds, job_id)

    def submit_capture(
        self,
        connection: sa.Connection,
        job_id: str,
        rank: int,
        camera: str,
        host: str | None,
        delay_seconds: float = 0.0,
    ) -> None:
        """Enqueue a job for its camera, within a transaction; one job at a time has each camera.

        host: whose workers alone can use it; None for any.
        """
        options = EnqueueOptions(
            workflow_name=CAPTURE_PAIR,
            queue_name=captures_on(host),
            workflow_id=capture_id(job_id),
            priority=rank,
            queue_partition_key=camera,
        )
        self._enqueue(connection, options, delay_seconds, job_id)

    def submit_delivery(
        self, connection: sa.Connection, job_id: str, number: int, delay_seconds: float
    ) -> None:
        """Enqueue an attempt at delivery to a job's webhook, within a transaction.

        number: of the attempt, from 1. One that is enqueued already stays as it is.
        """
        options = EnqueueOptions(
            workflow_name=TELL_WEBHOOK,
            queue_name=DELIVERIES,
            workflow_id=delivery_id(job_id, number),
        )
        self._enqueue(connection, options, delay_seconds, job_id, number)

    def submit_sweep(self, connection: sa.Connection, seconds: int, thorough: bool) -> None:
        """Enqueue the sweep of the present `seconds` by the database's clock, in a transaction.

        One that is enqueued already, by whichever worker, stays as it is.
        """
        moment = connection.execute(sa.select(now())).scalar_one()
        kind = "thorough" if thorough else "often"
        options = EnqueueOptions(
            workflow_name=SWEEP,
            queue_name=UPKEEP,
            workflow_id=sweep_id(kind, int(moment // seconds)),
        )
        self._enqueue(connection, options, 0.0, None, thorough)

    def _enqueue(
        self,
        connection: sa.Connection,
        options: EnqueueOptions,
        delay_seconds: float,
        *arguments: object,
    ) -> None:
        options["app_version"] = VERSION
        if delay_seconds > 0:
            options["delay_seconds"] = delay_seconds
        self._client.enqueue_in_transaction(connection, options, *arguments)

    def withdraw(self, *job_ids: str) -> None:
        """Take jobs that wait out of their queues; of those put back, run finds no more to do."""
        self._client.cancel_workflows([*job_ids, *map(capture_id, job_ids)])

    def held(self) -> list[Held]:
        """List what workers have taken out of the queues and not done yet."""
        held = self._client.list_workflows(
            status="PENDING",
            queues_only=True,  # all of them, also those of other hosts
            load_input=False,
            load_output=False,
        )
        return [
            Held(one.workflow_id, one.executor_id or "", one.queue_name or JOBS) for one in held
        ]

    def put_back(self, held: Iterable[Held]) -> None:
        """Put what workers have back into its queue."""
        for one in held:
            self._client.resume_workflow(one.id, queue_name=one.queue)

    def forget_done(self, seconds: float) -> None:
        """Drop what was done more than so many seconds ago; the rows of jobs tell how it ended."""
        before = (datetime.now(UTC) - timedelta(seconds=seconds)).isoformat()
        while done := self._client.list_workflows(
            status=_DONE,
            completed_before=before,
            limit=_BATCH,
            load_input=False,
            load_output=False,
        ):
            self._client.delete_workflows([one.workflow_id for one in done])

    def close(self) -> None:
        """Stop using the queue; the engine stays the caller's."""
        self._client.destroy()
