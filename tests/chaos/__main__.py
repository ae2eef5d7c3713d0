"""Breaks a service in every way while clients use it, and accounts for every job at the end.

python -m tests.chaos --jobs 200 --faults 60 --seed 1 --setup sqlite, as `make chaos` does for both
set-ups. Heartbeat and silence are those of the settings, so the defaults unless the environment
says otherwise. The last line is the account; docs/faults.md says how to read it.
"""

# ruff: noqa: T201  it is a command

from __future__ import annotations

import argparse
import math
import shutil
import statistics
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from service.rows import database
from tests.chaos import accounts
from tests.chaos.clients import Clients, Ledger, pairs
from tests.chaos.faults import Faults
from tests.chaos.plan import FAULTS, Fault, Wish, plan
from tests.chaos.service import SETUPS, Service
from tests.chaos.takeovers import Takeovers

_CLIENTS = 6
_LEAD = 3  # jobs by which clients may be ahead of the faults


def main() -> int:
    """Run one set-up; 0 when nothing was lost, stuck, doubled or left over."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos")
    parser.add_argument("--jobs", type=int, default=200)
    parser.add_argument("--faults", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--setup", choices=list(FAULTS), default="sqlite")
    parser.add_argument(
        "--lights", type=int, help="tell jobs, which end sooner, how many there are"
    )
    wanted = parser.parse_args()
    options = {} if wanted.lights is None else {"lights": wanted.lights}
    folder = Path(tempfile.mkdtemp(prefix="chaos-"))
    wishes, faults = plan(wanted.setup, wanted.jobs, wanted.faults, wanted.seed)
    with SETUPS[wanted.setup](folder) as service:
        found, seconds, noticed = _run(service, wishes, faults, f"chaos-{wanted.seed}", options)
    for kind, sentences in vars(found).items():
        for sentence in sentences:
            print(f"{kind}: {sentence}")
    if found.sound:
        shutil.rmtree(folder)
    else:
        print(f"the logs are in {folder}")
    if seconds:
        print(
            f"takeovers={len(seconds)} takeover_median_s={statistics.median(seconds):.1f}", end=" "
        )
        print(f"back_in_queue_worst_s={max(noticed, default=0):.1f}")
    worst = f"{max(seconds):.1f}" if seconds else "none"
    counts = " ".join(f"{kind}={len(sentences)}" for kind, sentences in vars(found).items())
    print(
        f"chaos: setup={wanted.setup} jobs={wanted.jobs} faults={wanted.faults} {counts} "
        f"takeover_worst_s={worst}"
    )
    return 0 if found.sound else 1


def _run(
    service: Service,
    wishes: list[Wish],
    faults: list[Fault],
    name: str,
    options: dict[str, int],
) -> tuple[accounts.Accounts, list[float], list[float]]:
    engine = database.connect(service.settings.database_url)
    takeovers, ledger, stop = Takeovers(engine), Ledger(), threading.Event()
    clients = Clients(service.urls, pairs(), ledger, name, options)
    watcher = threading.Thread(target=takeovers.watch, args=(stop,), daemon=True)
    try:
        service.start()
        clients.ask("GET", "/readyz")
        watcher.start()
        _break(service, clients, takeovers, wishes, faults)
        stuck = accounts.settle(engine, ledger)
        found = accounts.reckon(service, engine, clients, takeovers, ledger)
        found.stuck += stuck
        noticed = accounts.noticed(service, takeovers)
        found.orphans += accounts.leftovers(service)
    finally:
        stop.set()
        clients.close()
    return found, takeovers.seconds, noticed


def _break(
    service: Service,
    clients: Clients,
    takeovers: Takeovers,
    wishes: list[Wish],
    faults: list[Fault],
) -> None:
    """Clients and faults side by side, neither far ahead of the other, to the last job's end."""
    done: float = 0
    begun = 0
    step = threading.Condition()
    share = len(faults) / len(wishes)

    def client(wish: Wish) -> None:
        nonlocal begun
        with step:
            step.wait_for(lambda: done >= (wish.number - _LEAD) * share - 1)
            begun += 1
            step.notify_all()
        clients.do(wish)

    breaking = Faults(service, takeovers)
    start = time.monotonic()
    with ThreadPoolExecutor(_CLIENTS) as pool:
        sent = [pool.submit(client, wish) for wish in wishes]
        try:
            for number, fault in enumerate(faults):
                wanted = min(number / share, len(wishes))
                with step:
                    step.wait_for(lambda wanted=wanted: begun >= wanted)  # type: ignore[misc]
                time.sleep(fault.pause)
                what = breaking.do(fault)
                print(f"{time.monotonic() - start:6.1f} s  {fault.kind}: {what}", flush=True)
                service.start()
                with step:
                    done += 1
                    step.notify_all()
        finally:
            with step:
                done = math.inf
                step.notify_all()
        for one in sent:
            one.result()


if __name__ == "__main__":
    sys.exit(main())
