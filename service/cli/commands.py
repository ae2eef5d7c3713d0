"""The commands. What they need is imported when they run, so that --help is quick."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from service.cli import calibrate, mix
from service.cli.options import Flags, Flash, NoFlash, read_file, with_flags

app = typer.Typer(
    help="Separates the light of every lamp, from a photograph with the flash and one without.",
    add_completion=False,
    rich_markup_mode=None,
)
app.add_typer(calibrate.app, name="calibrate")
app.command()(mix.mix)

Output = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of results.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the manifest.")]


@app.command()
@with_flags
def separate(
    no_flash: NoFlash, flash: Flash, output: Output, flags: Flags, as_json: AsJson = False
) -> None:
    """Separate a pair here, without a server."""
    import pipeline
    from pipeline.progress import Progress
    from service.cli.display import print_results, stage_bar
    from service.cli.folder import new_results

    options = flags.options()
    before, after = read_file(no_flash, "photograph"), read_file(flash, "photograph")
    with new_results(output) as folder, stage_bar() as report:
        manifest = pipeline.separate_files(before, after, options, folder, Progress(report))
    print_results(manifest, output, as_json)


@app.command()
def serve(
    host: Annotated[
        str | None,
        typer.Option(help="Address to listen on; 0.0.0.0 for every network. Default: 127.0.0.1."),
    ] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on. Default: 8000.")] = None,
    worker: Annotated[
        bool, typer.Option(help="Start a worker too, as a service on one machine needs.")
    ] = True,
) -> None:
    """Serve the HTTP API, with a worker."""
    from service.serve import serve
    from service.settings import Settings

    given = {"host": host, "port": port}
    typed = {name: value for name, value in given.items() if value is not None}
    settings = Settings.model_validate({**Settings().model_dump(), **typed})
    serve(settings, worker)


@app.command()
def worker() -> None:
    """Run one more worker of the same service."""
    from service import logs
    from service.settings import Settings
    from service.worker import run_until_signal

    logs.configure()
    run_until_signal(Settings())


@app.command()
@with_flags
def submit(
    no_flash: NoFlash,
    flash: Flash,
    output: Output,
    flags: Flags,
    url: Annotated[str, typer.Option(help="Where the service is.")] = "http://127.0.0.1:8000",
    as_json: AsJson = False,
) -> None:
    """Send a pair to a running service, wait, and fetch the results."""
    from service.cli.display import print_results, stage_bar
    from service.cli.folder import new_results
    from service.client import Client

    options = flags.options()
    before, after = read_file(no_flash, "photograph"), read_file(flash, "photograph")
    with Client(url) as client, new_results(output) as folder:
        job = client.submit_pair(before, after, options)
        with stage_bar() as report:
            job = client.wait(job, report)
        client.download(job, folder)
        manifest = json.loads((folder / "manifest.json").read_bytes())
    print_results(manifest, output, as_json)


@app.command()
def cameras() -> None:
    """List the cameras that can take a pair."""
    import drivers

    for camera in drivers.list_cameras():
        battery = "" if camera.battery_percent is None else f", battery {camera.battery_percent} %"
        print(f"{camera.address}  {camera.make} {camera.model}{battery}")


@app.command()
def capture(
    address: Annotated[str, typer.Argument(metavar="ADDRESS", help="Camera, like sim://studio.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder of the photographs.")
    ],
) -> None:
    """Have a camera take a pair, and save both photographs."""
    import drivers
    from service.cli.folder import new_results

    names = []
    with new_results(output) as folder:
        with drivers.open_camera(address) as camera:
            pair = drivers.capture_pair(camera)
        for frame, shot in {"no_flash": pair.no_flash, "flash": pair.flash}.items():
            for kind, data in shot.files.items():
                names.append(f"{frame}.{'jpg' if kind == 'jpeg' else kind}")
                (folder / names[-1]).write_bytes(data)
    for name in names:
        print(output / name)
