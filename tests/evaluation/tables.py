"""Tables of results, for the terminal and for the report."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Collection, Iterable
from itertools import pairwise

from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.figures import SURE, Outcome, confusion, right
from tests.evaluation.goals import Failure, Goal
from tests.evaluation.results import Result
from tests.evaluation.scenes import CAMERA, Scene

Rows = list[list[str]]
"""Cells, the first row the header."""

_ANSWERS = ("1", "2", "3", "4 or more", "refused")
_CONFIDENCES = (0.0, 0.5, 0.7, 0.8, SURE, 1.0)


def summary(outcome: Outcome) -> Rows:
    """A row per experiment and method: scenes, median and worst SNR, median Result.error_deg."""
    rows = [["group", "method", "scenes", "median dB", "worst dB", "error °"]]
    for name, results in outcome.results.items():
        for method in dict.fromkeys(result.method for result in results):
            values = outcome.snr(name, method).values()
            errors = outcome.errors(name, method).values()
            rows.append(
                [
                    name,
                    method,
                    str(len(values)),
                    _number(statistics.median(values) if values else None),
                    _number(min(values, default=None)),
                    _number(statistics.median(errors) if errors else None),
                ]
            )
    return rows


def compared(outcome: Outcome, experiments: Iterable[str], methods: tuple[str, ...]) -> Rows:
    """A row per experiment, a column per method: "median / worst" SNR in dB."""
    rows = [["group", "scenes", *methods]]
    for name in experiments:
        cells = [_median_worst(outcome.snr(name, method).values()) for method in methods]
        scenes = {result.scene for result in outcome.results[name]}
        rows.append([name, str(len(scenes)), *cells])
    return rows


def cameras(outcome: Outcome, lamps: str, failures: Iterable[Failure]) -> Rows:
    """A row per camera that took rooms of "two" or "three" lamps, and one of all but CAMERA.

    "median / worst" SNR in dB of every method, told the camera, untold, and from JPEG; and of how
    many rooms one is among the failures.
    """
    told = f"cameras-{lamps}"
    columns = [
        (name, method, f"{method}{name.removeprefix(told).replace('-', ', ')}")
        for name in (told, f"{told}-untold", f"{told}-jpeg")
        for method in EXPERIMENTS[name].methods
    ]
    failed = {one.scene for one in failures if one.experiment.startswith(told)}
    seen = {result.scene: outcome.scenes[result.scene].camera for result in outcome.results[told]}
    rows = [["camera", "scenes", *(header for *_, header in columns), "failures"]]
    others = [camera for camera in dict.fromkeys(seen.values()) if camera != CAMERA]
    for label, taking in [*((one, [one]) for one in (CAMERA, *others)), ("the others", others)]:
        own = {scene for scene, camera in seen.items() if camera in taking}
        if own:
            cells = [
                _median_worst([v for s, v in outcome.snr(name, method).items() if s in own])
                for name, method, _ in columns
            ]
            rows.append([label, str(len(own)), *cells, str(len(own & failed))])
    return rows


def balances(outcome: Outcome, experiments: tuple[str, ...]) -> Rows:
    """A row per way to balance white, a column per experiment: medians of colour error and SNR."""
    methods = list(dict.fromkeys(result.method for result in outcome.results[experiments[0]]))
    rows = [["white balance", *experiments]]
    for method in methods:
        cells = []
        for name in experiments:
            errors, values = outcome.errors(name, method), outcome.snr(name, method)
            colour, snr = (statistics.median(v.values()) if v else None for v in (errors, values))
            cells.append("–" if colour is None else f"{colour:.2f}° / {snr:.1f} dB")
        rows.append([method, *cells])
    return rows


def curves(
    outcome: Outcome,
    experiment: str,
    methods: tuple[str, ...],
    along: Callable[[Scene], float],
    header: str,
) -> Rows:
    """A row per value of a property of scenes, a column per method: median SNR in dB."""
    by_method = [outcome.curve(outcome.snr(experiment, method), along) for method in methods]
    places = sorted({at for curve in by_method for at in curve})
    rows = [[header, *methods]]
    for at in places:
        label = "∞" if math.isinf(at) else f"{at:g}"
        rows.append([label, *(_number(curve.get(at)) for curve in by_method)])
    return rows


def angle_errors(
    outcome: Outcome, experiment: str, methods: tuple[str, ...], along: Callable[[Scene], float]
) -> Rows:
    """As curves, of the coefficients' error in degrees."""
    by_method = [outcome.curve(outcome.errors(experiment, method), along) for method in methods]
    places = sorted({at for curve in by_method for at in curve})
    return [
        ["angle °", *(f"{method} °" for method in methods)],
        *(
            [f"{at:g}", *("" if at not in c else f"{c[at]:.2f}" for c in by_method)]
            for at in places
        ),
    ]


