"""What is going to happen, all of it drawn from one seed; only the times it takes are not."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random
from typing import Literal

FAULTS = {
    "sqlite": (
        "kill_worker",
        "kill_worker",
        "kill_child",
        "kill_fork_server",
        "kill_host",
        "freeze_worker",
        "freeze_host",
        "freeze_child",
        "restart_host",
        "fill_disk",
    ),
    "postgresql": (
        "kill_worker",
        "kill_worker",
        "kill_child",
        "kill_fork_server",
        "kill_api",
        "kill_host",
        "freeze_worker",
        "freeze_host",
        "freeze_api",
        "freeze_child",
        "restart_host",
        "restart_api",
        "cut_host",
        "stop_database",
        "stop_store",
    ),
}
"""What may happen to each set-up; killing a worker is the fault that matters most."""


@dataclass(frozen=True)
class Wish:
    """What one client does with one job."""

    number: int
    pair: int | None  # which of the pairs to upload; None has a camera take one
    cut_at: float | None  # share of the body after which a first upload breaks off
    repeats: int  # how often the same request is sent again, at once
    then: Literal["wait", "cancel", "delete"]
    delay: float  # seconds until then


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong, and for how long: 0…1 of what is usual for it."""

    kind: str
    victim: float  # 0…1 of the possible ones
    length: float
    pause: float  # seconds before it


def plan(setup: str, jobs: int, faults: int, seed: int) -> tuple[list[Wish], list[Fault]]:
    """Draw what the clients do and what goes wrong."""
    chance = Random(f"{setup} {seed}")
    wishes = [_wish(chance, number) for number in range(jobs)]
    kinds = list(FAULTS[setup])
    chance.shuffle(kinds)
    drawn = [
        # each kind once, where there are faults enough, and then at random
        kinds[number] if number < len(kinds) else chance.choice(kinds)
        for number in range(faults)
    ]
    return wishes, [
        Fault(kind, chance.random(), chance.random(), chance.uniform(0, 3)) for kind in drawn
    ]


def _wish(chance: Random, number: int) -> Wish:
    then: Literal["wait", "cancel", "delete"] = chance.choices(
        ("wait", "cancel", "delete"), (0.7, 0.15, 0.15)
    )[0]
    return Wish(
        number=number,
        pair=None if chance.random() < 0.2 else chance.randrange(3),
        cut_at=chance.uniform(0.1, 0.95) if chance.random() < 0.15 else None,
        repeats=chance.choice((1, 2)) if chance.random() < 0.2 else 0,
        then=then,
        delay=chance.uniform(0, 6),
    )
