"""`lightlayers jobs`: what operators see and do, on the database, for the jobs of all owners."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli.parameters import AllAsJson
from service.rows.states import State

if TYPE_CHECKING:
    from service.operator_actions import OperatorActions
    from service.rows.jobs import Job

app = typer.Typer(help="See and mend the jobs of a service.", rich_markup_mode=None)

_MOMENTS = ("created", "started", "finished", "deadline", "expires", "request_until", "eta")
"""Columns in seconds since 1970, which are shown as ISO 8601."""

Id = Annotated[str, typer.Argument(metavar="ID", help="Id of the job.")]


@app.command("list")
def list_jobs(
    state: Annotated[State | None, typer.Option(help="Only jobs in this state.")] = None,
    limit: Annotated[
        int, typer.Option(min=1, max=1_000_000, help="How many, the newest first.")
    ] = 50,
    as_json: AllAsJson = False,
) -> None:
    """List jobs: id, state, stage, attempt, when made, owner."""
    from service.cli.display import print_json

    with _actions() as actions:
        found = actions.newest(state, limit)
        if as_json:
            print_json([_known(job) for job in found])
            return
        for job in found:
            stage = f"{job.stage} {job.fraction:.0%}" if job.stage else ""
            made = datetime.fromtimestamp(job.created, UTC).isoformat(timespec="seconds")
            line = f"{job.id}  {job.state:<10} {stage:<13} {job.attempt:>2}  {made}  {job.owner}"
            print(line.rstrip())
            if job.request:
                print(f"  asks: {job.request}")


@app.command()
def show(job_id: Id) -> None:
    """Print all that is known of a job, as JSON."""
    from service.cli.display import print_json

    with _actions() as actions:
        job = actions.find(job_id)
    print_json(_known(job))


def _known(job: Job) -> dict[str, Any]:
    """Tell all that operators may see of a job."""
    known: dict[str, Any] = asdict(job)
    del known["request_hash"]
    if known["webhook"]:  # its secret is nobody's business
        known["webhook"] = {"url": known["webhook"].get("url")}
    for moment in _MOMENTS:
        if known[moment] is not None:
            known[moment] = datetime.fromtimestamp(known[moment], UTC).isoformat()
    return known


@app.command()
def retry(job_id: Id) -> None:
    """Make a new job like one that failed or was canceled, of the same owner; print its id.

    The old job stays as it ended: whoever was told so may rely on it.
    """
    with _actions() as actions:
        print(actions.retry(job_id))


@app.command()
def confirm(job_id: Id) -> None:
    """Say that what a job asks for is done, like switching the flash."""
    with _actions() as actions:
        actions.confirm(job_id)


@app.command()
def cancel(job_id: Id) -> None:
    """Stop a job; print its state. One that has ended stays as it is."""
    with _actions() as actions:
        print(actions.cancel(job_id))


@contextlib.contextmanager
def _actions() -> Iterator[OperatorActions]:
    from service.operator_actions import open_actions
    from service.settings import Settings

    with open_actions(Settings()) as actions:
        yield actions
