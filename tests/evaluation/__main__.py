"""make evaluate: how well lamps are separated on rendered scenes.

The report scenes make docs/evaluation.md. For tuning there are the development scenes:
python -m tests.evaluation --set development --groups two --methods paper,best
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable

from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.methods import METHODS
from tests.evaluation.results import Result
from tests.evaluation.runs import run
from tests.evaluation.tables import aligned, summary_rows


def main() -> None:
    """Run what the arguments ask for."""
    arguments = _arguments()
    results = run(arguments.groups, arguments.methods, arguments.set, _tell)
    sys.stdout.write("\n" + aligned(summary_rows(results)) + "\n")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.evaluation", description=__doc__)
    parser.add_argument("--set", choices=("development", "report"), default="report")
    parser.add_argument("--groups", type=_some_of(EXPERIMENTS), default=tuple(EXPERIMENTS))
    parser.add_argument("--methods", type=_some_of(METHODS), default=tuple(METHODS))
    return parser.parse_args()


class _some_of:  # noqa: N801  argparse shows it as a function
    def __init__(self, known: Iterable[str]) -> None:
        self._known = tuple(known)

    def __call__(self, text: str) -> tuple[str, ...]:
        chosen = tuple(text.split(","))
        unknown = [name for name in chosen if name not in self._known]
        if unknown:
            raise argparse.ArgumentTypeError(
                f"{', '.join(unknown)} is none of {', '.join(self._known)}"
            )
        return chosen


def _tell(_name: str, results: list[Result]) -> None:
    figures = "  ".join(
        f"{r.method} {'–' if r.snr_db is None else f'{r.snr_db:.1f}'}" for r in results
    )
    sys.stdout.write(f"{results[0].scene}  {figures}\n" if results else "")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
