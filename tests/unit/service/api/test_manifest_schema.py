"""What openapi.json says of manifests is held against real ones, field by field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema_rs import validator_for

import drivers
from pipeline import Options, Progress, separate_files
from pipeline.calibration.calibrate import calibrate_files
from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.mixes.mix_files import mix_results
from pipeline.mixes.mix_options import LampMix, MixRequest
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.tone_curve import ToneCurve
from pipeline.photometric_stereo.facing import CONVENTIONS
from pipeline.result_names import MANIFEST
from service.api.manifest_schema import SCHEMAS

Manifest = dict[str, Any]


def _taken(address: str) -> tuple[bytes, bytes]:
    with drivers.open_camera(address) as camera:
        pair = drivers.capture_pair(camera)
    return pair.no_flash.best, pair.flash.best


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where that separation's files are."""
    return tmp_path_factory.mktemp("all")


@pytest.fixture(scope="module")
def separation(folder: Path) -> Manifest:
    """Of a pair with all outputs."""
    options = Options(lights=2, outputs="all", quality="fast")
    pair = _taken("sim://studio?lights=2&width=96&height=64")
    return separate_files(*pair, options, folder, Progress())


_VALIDATOR = validator_for(
    {"$ref": "#/components/schemas/Manifest", "components": {"schemas": SCHEMAS}}
)


def _unknown(value: Any, schema: Manifest, place: str = "") -> list[str]:
    """Places of fields that a schema does not name."""
    schema = SCHEMAS[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    if isinstance(value, list):
        return [one for item in value for one in _unknown(item, schema["items"], f"{place}[]")]
    schema = next((one for one in schema.get("anyOf", []) if "properties" in one), schema)
    if not isinstance(value, dict) or "properties" not in schema:
        return []
    found = [f"{place}.{name}" for name in value.keys() - schema["properties"].keys()]
    for name in value.keys() & schema["properties"].keys():
        found += _unknown(value[name], schema["properties"][name], f"{place}.{name}")
    return found


def check(manifest: Manifest) -> None:
    told = json.loads(json.dumps(manifest))
    _VALIDATOR.validate(told)
    assert _unknown(told, SCHEMAS["Manifest"]) == []


def test_every_field_of_a_separation_is_told(separation: Manifest) -> None:
    assert {"calibrations", "mix", "exposure_ratio"} <= separation.keys()
    check(separation)


def test_what_few_pairs_have_is_told(separation: Manifest) -> None:
    curve, balance = ToneCurve(np.linspace(-1.0, 0.0, 11)), BalanceChange(1.1, 0.9)
    taken_off = {"tone_curve": curve.entry(), "balance_change": balance.entry()}
    normals = {"convention": CONVENTIONS["gl"], "strengths": [1.0, 0.877]}
    check({**separation, **taken_off, "normals": normals})


@pytest.mark.usefixtures("separation")
def test_every_field_of_a_mix_is_told(folder: Path, tmp_path: Path) -> None:
    mix_results(folder, MixRequest(lamps=[LampMix(ev=1.0), LampMix()]), tmp_path, Progress())
    manifest = json.loads((tmp_path / MANIFEST).read_text())
    assert manifest["mix"]["lamps"][0]["ev"] == 1.0
    check(manifest)


def test_every_field_of_a_calibration_is_told(tmp_path: Path) -> None:
    options = CALIBRATION_OPTIONS.validate_python(
        {"kind": "flash", "card": {"x": 132, "y": 78, "radius": 12}}
    )
    pair = _taken("sim://studio?scene=card&width=240&height=160")
    manifest = calibrate_files(*pair, options, tmp_path, Progress())
    assert {"found", "taken_with"} <= manifest.keys()
    check(manifest)


@pytest.mark.parametrize(
    "wrong",
    [
        {"exposure_source": "guessed"},
        {"filled": 1.5},
        {"lamps": [{"name": "lamp1"}]},
        {"warnings": [{"code": "unheard_of", "message": "", "figures": {}}]},
    ],
)
def test_what_no_manifest_says_is_refused(separation: Manifest, wrong: Manifest) -> None:
    assert not _VALIDATOR.is_valid({**separation, **wrong})
