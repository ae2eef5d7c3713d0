"""`lightlayers tether`: the agent on the host where the camera hangs."""

from __future__ import annotations

import contextlib
import json
import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.cli import keys
from service.cli.enter import await_enter, pause
from service.cli.files import read_file, shown
from service.cli.parameters import (
    FlashSwitch,
    KeyFile,
    RecipeFile,
    Settle,
    SetValues,
    a_number,
)
from service.cli.shooting import (
    ending,
    new_shot,
    paced,
    say,
    wanted_settings,
)

if TYPE_CHECKING:
    import drivers
    from service.sending.spool import Spool

_FAILED = 1
_PAUSE_S = 2.0
"""After a pair that failed, where nobody presses Enter for the next."""


def tether(
    server: Annotated[str, typer.Option(metavar="URL", help="Where the service is.")],
    camera: Annotated[str, typer.Option(metavar="ADDRESS", help="Camera, like ptp+usb://.")],
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
    flash: FlashSwitch = "property",
    settle: Settle = 1.0,
    settings: SetValues = None,
    recipe: RecipeFile = None,
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
    from service.cli.flash import flash_switch
    from service.sending.client import Client
    from service.sending.sender import Sender
    from service.sending.spool import Spool
    from service.settings import Settings

    told = _Told(as_json)
    wanted = wanted_settings(settings, recipe)
    switch = flash_switch(flash, settle, lambda text: told("operator", text))
    asked = _options(options)
    key = keys.key_of_requests(key_file)
    with contextlib.ExitStack() as stack:
        opened = drivers.ReturningCamera(camera, lambda text: told("camera", text))
        stack.callback(opened.close)
        client = stack.enter_context(Client(server, key))
        pool = Spool(spool or Settings().data_dir / "spool")
        stack.callback(pool.close)
        sender = Sender(pool, client, told)
        stack.callback(sender.stop)
        taking = _Taking(opened, switch, wanted, asked, pool, told)

        def tell_left() -> None:
            with contextlib.suppress(OSError):  # a spool that cannot be read hides no other error
                waiting, place = pool.count(), str(pool.folder)
                sentence = f"Pairs in the spool {place}, which the next start with it sends"
                told("ended", f"{sentence}: {waiting}.", waiting=waiting, spool=place)

        try:
            for _ in taking.presses(pairs, interval):
                taking.take()
                sender.notice()
            opened.close()
            emptied = sender.finish()
        except BaseException:
            tell_left()
            raise
        if not emptied:
            tell_left()
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


class _Taking:
    """Takes pairs into the spool. failed: how many did not get there."""

    def __init__(
        self,
        camera: drivers.ReturningCamera,
        switch: drivers.Flash,
        wanted: dict[drivers.SettingName, drivers.SettingValue],
        options: dict[str, Any],
        spool: Spool,
        told: _Told,
    ) -> None:
        self.failed = 0
        self._camera, self._switch, self._wanted = camera, switch, wanted
        self._options, self._spool, self._told = options, spool, told

    def presses(self, count: int | None, interval_s: float | None) -> Iterator[int]:
        """Give 1, 2 …: when a pair is to be taken; the camera is there then."""
        if interval_s is not None:
            for number in paced(count, interval_s):
                self._camera.connected(wait_s=math.inf)
                failed = self.failed
                yield number
                if self.failed > failed and number != count:
                    time.sleep(_PAUSE_S)
            return
        number = 0
        while count is None or number < count:
            try:
                self._camera.connected(wait_s=math.inf, pause=pause)
            except EOFError:
                return
            self._told("ready", "Press Enter to take a pair.")
            if not await_enter():
                return
            number += 1
            yield number

    def take(self) -> None:
        """Take a pair; where that fails, say so, and the next press takes another."""
        import drivers
        from pipeline.errors import InputError, reason_of

        try:
            pair = drivers.capture_pair(
                self._camera.connected(), flash=self._switch, settings=self._wanted
            )
            shot = new_shot()
            frames = {"no_flash": pair.no_flash, "flash": pair.flash}
            photographs = {frame: _best(one) for frame, one in frames.items()}
            spooled = self._spool.add(shot, photographs, self._options)
        except (drivers.DriverError, InputError) as error:  # whose brightness cannot be told, too
            self._camera.close()
            self._fail(str(error))
        except OSError as error:
            self._fail(
                f"The spool {self._spool.folder} cannot be written: {reason_of(error)}. See to the "
                "folder and its disk: the pair is on the camera's card alone."
            )
        else:
            facts: dict[str, Any] = {"shot": shot, "sha256": spooled.sha256}
            with contextlib.suppress(OSError):  # the pair is on the disk, whoever can count it
                facts["waiting"] = self._spool.count()
            self._told("spooled", f"{shot}: in the spool{_but(spooled.doubt)}", **facts)

    def _fail(self, sentence: str) -> None:
        self.failed += 1
        self._told("failed", sentence)


def _but(doubt: str | None) -> str:
    if doubt is None:
        return ""
    return (
        f", but its disk fails: {doubt}. Keep the camera's card until the pair is sent, and check "
        "the disk."
    )


def _best(shot: drivers.Shot) -> tuple[str, bytes]:
    """How the file to be separated ends, and its bytes; what else there is stays on the card."""
    return ending(shot.best_kind), shot.best


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
        Options.model_validate(take_out(asked)[0])  # only the service knows calibrations, names
    except ValidationError as error:
        raise OptionError(f"The file of options {path}: {sentence_of(error)}") from error
    return asked
