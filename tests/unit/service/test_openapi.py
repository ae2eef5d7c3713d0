from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from jsonschema_rs import validator_for

from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.options import Options
from service.api import examples
from service.api.models import (
    CalibrationRequest,
    CaptureRequest,
    Handling,
    MixJob,
    RerunRequest,
    UploadsRequest,
)
from service.openapi import document

STORED = Path(__file__).parents[3] / "openapi.json"


@pytest.fixture(scope="module")
def whole() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(document())
    return found


@pytest.fixture(scope="module")
def paths(whole: dict[str, Any]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = whole["paths"]
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
        "GET /jobs/{job_id}/area",
        "OPTIONS /uploads",
        "POST /uploads",
        "HEAD /uploads/{upload_id}",
        "PATCH /uploads/{upload_id}",
        "DELETE /uploads/{upload_id}",
        "POST /jobs/{job_id}/confirm",
        "GET /cameras",
        "GET /cameras/events",
        "GET /cameras/{camera_id}/settings",
        "PATCH /cameras/{camera_id}/settings",
        "POST /cameras/{camera_id}/captures",
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


def test_every_reference_leads_somewhere(whole: dict[str, Any]) -> None:
    schemas, problems = (whole["components"][part] for part in ("schemas", "examples"))

    def references(part: Any) -> set[str]:
        if isinstance(part, dict):
            own = {part["$ref"]} if isinstance(part.get("$ref"), str) else set()
            return own.union(*map(references, part.values()))
        return set().union(*map(references, part)) if isinstance(part, list) else set()

    all_of_them = {reference.removeprefix("#/components/") for reference in references(whole)}
    assert {one.partition("/")[0] for one in all_of_them} == {"schemas", "examples"}
    found = {one.removeprefix("schemas/") for one in all_of_them if one.startswith("schemas/")}
    assert found - set(schemas) == set()
    assert all_of_them <= {f"schemas/{one}" for one in found} | {
        f"examples/{name}" for name in problems
    }
    assert {
        "Options",
        "Problem",
        "CaptureRequest",
        "UploadedPair",
        "JobAnswer",
        "Spectrum",
    } <= found


def _media(paths: dict[str, dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every body of a request or an answer that is no bare file, and where it is."""
    for path, operations in paths.items():
        for method, operation in operations.items():
            bodies = {"": operation.get("requestBody", {}), **operation["responses"]}
            for status, body in bodies.items():
                for media_type, media in body.get("content", {}).items():
                    if media["schema"].get("format") != "binary":
                        yield f"{method} {path} {status} {media_type}", media


def _examples(components: dict[str, Any], media: dict[str, Any]) -> list[Any]:
    if "examples" in media:
        return [components["examples"][name]["value"] for name in media["examples"]]
    if "example" in media:
        return [media["example"]]
    schema = media["schema"]
    if schema.get("type") == "array":
        return [_examples(components, {"schema": schema["items"]})]
    names = [one["$ref"].rpartition("/")[2] for one in schema.get("oneOf", [schema])]
    return [
        example for name in names for example in components["schemas"][name].get("examples", [])
    ]


def test_every_body_has_an_example_that_fits(whole: dict[str, Any]) -> None:
    seen = 0
    for where, media in _media(whole["paths"]):
        found = _examples(whole["components"], media)
        assert found and found != [[]], where
        validator = validator_for({**media["schema"], "components": whole["components"]})
        for example in found:
            assert list(map(str, validator.iter_errors(example))) == [], where
        seen += 1
    assert seen > 150


def test_every_parameter_has_an_example(paths: dict[str, dict[str, Any]]) -> None:
    parameters = [
        (path, parameter)
        for path, operations in paths.items()
        for operation in operations.values()
        for parameter in operation.get("parameters", [])
    ]
    assert [(path, one["name"]) for path, one in parameters if "example" not in one] == []
    for path, one in parameters:
        assert validator_for(one["schema"]).is_valid(one["example"]), (path, one["name"])


def test_what_uploads_are_refused_without_is_required(paths: dict[str, dict[str, Any]]) -> None:
    """By 412, so that it is none of the parameters that the routes themselves require."""
    told = [
        (method, path, parameter["required"], parameter["schema"])
        for path, operations in paths.items()
        for method, operation in operations.items()
        for parameter in operation.get("parameters", [])
        if parameter["name"] == "tus-resumable"
    ]
    # a word that is constant is nothing that every generator of clients takes for a header
    version = {"type": "string", "enum": ["1.0.0"]}
    one = "/uploads/{upload_id}"
    assert sorted(told, key=lambda of: of[:2]) == [
        ("delete", one, True, version),
        ("head", one, True, version),
        ("patch", one, True, version),
        ("post", "/uploads", True, version),
    ]


def test_examples_of_requests_are_taken(paths: dict[str, dict[str, Any]]) -> None:
    """By the models themselves, which know more than their schemas."""
    models = (CaptureRequest, UploadsRequest, CalibrationRequest, MixJob, RerunRequest, Handling)
    for model in models:
        for example in examples.SCHEMAS[model.__name__]:
            assert model.model_validate(example)
    job, calibration = (
        paths[path]["post"]["requestBody"]["content"]["multipart/form-data"]["example"]
        for path in ("/jobs", "/calibrations")
    )
    assert Options.model_validate_json(job["options"]).lights == 2
    assert CALIBRATION_OPTIONS.validate_json(calibration["options"]).kind == "flash"
    for form in (job, calibration):
        assert Handling.model_validate_json(form["handling"]).priority == "high"


def test_errors_of_a_route_are_told_by_name(paths: dict[str, dict[str, Any]]) -> None:
    def kinds(path: str, method: str, status: str) -> set[str]:
        content = paths[path][method]["responses"][status]["content"]
        return set(content["application/problem+json"]["examples"])

    assert kinds("/jobs/{job_id}", "get", "404") == {"unknown-job"}
    assert kinds("/jobs/{job_id}/results/{name}", "get", "404") == {"unknown-job", "unknown-result"}
    assert kinds("/jobs", "post", "429") == {"queue-full", "quota-exceeded"}
    assert kinds("/jobs", "post", "413") == {"image-too-large", "upload-too-large"}
    assert kinds("/jobs", "post", "403") == {
        "forbidden",
        "foreign-camera",
        "foreign-origin",
        "stored-quota",
    }
    assert "500" not in paths["/jobs"]["post"]["responses"]
    assert "camera-held" in kinds("/jobs", "post", "409")
    for status in ("403", "404", "409", "422"):
        assert kinds("/calibrations", "post", status) == kinds("/jobs", "post", status)
    of_pairs = {"pair-mismatch", "unreadable-image", "unusable-pair"}
    assert of_pairs <= kinds("/jobs", "post", "422")
    assert "upload-unfinished" in kinds("/jobs", "post", "409")
    for path in ("/jobs/{job_id}/mix", "/jobs/{job_id}/rerun", "/cameras/{camera_id}/captures"):
        assert kinds(path, "post", "413") == {"upload-too-large"}, path
        assert "upload-unfinished" not in kinds(path, "post", "409"), path
        assert kinds(path, "post", "422").isdisjoint(of_pairs), path
