"""Sends hostile requests and damaged photographs to a service of its own.

Requests and photographs are drawn by chance: the same seed draws the same ones. The last line says
what came of it; the exit code is 1 when the service broke.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from tests.hostile.run import Run
from tests.hostile.target import Target


def main() -> int:
    """Run what the arguments ask for."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("--requests", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hostile-") as folder:
        target = Target(Path(folder))
        try:
            run = Run(target, arguments.requests, arguments.seed)
            outcome = run.go()
            outcome.faults.extend(target.tracebacks())
        finally:
            target.close()
    told = [
        *outcome.faults,
        f"statuses: {dict(sorted(outcome.statuses.items()))}",
        f"closed without an answer: {dict(outcome.unanswered)}",
        f"jobs: {outcome.jobs}, ends: {dict(outcome.ends)}",
        outcome.line(),
    ]
    sys.stdout.write("\n".join(told) + "\n")
    return int(outcome.broken)


if __name__ == "__main__":
    sys.exit(main())
