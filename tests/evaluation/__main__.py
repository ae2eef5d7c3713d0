"""How well lamps are separated and white is balanced, on rendered scenes.

All groups and methods on the report scenes write docs/evaluation.md, its data and its plots.
Anything less prints failures and a table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.goals import failures
from tests.evaluation.methods import METHODS
from tests.evaluation.report import write_report
from tests.evaluation.results import Result
from tests.evaluation.runs import run
from tests.evaluation.tables import aligned, failure_rows, summary
from tests.evaluation.white_balance import BALANCES

_METHODS = (*METHODS, *BALANCES)
_DOCS = Path(__file__).parents[2] / "docs"


def main() -> None:
    """Run what the arguments ask for."""
    arguments = _arguments()
    outcome = run(arguments.groups, arguments.methods, arguments.set, _tell)
    for rows in (failure_rows(failures(outcome)), summary(outcome)):
        sys.stdout.write(f"\n{aligned(rows)}\n")
    everything = (tuple(EXPERIMENTS), _METHODS)
    if arguments.set == "report" and (arguments.groups, arguments.methods) == everything:
        write_report(outcome, _DOCS)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.evaluation", description=__doc__)
    parser.add_argument("--set", choices=("development", "report"), default="report")
    for name, known in (("--groups", EXPERIMENTS), ("--methods", _METHODS)):
        parser.add_argument(
            name,
            type=_some_of(known),
            default=tuple(known),
            metavar="A,B,…",
            help=f"some of {', '.join(known)}; default: all",
        )
    return parser.parse_args()


def _some_of(known: Iterable[str]) -> Callable[[str], tuple[str, ...]]:
    names = tuple(known)

    def parse(text: str) -> tuple[str, ...]:
        chosen = tuple(text.split(","))
        unknown = ", ".join(name for name in chosen if name not in names)
        if unknown:
            raise argparse.ArgumentTypeError(f"{unknown}: there are {', '.join(names)}")
        return chosen

    return parse


def _tell(experiment: str, results: list[Result]) -> None:
    sys.stdout.write("  ".join([experiment, results[0].scene, *map(_short, results)]) + "\n")
    sys.stdout.flush()


def _short(result: Result) -> str:
    snr = f"{result.found} of {result.lamps}" if result.snr_db is None else f"{result.snr_db:.1f}"
    return f"{result.method} {snr}"


if __name__ == "__main__":
    main()
