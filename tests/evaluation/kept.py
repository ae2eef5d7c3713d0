"""Figures of cameras that are not at hand, as the report last had them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipeline.run_warnings import Code
from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.figures import Outcome
from tests.evaluation.results import Result
from tests.evaluation.scenes import CAMERA, Scene, scenes


def with_kept(outcome: Outcome, report: Path) -> Outcome:
    """Add to results of report scenes those that other cameras took and that were not measured.

    report: evaluation.json as it was last written; where it has none of a scene, none are added.
    """
    try:
        written = json.loads(report.read_text(encoding="utf-8"))["experiments"]
    except FileNotFoundError:
        return outcome
    results, known = dict(outcome.results), dict(outcome.scenes)
    for name, measured in outcome.results.items():
        own = {
            result.scene: [r for r in measured if r.scene == result.scene] for result in measured
        }
        before = written.get(name, {"results": {}})["results"]
        every = scenes(EXPERIMENTS[name].group, "report")
        for scene in every:
            if scene.camera != CAMERA and scene.name in before and scene.name not in own:
                own[scene.name] = _read(scene, before[scene.name])
                known[scene.name] = scene
        results[name] = [result for scene in every for result in own.get(scene.name, [])]
    return Outcome(results, known)


def _read(scene: Scene, figures: dict[str, Any]) -> list[Result]:
    """Results as report.py writes them; it writes neither warnings nor what they cost."""
    count = len(scene.lamp_spectra)

    def of(figure: str, method: str, otherwise: Any) -> Any:
        return figures.get(figure, {}).get(method, otherwise)

    return [
        Result(
            scene=scene.name,
            method=method,
            snr_db=snr,
            error_deg=of("coefficient_error_deg", method, None),
            lamps=count,
            found=of("found", method, count),
            confidence=of("confidence", method, None),
            warnings=({"code": Code.FOUR_OR_MORE},) if of("four_or_more", method, False) else (),
            refusal=of("refusal", method, ""),
            cpu_s=0.0,
        )
        for method, snr in figures["snr_db"].items()
    ]
