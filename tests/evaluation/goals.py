"""What is asked of `best`, and where it fails."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass

from tests.evaluation.figures import (
    SURE,
    Outcome,
    angle,
    depth,
    four_or_more,
    right,
    roughness,
    too_alike,
)
from tests.evaluation.results import Result

_SLACK_DB = 0.5


@dataclass(frozen=True)
class Goal:
    """A figure and its limit. at_least: whether the limit is the least or the most allowed."""

    text: str
    figure: float
    limit: float
    at_least: bool = True

    @property
    def met(self) -> bool:
        """Whether the figure keeps to the limit."""
        return self.figure >= self.limit if self.at_least else self.figure <= self.limit


@dataclass(frozen=True)
class Failure:
    """A scene on which `best` falls short. text: of what, and by how much."""

    experiment: str
    scene: str
    text: str


def goals(outcome: Outcome) -> list[Goal]:
    """All goals, from the results of every experiment."""
    return [
        *_layers(outcome),
        *_hard_light(outcome),
        *_conditions(outcome),
        *_counts(outcome),
        *_never_worse(outcome),
        *_white(outcome),
    ]


def failures(outcome: Outcome) -> list[Failure]:
    """Scenes where `best` is worse than the published method, or below what is asked of all."""
    found = []
    for name in outcome.results:
        best, paper = outcome.snr(name, "best"), outcome.snr(name, "paper")
        for scene, value in best.items():
            if scene in paper and value < paper[scene] - _SLACK_DB:
                text = f"{paper[scene] - value:.1f} dB below the published method"
                found.append(Failure(name, scene, f"{text}, {value:.1f} dB"))
            least = _least(outcome, name, scene)
            if least is not None and value < least:
                found.append(Failure(name, scene, f"{value:.1f} dB, where {least:g} are asked"))
        found += [
            Failure(name, r.scene, f"refused: {r.refusal}")
            for r in outcome.results[name]
            if r.method == "best" and r.refusal
        ]
        if "-auto" in name:
            wrong = (r for r in outcome.results[name] if not (right(r) or r.refusal))
            found += [_miscounted(name, r) for r in wrong]
    return found


def _least(outcome: Outcome, experiment: str, name: str) -> float | None:
    """SNR in dB that every scene of a kind must reach."""
    scene = outcome.scenes[name]
    if experiment in ("smooth-two", "smooth-three"):
        return 14.0
    if experiment == "bounces" and scene.geometry.depth is None:
        return 17.5
    if experiment == "roughness" and scene.geometry.roughness == 0.1:
        return 22.0
    if experiment == "angle" and angle(scene) == 1.0 and not _warned(outcome, name):
        return 9.0
    return None


def _warned(outcome: Outcome, name: str) -> bool:
    return any(
        too_alike(r) for r in outcome.results["angle"] if r.scene == name and r.method == "best"
    )


def _miscounted(experiment: str, result: Result) -> Failure:
    answer = "four or more" if four_or_more(result) else result.found
    text = f"{answer} lamps found of {result.lamps}"
    return Failure(experiment, result.scene, f"{text}, confidence {result.confidence}")


def _layers(outcome: Outcome) -> Iterator[Goal]:
    for group, least, over in (("two", 20.0, 6.0), ("three", 18.0, 9.0)):
        best = outcome.median(group, "best")
        paper, ceiling = outcome.median(group, "paper"), outcome.median(group, "best_3x3")
        yield Goal(f"{group} lamps: median, dB", best, least)
        yield Goal(f"{group} lamps: over the published method, dB", best - paper, over)
        yield Goal(
            f"{group} lamps: below the best 3×3 per lamp, dB", ceiling - best, 1.0, at_least=False
        )
    yield Goal("two broad-band lamps: median, dB", outcome.median("broad-two", "best"), 28.0)
    yield Goal("three broad-band lamps: median, dB", outcome.median("broad-three", "best"), 24.0)


def _hard_light(outcome: Outcome) -> Iterator[Goal]:
    narrow = {
        name: value
        for name, value in outcome.snr("angle", "best").items()
        if not _warned(outcome, name)
    }
    sweep = outcome.curve(narrow, angle)
    if 1.0 in sweep:
        yield Goal("two lamps 1° apart, not warned of: median, dB", sweep[1.0], 9.0)
    plastic = outcome.curve(outcome.snr("roughness", "best"), roughness)
    yield Goal("plastic of roughness 0.1: median, dB", plastic[0.1], 22.0)
    bounces = outcome.curve(outcome.snr("bounces", "best"), depth)
    yield Goal("light of endless bounces: median, dB", bounces[float("inf")], 17.5)
    for group in ("smooth-two", "smooth-three"):
        values = outcome.snr(group, "best").values()
        yield Goal(f"{group}: worst, dB", min(values), 14.0)
        yield Goal(f"{group}: median, dB", statistics.median(values), 20.0)


def _conditions(outcome: Outcome) -> Iterator[Goal]:
    for group in ("two", "three"):
        noisy = outcome.median(f"{group}-noise", "best")
        ceiling = outcome.median(f"{group}-noise", "best_3x3")
        dark = outcome.median(f"{group}-noise-eighth", "best")
        moved = outcome.median(f"{group}-motion", "best")
        yield Goal(f"{group} lamps, noise: median, dB", noisy, 16.0)
        yield Goal(
            f"{group} lamps, noise: below the best 3×3 per lamp, dB",
            ceiling - noisy,
            2.5,
            at_least=False,
        )
        yield Goal(
            f"{group} lamps, noise at 1/8 exposure: loss, dB", noisy - dark, 8.0, at_least=False
        )
        yield Goal(
            f"{group} lamps, hand motion: loss, dB",
            outcome.median(group, "best") - moved,
            3.0,
            at_least=False,
        )


def _counts(outcome: Outcome) -> Iterator[Goal]:
    counted = outcome.counted("-auto")
    few, many = [r for r in counted if r.lamps < 4], [r for r in counted if r.lamps > 3]
    sure = [r for r in counted if r.confidence is not None and r.confidence >= SURE]
    yield Goal("number of lamps right, of one to three, %", _percent(few), 85.0)
    yield Goal("four lamps told from three, %", _percent(many), 90.0)
    if sure:
        yield Goal(f"number right where confidence is {SURE} or more, %", _percent(sure), 90.0)


def _percent(results: list[Result]) -> float:
    return 100.0 * sum(right(r) for r in results) / len(results)


def _never_worse(outcome: Outcome) -> Iterator[Goal]:
    behind, scene_behind = [], []
    for name in outcome.results:
        paper, shared = outcome.snr(name, "paper"), outcome.snr(name, "paper_shared")
        best = outcome.snr(name, "best")
        if shared and best:
            behind.append(statistics.median(shared.values()) - statistics.median(best.values()))
        scene_behind += [paper[scene] - best[scene] for scene in best if scene in paper]
    yield Goal(
        "worst group: below the published method shared out, dB",
        max(behind),
        _SLACK_DB,
        at_least=False,
    )
    yield Goal(
        "worst scene: below the published method, dB",
        max(scene_behind),
        _SLACK_DB,
        at_least=False,
    )


def _white(outcome: Outcome) -> Iterator[Goal]:
    for group, most_deg, least_db in (("two", 0.35, 32.0), ("three", 0.35, 28.0)):
        colour = statistics.median(outcome.errors(f"white-{group}", "best_1").values())
        snr = outcome.median(f"white-{group}", "best_1")
        yield Goal(f"white balance, {group} lamps: colour, °", colour, most_deg, at_least=False)
        yield Goal(f"white balance, {group} lamps: SNR, dB", snr, least_db)
    phone = statistics.median(outcome.errors("white-two-led", "best_1").values())
    yield Goal("white balance, LED flash: colour, °", phone, 0.8, at_least=False)
