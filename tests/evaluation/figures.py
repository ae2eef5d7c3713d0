"""Numbers out of results: what the tables, the plots and the goals are made of."""

from __future__ import annotations

import statistics
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.run_warnings import Code
from tests.evaluation.results import Result
from tests.evaluation.scenes import Scene

SURE = 0.9


@dataclass(frozen=True)
class Outcome:
    """All results of a run. results: by experiment. scenes: by name."""

    results: dict[str, list[Result]]
    scenes: dict[str, Scene]

    def snr(self, experiment: str, method: str) -> dict[str, float]:
        """Joint SNR in dB by scene, of those with as many layers as lamps."""
        return {
            r.scene: r.snr_db
            for r in self.results[experiment]
            if r.method == method and r.snr_db is not None
        }

    def median(self, experiment: str, method: str) -> float:
        """Median joint SNR in dB. Raises StatisticsError where there is none."""
        return statistics.median(self.snr(experiment, method).values())

    def errors(self, experiment: str, method: str) -> dict[str, float]:
        """Angles in degrees by scene, as Result.error_deg."""
        return {
            r.scene: r.error_deg
            for r in self.results[experiment]
            if r.method == method and r.error_deg is not None
        }

    def curve(
        self, values: dict[str, float], along: Callable[[Scene], float]
    ) -> dict[float, float]:
        """Medians of values by scene, gathered by a property of the scene, ascending."""
        gathered: dict[float, list[float]] = defaultdict(list)
        for name, value in values.items():
            gathered[along(self.scenes[name])].append(value)
        return {at: statistics.median(gathered[at]) for at in sorted(gathered)}

    def counted(self, suffix: str) -> list[Result]:
        """Results of the experiments that ask for the number of lamps. suffix: of their names."""
        return [
            result
            for name, results in self.results.items()
            if name.endswith(suffix)
            for result in results
        ]


def angle(scene: Scene) -> float:
    """Least angle between two lamps, to a tenth of a degree."""
    return round(scene.angle_deg, 1)


def depth(scene: Scene) -> float:
    """Longest path of light in segments, infinite where it is followed until it has died away."""
    return float("inf") if scene.geometry.depth is None else float(scene.geometry.depth)


def roughness(scene: Scene) -> float:
    """Roughness α of the things, infinite where they are matte."""
    return float("inf") if scene.geometry.roughness is None else scene.geometry.roughness


def too_alike(result: Result) -> bool:
    """Whether the method says that lamps are too alike."""
    return Code.LAMPS_ALIKE in codes(result)


def four_or_more(result: Result) -> bool:
    """Whether the method says that three lamps do not explain the light."""
    return Code.FOUR_OR_MORE in codes(result)


def right(result: Result) -> bool:
    """Whether the number of lamps is right, which for four or more means that it is said."""
    if result.lamps > 3:
        return four_or_more(result)
    return result.found == result.lamps and not four_or_more(result)


def confusion(results: list[Result]) -> dict[int, Counter[str]]:
    """How often each number of lamps was answered with what."""
    table: dict[int, Counter[str]] = defaultdict(Counter)
    for result in results:
        answer = "4 or more" if four_or_more(result) else str(result.found)
        table[result.lamps]["refused" if result.refusal else answer] += 1
    return dict(sorted(table.items()))


def codes(result: Result) -> set[str]:
    """Codes of what the method warns of."""
    return {warning["code"] for warning in result.warnings}
