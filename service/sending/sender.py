"""Sends the pairs of a spool to a service: in order, each once, however often it must be tried."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any, Literal

from pipeline.errors import counted, reason_of
from service.frames import FRAMES
from service.sending.client import Client, Job
from service.sending.failures import RefusedError, ServiceAwayError
from service.sending.spool import DamagedPairError, Spool, SpooledPair

PAUSES_S = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
"""Between tries while the service is away; the last one is repeated."""

Event = Literal["sent", "aside", "held"]
Tell = Callable[..., None]
"""tell(event, sentence, **facts): a pair was sent or put aside, or all of them are held up."""


class _NotYetError(Exception):
    """The pair has to be tried again."""


def _sentence(error: Exception) -> str:
    if isinstance(error, ServiceAwayError | RefusedError | _NotYetError):
        return str(error)
    if isinstance(error, OSError):
        return f"The spool cannot be read or written: {reason_of(error)}."
    return f"Something broke inside lightlayers, please report it: {type(error).__name__}."


class Sender:
    """A thread that sends while there is something to send. aside: pairs that it put aside.

    The oldest pair is sent first, and until it has gone or is put aside no other is. Only one
    that will never pass is put aside; a key that is not good, say, holds them all up.
    """

    def __init__(self, spool: Spool, client: Client, tell: Tell) -> None:
        self.aside = 0
        self._spool, self._client, self._listener = spool, client, tell
        self._news, self._ended, self._stopped = (threading.Event() for _ in range(3))
        self._held: str | None = None
        self._emptied = False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def notice(self) -> None:
        """Look into the spool: there is another pair."""
        self._news.set()

    def finish(self) -> bool:
        """Wait until the spool is empty, or sending has ended before; gives whether it is empty.

        No more pairs may come.
        """
        self._ended.set()
        self._news.set()
        self._thread.join()
        return self._emptied

    def stop(self) -> None:
        """Begin nothing any more; what is under way may be cut off by the end of the process."""
        self._stopped.set()
        self._news.set()

    def _work(self) -> None:
        failures = 0
        while not self._stopped.is_set():
            self._news.clear()
            ended = self._ended.is_set()
            try:
                pair = self._spool.first()
                if pair is not None:
                    self._send(pair)
                elif ended:
                    self._emptied = True
                    return
                else:
                    self._news.wait()
                failures, self._held = 0, None
            except DamagedPairError as error:
                self.aside += 1
                self._tell("aside", str(error))
            except Exception as error:  # whatever it is, the pair stays and is tried again
                self._hold_up(_sentence(error))
                self._stopped.wait(PAUSES_S[min(failures, len(PAUSES_S) - 1)])
                failures += 1

    def _tell(self, event: Event, sentence: str, **facts: Any) -> None:
        with contextlib.suppress(OSError, ValueError):  # that nobody can hear it stops no pair
            self._listener(event, sentence, **facts)

    def _hold_up(self, reason: str) -> None:
        """Tell why nothing goes, once for each reason."""
        if reason == self._held or self._stopped.is_set():
            return
        self._held = reason
        place, waiting = str(self._spool.folder), self._waiting()
        if waiting:
            pairs = counted(waiting["waiting"], "pair waits", "pairs wait")
            more = f"{pairs} in the spool {place}."
        else:  # that may be why nothing goes
            more = f"See to {place} and its disk, then it goes on."
        self._tell("held", f"{reason} {more}", reason=reason, spool=place, **waiting)

    def _waiting(self) -> dict[str, int]:
        """Tell how many pairs wait, where the spool can be read."""
        with contextlib.suppress(OSError):
            return {"waiting": self._spool.count()}
        return {}

    def _send(self, pair: SpooledPair) -> None:
        """Send a pair, or put it aside. Raises what is worth another try."""
        if damage := pair.damage():
            self._put_aside(pair, f"{damage[0].upper()}{damage[1:]}.")
            return
        uploads = self._spool.uploads(pair)
        try:
            job = self._submit(pair, uploads)
        except RefusedError as error:
            if not error.final:
                raise
            if self._uploads_gone(uploads):  # and no job has them, or it would have been given
                self._spool.note_uploads(pair, {})
                raise _NotYetError("The service kept the uploads no longer.") from error
            self._put_aside(pair, str(error), status=error.status)
            return
        self._confirm(pair, job)

    def _submit(self, pair: SpooledPair, uploads: dict[str, str]) -> Job:
        for frame in FRAMES:
            path = pair.path(frame)
            size = path.stat().st_size
            if frame not in uploads:
                uploads[frame] = self._client.create_upload(size)
                self._spool.note_uploads(pair, uploads)
            offset = self._client.upload_offset(uploads[frame])
            if offset is not None and offset < size:
                with path.open("rb") as file:
                    self._client.append_to_upload(uploads[frame], file, offset, size)
        return self._client.submit_uploads(uploads, pair.about.options, pair.about.id)

    def _uploads_gone(self, uploads: dict[str, str]) -> bool:
        gone = [self._client.upload_offset(each) is None for each in uploads.values()]
        return any(gone)

    def _confirm(self, pair: SpooledPair, job: Job) -> None:
        """Let go of a pair whose every byte the service has."""
        stored = {frame: job["inputs"][frame]["sha256"] for frame in FRAMES}
        if stored != pair.sha256:
            self._put_aside(
                pair, f"The service has other bytes than were sent, see its job {job['id']}."
            )
            return
        self._spool.remove(pair)
        facts = {"shot": pair.shot, "job": job["id"], **self._waiting()}
        self._tell("sent", f"{pair.shot}: job {job['id']}", **facts)

    def _put_aside(self, pair: SpooledPair, reason: str, **facts: Any) -> None:
        place = self._spool.put_aside(pair, reason)
        self.aside += 1
        self._tell(
            "aside",
            f"{pair.shot}: {reason} The pair is put aside in {place}.",
            shot=pair.shot,
            reason=reason,
            folder=str(place),
            **facts,
        )
