from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from service.openapi import document

STORED = Path(__file__).parents[3] / "openapi.json"


@pytest.fixture(scope="module")
def paths() -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = json.loads(document())["paths"]
    return found


def test_the_stored_document_is_the_apps() -> None:
    assert STORED.read_text() == document(), "make openapi writes it anew"


def test_the_routes_are_the_contract(paths: dict[str, dict[str, Any]]) -> None:
    assert {
        f"{method.upper()} {path}" for path, methods in paths.items() for method in methods
    } == {
        "POST /jobs",
        "GET /calibrations",
        "POST /calibrations",
        "GET /jobs",
        "GET /jobs/{job_id}",
        "GET /jobs/{job_id}/events",
        "POST /jobs/{job_id}/cancel",
        "POST /jobs/{job_id}/rerun",
        "DELETE /jobs/{job_id}",
        "POST /jobs/{job_id}/mix",
        "GET /jobs/{job_id}/results",
        "GET /jobs/{job_id}/results/{name}",
        "GET /jobs/{job_id}/results.zip",
        "OPTIONS /uploads",
        "POST /uploads",
        "HEAD /uploads/{upload_id}",
        "PATCH /uploads/{upload_id}",
        "DELETE /uploads/{upload_id}",
        "GET /cameras",
        "GET /healthz",
        "GET /readyz",
    }


def test_every_error_is_a_problem(paths: dict[str, dict[str, Any]]) -> None:
    for methods in paths.values():
        for operation in methods.values():
            for status, response in operation["responses"].items():
                if int(status) >= 400:
                    assert list(response["content"]) == ["application/problem+json"]


def test_ways_to_hand_in_a_pair_are_described(paths: dict[str, dict[str, Any]]) -> None:
    content = paths["/jobs"]["post"]["requestBody"]["content"]
    pair = content["multipart/form-data"]["schema"]
    assert pair["required"] == ["no_flash", "flash"]
    assert set(pair["properties"]) == {"no_flash", "flash", "options", "handling"}
    models = [
        one["$ref"].rpartition("/")[2] for one in content["application/json"]["schema"]["oneOf"]
    ]
    assert models == ["CaptureRequest", "UploadsRequest"]
    calibration = paths["/calibrations"]["post"]["requestBody"]["content"]["application/json"]
    assert calibration["schema"]["oneOf"][1]["$ref"].endswith("/CalibrationRequest")


def test_every_reference_leads_somewhere() -> None:
    whole = json.loads(document())
    schemas = whole["components"]["schemas"]

    def references(part: Any) -> set[str]:
        if isinstance(part, dict):
            own = {part["$ref"]} if isinstance(part.get("$ref"), str) else set()
            return own.union(*map(references, part.values()))
        return set().union(*map(references, part)) if isinstance(part, list) else set()

    found = {reference.removeprefix("#/components/schemas/") for reference in references(whole)}
    assert found - set(schemas) == set()
    assert {
        "Options",
        "Problem",
        "CaptureRequest",
        "UploadedPair",
        "JobAnswer",
        "Spectrum",
    } <= found
