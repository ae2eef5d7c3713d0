"""Requests that the OpenAPI document allows and forbids, made up by schemathesis."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tests.integration.service.real_service import Service

_CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "unsupported_method",
)
_SEED = "1"


def test_answers_are_those_of_the_document(
    make_service: Callable[..., Service], tmp_path: Path
) -> None:
    # No camera takes pictures here: jobs of hundreds of requests would keep the machine busy.
    service = make_service(tmp_path / "service", keys="required", cameras="sim://none")
    key = service.make_key("schemathesis", "--scopes", "submit,read,capture")
    service.start()

    command = [
        str(Path(sys.executable).with_name("schemathesis")),
        "run",
        f"{service.url}/openapi.json",
        f"--header=Authorization: Bearer {key}",
        f"--checks={','.join(_CHECKS)}",
        "--phases=fuzzing",
        "--exclude-path=/jobs/{job_id}/events",  # a stream, which ends with the job
        "--exclude-path=/cameras/events",  # another, which does not end
        "--max-examples=10",
        "--request-timeout=120",
        "--suppress-health-check=all",  # that examples are slow to make
        f"--seed={_SEED}",
        "--continue-on-failure",
    ]
    environment = {
        **service.environment,
        "SCHEMATHESIS_HOOKS": "tests.integration.service.schemathesis_hooks",
        "PYTHONPATH": str(Path(__file__).parents[3]),
    }
    run = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)

    assert run.returncode == 0, run.stdout[-6000:]
    made = re.search(r"(\d+) generated", run.stdout)
    assert made and int(made[1]) > 150
    assert service.processes()
