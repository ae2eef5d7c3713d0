"""The commands. What they need is imported when they run, so that --help is quick."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from pipeline.result_names import MANIFEST
from service.cli import calibrate, cameras, examples, jobs, keys, mix, tether
from service.cli.files import read_file, say, shown
from service.cli.loading import loading
from service.cli.options import (
    Flags,
    Flash,
    MaybeFlash,
    NoFlash,
    NoFlashOrFolder,
)
from service.cli.parameters import AsJson, KeyFile, output, with_flags

app = typer.Typer(
    help="Separates the light of every lamp, from a photograph with the flash and one without.",
    rich_markup_mode=None,
)
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(keys.app, name="keys")
app.add_typer(jobs.app, name="jobs")

Output = Annotated[Path, output("DIR", "Folder of results.")]


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"lightlayers {version('lightlayers')}")
        raise typer.Exit


@app.callback()
def _lightlayers(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    pass


@app.command(epilog=examples.SEPARATE)
@with_flags
def separate(
    no_flash: NoFlashOrFolder,
    output: Output,
    flags: Flags,
    flash: MaybeFlash = None,
    as_json: AsJson = False,
) -> int | None:
    """Separate a pair, or all pairs of a folder, without a server.

    In a folder, the photographs of a pair are found by what EXIF says of the flash and of the time;
    the results of each get a folder of their own in DIR, with the name of the photograph without
    the flash.
    """
    with loading():
        from pipeline.compiling import prepare
        from pipeline.process import separate_files
        from pipeline.progress import Progress
        from service.cli.display import print_results, stage_bar
        from service.cli.keeping import kept_for
        from service.cli.results_folder import new_results
        from service.cli.separate_folder import separate_folder

        prepare()
    options = flags.options()
    if flash is None:
        return separate_folder(no_flash, output, options, as_json)
    with new_results(output) as folder, stage_bar() as report:
        kept = kept_for(options.setup)
        manifest = separate_files(
            read_file(no_flash, "photograph"),
            read_file(flash, "photograph"),
            options,
            folder,
            Progress(report),
            kept=kept,
        )
    print_results(manifest, output, as_json)
    return None


app.command(epilog=examples.MIX)(mix.mix)


@app.command(epilog=examples.SERVE)
def serve(
    host: Annotated[
        str | None,
        typer.Option(help="Address to listen on; 0.0.0.0 for every network. Default: 127.0.0.1."),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Port to listen on. Default: 8000.")
    ] = None,
    worker: Annotated[
        bool, typer.Option(help="Start a worker too, as a service on one machine needs.")
    ] = True,
) -> None:
    """Serve the HTTP API, with a worker."""
    from service.cli import signals
    from service.serve import serve
    from service.settings import Settings

    given = {"host": host, "port": port}
    typed = {name: value for name, value in given.items() if value is not None}
    settings = Settings.model_validate({**Settings().model_dump(), **typed})
    signals.leave_hangup()
    serve(settings, worker)


@app.command()
def worker() -> None:
    """Run one more worker of the same service."""
    from service import logs
    from service.cli import signals
    from service.settings import Settings
    from service.variables import faults
    from service.workers.worker import log, run_until_signal

    settings = Settings()
    signals.leave_hangup()
    logs.configure()
    for sentence in faults():
        log.warning("%s", sentence)
    run_until_signal(settings)


@app.command()
def migrate() -> None:
    """Bring the database up to date, before newer processes start."""
    from service.opening import migrate_database
    from service.settings import Settings

    before, after = migrate_database(Settings())
    moved = "it was there already" if before == after else f"from {before or 'nothing'}"
    print(f"The database is at schema {after}, {moved}.")


@app.command()
def doctor() -> None:
    """Say what is wrong with the set-up, and what to do.

    The set-up is what the variables LIGHTLAYERS_… describe; exit code 1 when something is wrong.
    """
    from service.doctor import examine

    wrong = False
    for finding in examine():
        print(f"{finding.grade:<5}  {finding.part}: {finding.sentence}", flush=True)
        wrong |= finding.grade == "wrong"
    raise typer.Exit(1 if wrong else 0)


@app.command(epilog=examples.SUBMIT)
@with_flags
def submit(
    no_flash: NoFlash,
    flash: Flash,
    output: Output,
    flags: Flags,
    url: Annotated[str, typer.Option(help="Where the service is.")] = "http://127.0.0.1:8000",
    key_file: KeyFile = None,
    as_json: AsJson = False,
) -> None:
    """Send a pair to a running service, wait, and fetch the results."""
    from service.cli.display import print_results, stage_bar
    from service.cli.results_folder import new_results
    from service.sending.client import Client

    options = flags.options()
    key = keys.key_of_requests(key_file)
    before, after = read_file(no_flash, "photograph"), read_file(flash, "photograph")
    job = None
    try:
        with Client(url, key) as client, new_results(output) as folder:
            job = client.submit_pair(before, after, options)
            with stage_bar() as report:
                job = client.wait(job, report)
            client.download(job, folder)
            manifest = json.loads((folder / MANIFEST).read_bytes())
    except BaseException:  # Ctrl-C, too, and a disk that is full
        if job:
            say(f"The job is {job['id']}.")  # it may end without us
        raise
    print_results(manifest, output, as_json)


@app.command(epilog=examples.REPORT)
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results.")],
    output: Annotated[Path | None, output("FILE", "Default: report.html in DIR.")] = None,
) -> None:
    """Write one HTML page of a result, to be sent to somebody.

    Pictures, lamps, warnings and figures are in it; it loads nothing.
    """
    from service.cli.report import write_report
    from service.cli.results_folder import REPORT

    print(shown(write_report(folder, output or folder / REPORT)))


app.command("cameras")(cameras.list_cameras)
app.command(epilog=examples.CAPTURE)(cameras.capture)
app.command()(tether.tether)
app.command()(cameras.simcam)