def confusions(results: list[Result]) -> Rows:
    """A row per number of lamps, a column per answer."""
    return [
        ["lamps", *_ANSWERS],
        *(
            [str(lamps), *(str(answers[answer]) for answer in _ANSWERS)]
            for lamps, answers in confusion(results).items()
        ),
    ]


def calibration(results: list[Result]) -> Rows:
    """A row per range of confidence: scenes, and how many of them are right."""
    rows = [["confidence", "scenes", "right", "share right"]]
    for low, high in pairwise(_CONFIDENCES):
        inside = [
            r
            for r in results
            if r.confidence is not None
            and low <= r.confidence
            and (r.confidence < high or high == 1.0)
        ]
        good = sum(right(r) for r in inside)
        share = f"{100 * good / len(inside):.0f} %" if inside else ""
        rows.append([f"{low:g} … {high:g}", str(len(inside)), str(good), share])
    return rows


def costs(outcome: Outcome, experiments: tuple[str, ...]) -> Rows:
    """A row per method: processor time in multiples of the cheapest, to 1, 2 or 5 times 10ⁿ."""
    rows = [["method", *experiments]]
    columns = []
    for name in experiments:
        seconds: dict[str, list[float]] = {}
        for result in outcome.results[name]:
            seconds.setdefault(result.method, []).append(result.cpu_s)
        columns.append({method: statistics.median(s) for method, s in seconds.items()})
    for method in columns[0]:
        cells = [
            f"{_one_two_five(column[method] / min(column.values())):g}" if method in column else ""
            for column in columns
        ]
        rows.append([method, *cells])
    return rows


def goal_rows(goals: list[Goal]) -> Rows:
    """A row per goal."""
    return [
        ["asked", "figure", "limit", "met"],
        *(
            [
                goal.text,
                f"{goal.figure:.{2 if goal.text.endswith('°') else 1}f}",
                f"{'≥' if goal.at_least else '≤'} {goal.limit:g}",
                "yes" if goal.met else "**no**",
            ]
            for goal in goals
        ),
    ]


def failure_rows(failures: list[Failure]) -> Rows:
    """A row per failure."""
    return [
        ["group", "scene", "failure"],
        *([one.experiment, one.scene, one.text] for one in failures),
    ]


def aligned(rows: Rows) -> str:
    """Text with columns under each other."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def markdown(rows: Rows) -> str:
    """A table in Markdown."""
    header, *body = ["| " + " | ".join(row) + " |" for row in rows]
    rule = "|" + "---|" * len(rows[0])
    return "\n".join([header, rule, *body])


def _median_worst(values: Collection[float]) -> str:
    return f"{statistics.median(values):.1f} / {min(values):.1f}" if values else "–"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def _one_two_five(ratio: float) -> float:
    decade = 10.0 ** math.floor(math.log10(ratio))
    return float(min((1, 2, 5, 10), key=lambda step: abs(math.log(ratio / decade / step))) * decade)
