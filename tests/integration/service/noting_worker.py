"""A worker that only writes down what the queue gives it: python noting_worker.py URL NAME [HOST].

It holds each job until a line "go" comes, all later ones at once; "take over" has it take over the
jobs of every other worker.
"""

from __future__ import annotations

import os
import sys
import threading

from service.dbos_queue.launch import Duties, Pace, launch
from service.dbos_queue.queue import Queue
from service.rows import database


def main(url: str, name: str, host: str | None = None) -> None:
    go = threading.Event()

    def run(job_id: str, _again: int = 0) -> None:
        print(f"{job_id}\n", end="", flush=True)  # noqa: T201  what this program is for
        go.wait()

    connected = database.connect(url)
    queue = Queue(connected)
    duties = Duties(run, run, deliver=lambda *_delivery: None, sweep=lambda *_sweep: None)
    pace = Pace(concurrency=1, poll_seconds=0.05, sweep_seconds=60)
    launch(connected, name, host, duties, pace)
    for line in sys.stdin:
        if line == "go\n":
            go.set()
        else:
            queue.put_back(one for one in queue.held() if one.worker != name)
            print("taken over", flush=True)  # noqa: T201
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
