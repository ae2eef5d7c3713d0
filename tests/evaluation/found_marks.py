"""How often charts and spheres are found by themselves, and how well: docs/found_marks.md.

Of each kind of seeded room (tests.cluttered) what was found, what was refused, and what was taken
for a target and is none.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from pipeline.calibration.find_chart import find_charts
from pipeline.calibration.find_sphere import find_spheres
from tests.cluttered import FOCAL_PX, SIZE, Plan, Room, Target, photograph_room
from tests.evaluation.environment import settle
from tests.evaluation.tables import markdown

_DOCS = Path(__file__).parents[2] / "docs"
_HEAD = Path(__file__).with_name("found_marks_head.md")
_NEAR = 0.1
"""Of a patch's pitch or a sphere's radius: farther off is a wrong find."""

Case = tuple[str, Target, Target, Plan, int]
CASES: tuple[Case, ...] = (
    ("a ColorChecker", "chart", "chart", Plan(), 120),
    ("a small, steep, blurred one", "chart", "chart", Plan((0.15, 0.25), 50.0, 2.0), 40),
    ("two ColorCheckers", "chart", "chart", Plan(targets=2), 20),
    ("a ColorChecker, two fifths covered", "chart", "chart", Plan(cut=0.4), 20),
    ("a ColorChecker, four times overexposed", "chart", "chart", Plan(exposure=4.0), 20),
    ("a ColorChecker that the flash does not reach", "chart", "chart", Plan(shadow=True), 20),
    ("no ColorChecker", "none", "chart", Plan(), 40),
    ("a matt sphere", "matt", "matt", Plan(), 40),
    ("no sphere", "none", "matt", Plan(), 20),
    ("a mirror sphere", "mirror", "mirror", Plan(), 40),
    ("a matt sphere, a mirror looked for", "matt", "mirror", Plan(), 20),
)


@dataclass(frozen=True)
class Find:
    """What became of a room. count: things that fit. off: of the only one, by its size."""

    case: str
    count: int
    off: float | None


def look(case: str, target: Target, wanted: Target, plan: Plan, seed: int) -> Find:
    """Look for something in a room."""
    room = photograph_room(target, seed, plan)
    offs = _offs(room, wanted)
    return Find(case, len(offs), offs[0] if len(offs) == 1 else None)


def _offs(room: Room, wanted: Target) -> list[float]:
    """How far from the truth each find is, by the size of it; infinitely where there is none."""
    no_flash = np.maximum(room.frames[0], 0)
    flash = np.maximum(room.frames[1] - room.frames[0], 0)
    if wanted == "chart":
        found = find_charts(flash)
        if room.corners is None:
            return [np.inf] * len(found)
        true = room.corners
        pitch = float(np.linalg.norm(true[1] - true[0])) / 5
        return [float(np.abs(one.corners - true).max()) / pitch for one in found]
    spheres = find_spheres(no_flash, flash, wanted == "mirror", FOCAL_PX)
    true_circle = room.circle
    if true_circle is None:
        return [np.inf] * len(spheres)
    return [
        max(abs(getattr(s, name) - getattr(true_circle, name)) for name in ("x", "y", "radius"))
        / true_circle.radius
        for s in spheres
    ]


def row(case: Case, finds: list[Find]) -> list[str]:
    """Figures of one kind of room."""
    right = [one.off for one in finds if one.off is not None and one.off < _NEAR]
    wrong = sum(one.off is not None and one.off >= _NEAR for one in finds)
    return [
        case[0],
        str(len(finds)),
        str(len(right)),
        str(sum(one.count == 0 for one in finds)),
        str(sum(one.count > 1 for one in finds)),
        str(wrong),
        f"{100 * np.median(right):.1f} / {100 * max(right):.1f}" if right else "–",
    ]


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.evaluation.found_marks", description=__doc__
    )
    parser.add_argument("--share", type=float, default=1.0, help="of the rooms, printed only")
    share = parser.parse_args().share
    settle()
    head = ["in the room", "rooms", "found", "not found", "more than one", "wrong", "off, %"]
    table = [head]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for case in CASES:
            name, target, wanted, plan, count = case
            jobs = [
                pool.submit(look, name, target, wanted, plan, 1000 + seed)
                for seed in range(max(1, round(count * share)))
            ]
            table.append(row(case, [job.result() for job in jobs]))
            sys.stdout.write("  ".join(table[-1]) + "\n")
            sys.stdout.flush()
    if share == 1.0:
        size = f"{SIZE[0]} × {SIZE[1]}"
        text = _HEAD.read_text(encoding="utf-8").rstrip().replace("SIZE", size)
        (_DOCS / "found_marks.md").write_text(f"{text}\n\n{markdown(table)}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
