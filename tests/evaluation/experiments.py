"""What is evaluated: groups of scenes, each under a condition, by some methods."""

from __future__ import annotations

from dataclasses import dataclass, field

from tests.evaluation.conditions import Condition
from tests.evaluation.scenes import GROUPS

BASES = ("paper_pca", "paper_joint")
ROWS = ("equal", "nnmf", "von_kries", "paper", "paper_shared", "best", "known", "best_3x3")


@dataclass(frozen=True)
class Experiment:
    """Scenes of a group under a condition. group: one of scenes.GROUPS."""

    group: str
    condition: Condition = field(default_factory=Condition)
    methods: tuple[str, ...] = ROWS


EXPERIMENTS: dict[str, Experiment] = {group: Experiment(group) for group in GROUPS}
