"""The durable queues: submit, withdraw, run, take over. The only module that knows DBOS.

DBOS remembers what was submitted through every crash and hands each job to one worker; what it
does not do is take over the jobs of a worker that died, so take_over() does.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection

import sqlalchemy as sa
from dbos import DBOS, DBOSClient, DBOSConfig, DBOSPortableJSONSerializer, EnqueueOptions, error

from service.errors import StartError
from service.settings import TELLINGS

_APPLICATION = "lightlayers"
_VERSION = "1"  # pinned: a job of an older program may be run by a newer one
_QUEUE = "jobs"
_WORKFLOW = "run_job"
_TELLING_QUEUE = "webhooks"
_TELLING_WORKFLOW = "tell_webhook"
_TELLERS = 8  # webhooks a worker tells at once: it waits for them most of the time


def migrate(engine: sa.Engine) -> None:
    """Create or bring up to date the queue's tables; before the first Queue or launch."""
    DBOS.migrate(engine.url.render_as_string(hide_password=False))


class Queue:
    """The queue as the API sees it: it only puts in and takes out."""

    def __init__(self, engine: sa.Engine) -> None:
        self._client = DBOSClient(
            system_database_engine=engine,
            serializer=DBOSPortableJSONSerializer(),
            application_name=_APPLICATION,
            retry_connection_errors=False,
        )

    def submit(self, connection: sa.Connection, job_id: str) -> None:
        """Enqueue a job within the caller's transaction."""
        options = EnqueueOptions(
            workflow_name=_WORKFLOW,
            queue_name=_QUEUE,
            workflow_id=job_id,
            app_version=_VERSION,
        )
        self._client.enqueue_in_transaction(connection, options, job_id)

    def submit_telling(
        self, connection: sa.Connection, job_id: str, number: int, delay_seconds: float
    ) -> None:
        """Enqueue the telling of a job's webhook, from 1 to TELLINGS, within a transaction.

        One that is enqueued already stays as it is.
        """
        options = EnqueueOptions(
            workflow_name=_TELLING_WORKFLOW,
            queue_name=_TELLING_QUEUE,
            workflow_id=_telling(job_id, number),
            app_version=_VERSION,
        )
        if delay_seconds > 0:
            options["delay_seconds"] = delay_seconds
        self._client.enqueue_in_transaction(connection, options, job_id, number)

    def withdraw(self, job_id: str) -> None:
        """Take a job that waits out of the queue."""
        self._client.cancel_workflow(job_id)

    def forget(self, job_id: str) -> None:
        """Drop everything the queue knows about a job."""
        tellings = [_telling(job_id, number) for number in range(1, TELLINGS + 1)]
        self._client.delete_workflows([job_id, *tellings])

    def close(self) -> None:
        """Stop using the queue; the engine stays the caller's."""
        self._client.destroy()


def _telling(job_id: str, number: int) -> str:
    return f"{job_id}-webhook-{number}"


def launch(
    engine: sa.Engine,
    worker: str,
    run: Callable[[str], None],
    tell: Callable[[str, int], None],
    concurrency: int,
    poll_seconds: float,
) -> None:
    """Have this process call run(job id) and tell(job id, number) in threads, as they are queued.

    worker: unique among all workers ever. run: must return only when the job has ended, since a
    return takes the job out of the queue for good; tell: when what came of it is written. Raises
    StartError.
    """
    # DBOS writes to the console of its own unless its logger has a handler.
    logging.getLogger("dbos").addHandler(logging.NullHandler())
    DBOS(
        config=DBOSConfig(
            name=_APPLICATION,
            system_database_engine=engine,
            executor_id=worker,
            application_version=_VERSION,
            serializer=DBOSPortableJSONSerializer(),
            log_level="WARNING",
            run_migrations=False,  # a command does that, see service.opening
        )
    )
    # An attempt count of our own is in the job's row: a takeover resets the one of DBOS.
    DBOS.workflow(name=_WORKFLOW, max_recovery_attempts=None)(run)
    DBOS.workflow(name=_TELLING_WORKFLOW, max_recovery_attempts=None)(tell)
    DBOS.listen_queues([_QUEUE, _TELLING_QUEUE])
    try:
        DBOS.launch()
    except error.DBOSInitializationError as fault:
        raise StartError(
            "The queue's tables are older than this lightlayers needs: run `lightlayers migrate`."
        ) from fault
    for queue, at_once in ((_QUEUE, concurrency), (_TELLING_QUEUE, _TELLERS)):
        DBOS.register_queue(
            queue,
            worker_concurrency=at_once,
            polling_interval_sec=poll_seconds,
            on_conflict="always_update",
        )


def take_over(living: Collection[str]) -> list[str]:
    """Put the work of workers that are not among the living back into its queue; the jobs' ids."""
    held = DBOS.list_workflows(
        status="PENDING",
        queue_name=[_QUEUE, _TELLING_QUEUE],
        load_input=False,
        load_output=False,
    )
    orphans = [work for work in held if work.executor_id not in living]
    for work in orphans:
        DBOS.resume_workflow(work.workflow_id, queue_name=work.queue_name)
    return [work.workflow_id.partition("-")[0] for work in orphans]
