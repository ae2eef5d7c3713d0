"""Sends hostile requests to a service and counts what they break."""

from __future__ import annotations

import random
import statistics
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from tests.hostile.attacks import ATTACKS
from tests.hostile.photographs import pairs
from tests.hostile.target import Target
from tests.hostile.wire import Answer, SilentError, Wire

GROWTH_MIB = 48
"""What the API, or the worker, may hold more at the end than after a tenth of the requests."""

_DOCUMENTED = (503, 507)
_AT_ONCE = 4
_WAITING_JOBS = 4
_LOOK_SECONDS = 0.5
_JOB_SECONDS = 900
_ENDED = ("succeeded", "failed", "canceled", "expired")


@dataclass
class Outcome:
    """What came of it."""

    requests: int = 0
    server_errors: int = 0
    workers_lost: int = 0
    stuck: int = 0
    growth_mib: float = 0.0
    jobs: int = 0
    statuses: Counter[int] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    unanswered: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    @property
    def broken(self) -> bool:
        """Whether the service did what it must not."""
        bad = self.server_errors or self.workers_lost or self.stuck
        return bool(bad or self.growth_mib > GROWTH_MIB)

    def line(self) -> str:
        """Tell it in one line."""
        return (
            f"hostile: requests={self.requests} server_errors={self.server_errors} "
            f"workers_lost={self.workers_lost} stuck={self.stuck} "
            f"growth_mib={self.growth_mib:.1f}"
        )


class Run:
    """One run; the same seed draws the same requests."""

    def __init__(self, target: Target, requests: int, seed: int) -> None:
        self.outcome = Outcome()
        self._target = target
        self._wire = Wire(target.port)
        self._wanted = requests
        self._seed = seed
        self._pairs = pairs()
        self._lock = threading.Lock()
        self._jobs: list[str] = []
        self._memory: list[tuple[float, dict[str, float]]] = []

    def go(self) -> Outcome:
        """Send all requests, and wait until every job that came of them has ended."""
        done = threading.Event()
        watch = threading.Thread(target=self._watch, args=(done,))
        watch.start()
        try:
            with ThreadPoolExecutor(_AT_ONCE) as pool:
                # Attacks are several requests at times: the last ones find them all sent.
                list(pool.map(self._attack, range(self._wanted)))
            self._await_jobs()
        finally:
            done.set()
            watch.join()
        self.outcome.workers_lost = self._target.workers_lost()
        if not self._target.lives():
            self._blame("the API ended")
        self._look()
        self.outcome.growth_mib = growth(self._memory)
        return self.outcome

    def _attack(self, number: int) -> None:
        if self.outcome.requests >= self._wanted:
            return
        chance = random.Random(f"{self._seed} {number}")
        attack = chance.choices([*ATTACKS], [*ATTACKS.values()])[0]
        try:
            answers = attack(chance, self._wire, self._pairs)
        except SilentError:
            with self._lock:
                self.outcome.stuck += 1
                self.outcome.faults.append(f"{attack.__name__} {number}: no answer")
            return
        except ConnectionError:
            self._blame(f"{attack.__name__} {number}: no connection")
            return
        for answer in answers:
            self._judge(f"{attack.__name__} {number}", answer)
        for answer in answers:
            if answer.status == 202:
                self._take_job(answer, chance)

    def _judge(self, what: str, answer: Answer) -> None:
        with self._lock:
            self.outcome.requests += 1
            self.outcome.statuses[answer.status] += 1
            if not answer.status:
                self.outcome.unanswered[what.partition(" ")[0]] += 1
        if answer.status >= 500 and answer.status not in _DOCUMENTED:
            self._blame(f"{what}: {answer.status} {answer.body[:300].decode('latin-1')}")

    def _blame(self, fault: str) -> None:
        with self._lock:
            self.outcome.server_errors += 1
            self.outcome.faults.append(fault)

    def _take_job(self, answer: Answer, chance: random.Random) -> None:
        """Note a job; when many wait already, give it up in one of the two ways."""
        place = answer.headers["location"]
        with self._lock:
            self.outcome.jobs += 1
            self._jobs.append(place)
        if self._waiting() > _WAITING_JOBS:
            if chance.random() < 0.5:
                self._judge("cancel", self._wire.send("POST", f"{place}/cancel"))
            else:
                self._judge("delete", self._wire.send("DELETE", place))

    def _waiting(self) -> int:
        """Count the jobs that have not ended, and forget those that have."""
        waiting = []
        with self._lock:
            places = list(self._jobs)
        for place in places:
            state = self._state(place)
            if state.partition(" ")[0] not in _ENDED:
                waiting.append(place)
                continue
            with self._lock:
                if place in self._jobs:
                    self._jobs.remove(place)
                    self.outcome.ends[state] += 1
        return len(waiting)

    def _state(self, place: str) -> str:
        answer = self._wire.send("GET", place)
        if answer.status == 404:
            return "canceled by deletion"
        if answer.status != 200:
            self._judge("look", answer)
            return "unknown"
        job = answer.json()
        why = job["error"]["type"].rpartition(":")[2] if job["error"] else ""
        return f"{job['state']} {why}".strip()

    def _await_jobs(self) -> None:
        deadline = time.monotonic() + _JOB_SECONDS
        while (waiting := self._waiting()) and time.monotonic() < deadline:
            time.sleep(_LOOK_SECONDS)
        self.outcome.stuck += waiting
        self.outcome.faults += [f"{place} did not end" for place in self._jobs]

    def _watch(self, done: threading.Event) -> None:
        while not done.wait(_LOOK_SECONDS):
            self._look()

    def _look(self) -> None:
        share = min(self.outcome.requests / self._wanted, 1.0)
        self._memory.append((share, self._target.memory()))


def growth(memory: list[tuple[float, dict[str, float]]]) -> float:
    """MiB that the one which grew most has grown by since a tenth of the requests.

    memory: looks in their order, each the share of the requests that were sent, and MiB by name;
    the last one is of the end.
    """
    seen = [look for look in memory if look[0] >= 0.1]
    early = [held for share, held in seen if share < 0.2] or [held for _, held in seen[:1]]
    late = [held for share, held in seen if share >= 0.9]
    grown = []
    for name in ("api", "worker"):
        before, after = ([held[name] for held in some if name in held] for some in (early, late))
        if before and after:
            grown.append(statistics.median(after) - statistics.median(before))
    return max(grown, default=0.0)  # those that have ended are counted elsewhere
