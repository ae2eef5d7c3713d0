"""`lightlayers tether`: the agent on the host where the camera hangs."""

from __future__ import annotations

import contextlib
import json
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli import keys
from service.cli.files import read_file, say, shown
from service.cli.parameters import KeyFile, a_number, with_flags
from service.cli.shooting import ShootingFlags
from service.cli.taking import Taking

if TYPE_CHECKING:
    from service.sending.spool import Spool

_FAILED = 1


@with_flags
def tether(
    server: Annotated[str, typer.Option(metavar="URL", help="Where the service is.")],
    camera: Annotated[str, typer.Option(metavar="ADDRESS", help="Camera, like ptp+usb://.")],
    flags: ShootingFlags,
    spool: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder of the pairs that are still to be sent. Default: spool in the folder of "
            "LIGHTLAYERS_DATA_DIR, which is .lightlayers where the command is started.",
        ),
    ] = None,
    key_file: KeyFile = None,
    options: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Options of the jobs, as in the part options of a request."
        ),
    ] = None,
    interval: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=86400,
            callback=a_number,
            help="Take a pair every so many seconds, not at each press of Enter.",
        ),
    ] = None,
    pairs: Annotated[
        int | None, typer.Option(min=0, help="End after so many pairs; 0 only sends what waits.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print a line of JSON for whatever happens.")
    ] = False,
) -> int:
    """Take pairs with a camera that hangs here, and send them to a service elsewhere.

    Each press of Enter takes a pair; Ctrl-D, or the end of stdin, ends that, and what is left is
    sent. A pair goes to the disk first and stays there until the service has it, so that neither a
    cut network nor a crash loses one: the next start with the same spool sends it.
    """
    import drivers
    from service.sending.client import Client
    from service.sending.sender import Sender
    from service.sending.spool import Spool
    from service.settings import Settings

    told = _Told(as_json)
    shooting = flags.shooting(lambda text: told("operator", text))
    asked, key = _options(options), keys.key_of_requests(key_file)
    with contextlib.ExitStack() as stack:
        opened = drivers.ReturningCamera(camera, lambda text: told("camera", text))
        stack.callback(opened.close)
        client = stack.enter_context(Client(server, key))
        pool = Spool(spool or Settings().data_dir / "spool")
        stack.callback(pool.close)
        sender = Sender(pool, client, told)
        stack.callback(sender.stop)
        taking = Taking(opened, shooting, asked, pool, told)
        try:
            for _ in taking.presses(pairs, interval):
                taking.take()
                sender.notice()
            opened.close()
            emptied = sender.finish()
        except BaseException:
            _tell_left(pool, told)
            raise
        if not emptied:
            _tell_left(pool, told)
    return _FAILED if taking.failed or sender.aside or not emptied else 0


class _Told:
    """Prints what happens, from whichever thread: sentences for people, or JSON for programs."""

    def __init__(self, as_json: bool) -> None:
        self._as_json, self._lock = as_json, threading.Lock()

    def __call__(self, event: str, sentence: str, **facts: Any) -> None:
        """Tell of an event."""
        from service.cli.display import print_json

        with self._lock:
            if self._as_json:
                print_json({"event": event, "detail": sentence, **facts}, indent=None)
            elif event in ("spooled", "sent"):
                print(shown(sentence), flush=True)
            else:
                say(sentence)


def _tell_left(spool: Spool, told: _Told) -> None:
    with contextlib.suppress(OSError):  # a spool that cannot be read hides no other error
        waiting, place = spool.count(), str(spool.folder)
        sentence = f"Pairs in the spool {place}, which the next start with it sends"
        told("ended", f"{sentence}: {waiting}.", waiting=waiting, spool=place)


def _options(path: Path | None) -> dict[str, Any]:
    """Read the options of the jobs, and check what can be checked here. Raises InputError."""
    from pydantic import ValidationError

    from pipeline.errors import InputError, OptionError
    from pipeline.options import Options
    from service.calibration_names import take_out
    from service.sentences import sentence_of

    if path is None:
        return {}
    try:
        asked = json.loads(read_file(path, "file of options"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"The file of options {path} is no JSON: mend it.") from error
    if not isinstance(asked, dict):
        raise InputError(f'The file of options {path} is no JSON object like {{"lights": 2}}.')
    try:
        # only the service knows calibrations and names; the rest as it reads it: "2" is no number
        Options.model_validate_json(json.dumps(take_out(asked)[0]), strict=True)
    except ValidationError as error:
        raise OptionError(f"The file of options {path}: {sentence_of(error)}") from error
    return asked
