"""What came of one method on one scene, kept between runs so that an interrupted one goes on."""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from dataclasses import asdict, astuple, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import pipeline
from pipeline.errors import InputError
from tests import layers
from tests.definitions import pixels
from tests.evaluation.cache import folder
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.methods import METHODS, Answer
from tests.evaluation.render import VERSION
from tests.evaluation.scenes import Scene, render_neutral
from tests.evaluation.scoring import balance_score, coefficient_error_deg, joint_snr
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import sensitivities
from tests.evaluation.white_balance import BALANCES

_EXACT_DB = 100.0
_NO_COLOUR_DEG = 90.0
_ESTIMATOR = (
    "doubts.py",
    "estimate.py",
    "lamps/contradictions.py",
    "lamps/count.py",
    "lamps/known_lamps.py",
    "lamps/lamps.py",
    "lamps/shining.py",
    "light/families.py",
    "light/model.py",
    "light/prior.py",
    "matrixfit",
    "photometric_stereo/normals.py",
    "pictures/white_balance.py",
    "process.py",
    "results",
    "separation/changed_lamps.py",
    "separation/find_highlights.py",
    "separation/highlights.py",
    "separation/mirrored_light.py",
    "separation/separation.py",
    "separation/smoothing.py",
)
"""What of the pipeline the methods that are not the product do not use."""
_OWN = (
    "cache",
    "capture",
    "ceilings",
    "conditions",
    "layouts",
    "methods",
    "product",
    "results",
    "scenes",
    "scoring",
    "shake",
    "shots",
    "spectra",
    "transport",
    "white_balance",
)
"""What of the evaluation decides a figure, besides render, which VERSION stands for."""
_WITHOUT_PRODUCT = (
    "equal",
    "nnmf",
    "von_kries",
    "known",
    "best_3x3",
    "tuned_3x3",
    "uncorrected",
    "grey_world",
    "shades_of_grey",
    "hsu_2008",
    "hui_2016",
)


@dataclass(frozen=True)
class Result:
    """One method on one scene.

    snr_db: joint SNR of the layers or SNR of the balanced picture, 100 and more as 100; None where
    the number of layers is not that of the lamps. A refusal gives no light, which is 0 dB.
    error_deg: of the lamps' coefficients or of the picture's colours, None where none are told.
    lamps, found: how many there are, how many were found. confidence: in that number. warnings: of
    the manifest. refusal: the message, "" where there is a result. cpu_s: seconds of processor
    time.
    """

    scene: str
    method: str
    snr_db: float | None
    error_deg: float | None
    lamps: int
    found: int
    confidence: float | None
    warnings: tuple[dict[str, Any], ...]
    refusal: str
    cpu_s: float


def run_scene(scene: Scene, condition: Condition, methods: tuple[str, ...]) -> list[Result]:
    """Results of the methods on a scene under a condition, from the cache where they are there."""
    results = []
    shot: Shot | None = None
    for method in methods:
        path = folder() / "results" / f"{_key(scene, condition, method)}.json"
        known = _read(path)
        if known is None:
            shot = shot or make_shot(scene, condition)
            # a copy, which has cached nothing yet
            known = _run(scene, condition, replace(shot), method)
            _write(path, known)
        results.append(known)
    return results


def _run(scene: Scene, condition: Condition, shot: Shot, method: str) -> Result:
    start = time.process_time()
    try:
        made = BALANCES[method](shot) if method in BALANCES else METHODS[method](shot)
    except InputError as refusal:
        spent = time.process_time() - start
        error = _NO_COLOUR_DEG if method in BALANCES else None
        return Result(scene.name, method, 0.0, error, shot.count, 0, None, (), str(refusal), spent)
    spent = time.process_time() - start
    if isinstance(made, Answer):
        return _of_layers(scene.name, method, shot, made, spent)
    snr, error = balance_score(render_neutral(scene, condition.size), made, shot.valid)
    snr = min(snr, _EXACT_DB)
    return Result(scene.name, method, snr, error, shot.count, shot.count, None, (), "", spent)


def _of_layers(name: str, method: str, shot: Shot, answer: Answer, spent: float) -> Result:
    found = len(answer.layers)
    snr, error = None, None
    if found == shot.count:
        snr, order = joint_snr(shot.truth, answer.layers, shot.valid)
        snr = min(snr, _EXACT_DB)
        if answer.coefficients is not None and shot.coefficients is not None:
            found_there = answer.coefficients @ shot.axes.T
            whites = shot.lamp_spectra @ shot.sensitivities.T @ shot.axes.T
            there = whites if answer.of_white else shot.coefficients
            error = coefficient_error_deg(there, found_there, order)
    return Result(
        scene=name,
        method=method,
        snr_db=snr,
        error_deg=error,
        lamps=shot.count,
        found=found,
        confidence=answer.confidence,
        warnings=answer.warnings,
        refusal="",
        cpu_s=spent,
    )


def _read(path: Path) -> Result | None:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        return Result(**values | {"warnings": tuple(values["warnings"])})
    except (OSError, ValueError, TypeError, KeyError):  # missing, cut short or of another version
        return None


def _write(path: Path, result: Result) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".tmp", delete=False) as file:
        file.write(json.dumps(asdict(result)).encode())
    Path(file.name).replace(path)  # whole or not at all, also when two runs write at once


def _key(scene: Scene, condition: Condition, method: str) -> str:
    digest = hashlib.sha256(
        repr((scene.name, VERSION, scene.geometry, scene.strengths, method)).encode()
    )
    digest.update(repr((scene.camera, scene.flash, astuple(condition))).encode())
    for array in (scene.palette, scene.lamp_spectra, sensitivities(scene.camera)):
        digest.update(np.ascontiguousarray(array).tobytes())
    unused = _ESTIMATOR if method in _WITHOUT_PRODUCT else ()
    digest.update(_sources(unused).encode())
    return digest.hexdigest()[:32]


@cache
def _sources(unused: tuple[str, ...]) -> str:
    """Digest of the pipeline without the named parts, and of what measures it."""
    digest = hashlib.sha256()
    for file in _files(unused):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def _files(unused: tuple[str, ...]) -> list[Path]:
    assert pipeline.__file__
    root, own = Path(pipeline.__file__).parent, Path(__file__)
    files = sorted([*root.rglob("*.py"), *root.rglob("*.csv")])
    files = [file for file in files if not _within(file.relative_to(root), unused)]
    files += [own.with_name(f"{name}.py") for name in _OWN]
    files += sorted(own.with_name("baselines").glob("[!t]*.py"))  # and not their tests
    return [*files, Path(pixels.__file__), Path(layers.__file__)]


def _within(file: Path, unused: tuple[str, ...]) -> bool:
    """Whether a file, or a folder that it is in, is among those named."""
    return any(place.as_posix() in unused for place in (file, *file.parents))
