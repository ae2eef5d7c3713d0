"""Writes docs/evaluation.md, docs/evaluation.json and the plots."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tests.evaluation import tables
from tests.evaluation.experiments import ALL, BASES, EXPERIMENTS, FEW, OF_CONTRASTS
from tests.evaluation.figures import Outcome, angle, depth, four_or_more, roughness
from tests.evaluation.goals import Failure, failures, goals
from tests.evaluation.kept import with_kept
from tests.evaluation.plots import LOWEST_DB, draw_plots
from tests.evaluation.results import Result
from tests.evaluation.scenes import Scene
from tests.evaluation.white_balance import BALANCES

_HEAD = Path(__file__).with_name("report_head.md")
_DECIMALS = 2
_CLEAN = ("two", "three", "broad-two", "broad-three", "smooth-two", "smooth-three")
_WHITE = tuple(name for name in EXPERIMENTS if name.startswith("white-"))
_SWEEPS = ("angle", "bounces", "roughness")


def write_report(outcome: Outcome, docs: Path) -> None:
    """Write everything into the folder of the documentation; all experiments are needed.

    Cameras that were not at hand keep the figures that the folder's report has of them.
    """
    outcome = with_kept(outcome, docs / "evaluation.json")
    draw_plots(outcome, docs / "images")
    (docs / "evaluation.md").write_text(_text(outcome), encoding="utf-8")
    values = json.dumps(_values(outcome), indent=1, ensure_ascii=False, allow_nan=False)
    (docs / "evaluation.json").write_text(values + "\n", encoding="utf-8")


def _values(outcome: Outcome) -> dict[str, Any]:
    return {
        "goals": [
            {**asdict(goal), "figure": round(goal.figure, _DECIMALS), "met": goal.met}
            for goal in goals(outcome)
        ],
        "scenes": {name: _scene(scene) for name, scene in sorted(outcome.scenes.items())},
        "experiments": {
            name: {
                "group": EXPERIMENTS[name].group,
                "condition": asdict(EXPERIMENTS[name].condition),
                "results": _by_scene(results),
            }
            for name, results in outcome.results.items()
        },
    }


def _scene(scene: Scene) -> dict[str, Any]:
    return {"lamps": list(scene.lamp_names), "angle_deg": round(scene.angle_deg, _DECIMALS)}


def _by_scene(results: list[Result]) -> dict[str, Any]:
    """Every figure of every method, by scene; what a method does not tell is left out."""
    scenes: dict[str, dict[str, dict[str, Any]]] = {}
    for result in results:
        balances = result.method in BALANCES
        error = "colour_error_deg" if balances else "coefficient_error_deg"
        figures = {
            "snr_db": _rounded(result.snr_db),
            error: _rounded(result.error_deg),
            "found": result.found if result.found != result.lamps else None,
            "confidence": result.confidence if result.confidence != 1.0 else None,
            "four_or_more": four_or_more(result) or None,
            "refusal": result.refusal or None,
        }
        scene = scenes.setdefault(result.scene, {})
        for name, value in figures.items():
            if value is not None:
                scene.setdefault(name, {})[result.method] = value
    return scenes


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, _DECIMALS)


def _text(outcome: Outcome) -> str:
    clean, noisy = outcome.counted("-auto"), outcome.counted("-auto-noise")
    short = failures(outcome)
    compared = [
        name
        for name in outcome.results
        if name not in (*_CLEAN, *_SWEEPS) and EXPERIMENTS[name].methods == FEW
    ]
    contrasts = [name for name in outcome.results if EXPERIMENTS[name].condition.contrast != "none"]
    parts = [
        _HEAD.read_text(encoding="utf-8").rstrip(),
        "## What is asked of `best`",
        tables.markdown(tables.goal_rows(goals(outcome))),
        "## Layers\n\nMedian / worst joint SNR in dB.",
        tables.markdown(tables.compared(outcome, _CLEAN, ALL)),
        "The same under other conditions, and over all scenes of the curves below.",
        tables.markdown(tables.compared(outcome, [*_SWEEPS, *compared], FEW)),
        "JPEGs to which the camera gave a contrast of its own. The truth has one scale for all "
        "light, the photograph's: no file tells how bright light is that a contrast has flattened.",
        tables.markdown(tables.compared(outcome, contrasts, OF_CONTRASTS)),
        "## Other cameras\n\nMedian / worst joint SNR in dB of the same rooms by every camera: "
        "told it, untold, and from its JPEG. Failures: of how many rooms one is listed below.",
        *_cameras(outcome, short),
        "## Bases (figure 2)\n\nThe published method with each of its bases, on two lamps.",
        tables.markdown(tables.compared(outcome, ["two"], (*BASES, "paper"))),
        _picture(
            "bases",
            f"Joint SNR of every scene with two lamps, for three bases, not below {LOWEST_DB:g} dB",
        ),
        "## Angle between two lamps (figure 4)\n\nMedian joint SNR in dB, files without noise.",
        tables.markdown(tables.curves(outcome, "angle", FEW, angle, "angle °")),
        "Median error of the lamps' coefficients, files without noise:",
        tables.markdown(tables.angle_errors(outcome, "angle", ("paper", "best"), angle)),
        _picture("angle", "Joint SNR and coefficient error against the angle between lamps"),
        "## Three lamps (figure 9)",
        _picture("three", "Joint SNR of every scene with three lamps"),
        "## Bounces of light (figure 15)\n\nMedian joint SNR in dB; 2 segments are direct light.",
        tables.markdown(tables.curves(outcome, "bounces", FEW, depth, "longest path")),
        _picture("bounces", "Joint SNR against the longest path of light"),
        "## Roughness (figure 16)\n\nMedian joint SNR in dB, plastic things.",
        tables.markdown(tables.curves(outcome, "roughness", FEW, roughness, "α")),
        _picture("roughness", "Joint SNR against roughness"),
        "## Noise and exposure",
        _picture("noise", "Joint SNR against exposure, two and three lamps"),
        "## White balance\n\nMedian error of colour / median SNR after one scale for the whole "
        "picture, against the scene rendered with every lamp shining like D65.",
        tables.markdown(tables.balances(outcome, _WHITE)),
        "## Number of lamps\n\nRows: how many there are. Columns: what `--lights auto` says.",
        tables.markdown(tables.confusions(clean)),
        "With sensor noise:",
        tables.markdown(tables.confusions(noisy)),
        "How often the number is right, by the confidence given, without noise and with it:",
        tables.markdown(tables.calibration([*clean, *noisy])),
        "## Cost\n\nProcessor time in multiples of the cheapest method, files at 256 × 192.",
        tables.markdown(tables.costs(outcome, ("two", "three"))),
        "## Failures\n\nScenes where `best` is more than 0.5 dB below the published method, below "
        "what is asked of every scene of its kind, refuses, or miscounts.",
        tables.markdown(tables.failure_rows(short)),
    ]
    return "\n\n".join(parts) + "\n"


def _cameras(outcome: Outcome, failures: list[Failure]) -> list[str]:
    parts = []
    for lamps in ("two", "three"):
        rows = tables.cameras(outcome, lamps, failures)
        if len(rows) > 2:  # there is another camera than the usual one
            parts += [f"{lamps.capitalize()} lamps:", tables.markdown(rows)]
    return parts


def _picture(name: str, caption: str) -> str:
    return f"![{caption}](images/evaluation_{name}.png)"
