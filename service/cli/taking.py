"""Takes the pairs of `lightlayers tether` into its spool, and tells of each."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from service.cli.enter import await_enter, pause
from service.cli.shooting import Shooting, ending, new_shot, paced

if TYPE_CHECKING:
    import drivers
    from service.sending.sender import Tell
    from service.sending.spool import Spool

_PAUSE_S = 2.0
"""After a pair that failed, where nobody presses Enter for the next."""


class Taking:
    """Takes pairs into the spool. failed: how many did not get there.

    options: of their jobs. told(event, sentence, **facts): hears what happens.
    """

    def __init__(
        self,
        camera: drivers.ReturningCamera,
        shooting: Shooting,
        options: dict[str, Any],
        spool: Spool,
        told: Tell,
    ) -> None:
        self.failed = 0
        self._camera, self._shooting, self._options = camera, shooting, options
        self._spool, self._told = spool, told

    def presses(self, count: int | None, interval_s: float | None) -> Iterator[int]:
        """Give 1, 2 … count, or no end, when a pair is to be taken; the camera is there then.

        interval_s: seconds from the beginning of a pair to that of the next; None: at each press of
        Enter, until stdin ends.
        """
        if interval_s is None:
            return self._at_enter(count)
        return self._at_intervals(count, interval_s)

    def _at_enter(self, count: int | None) -> Iterator[int]:
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

    def _at_intervals(self, count: int | None, interval_s: float) -> Iterator[int]:
        for number in paced(count, interval_s):
            self._camera.connected(wait_s=math.inf)
            failed = self.failed
            yield number
            if self.failed > failed and number != count:
                time.sleep(_PAUSE_S)

    def take(self) -> None:
        """Take a pair; where that fails, say so, and the next press takes another."""
        import drivers
        from pipeline.errors import InputError, reason_of

        try:
            pair = self._shooting.take(self._camera.connected())
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
