"""What a running service shows to those who run it: metrics, traces, and how it stops."""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from prometheus_client.parser import text_string_to_metric_families

import drivers
from tests.ports import free_port

Span = dict[str, Any]


class Receiver:
    """Takes traces in (OTLP over HTTP)."""

    def __init__(self) -> None:
        self.spans: list[Span] = []
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["content-length"]))
                receiver.take(self.path, body)
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_arguments: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def take(self, path: str, body: bytes) -> None:
        assert path == "/v1/traces"
        for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
            names = {item.key: item.value.string_value for item in resource.resource.attributes}
            for scope in resource.scope_spans:
                self.spans += [
                    {
                        "service": names["service.name"],
                        "name": span.name,
                        "trace": span.trace_id.hex(),
                        "id": span.span_id.hex(),
                        "parent": span.parent_span_id.hex(),
                        "text": str(span),
                    }
                    for span in scope.spans
                ]

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    yield receiver
    receiver.close()


def _figures(port: int) -> dict[str, float]:
    """What a process shows, by name and labels."""
    text = httpx.get(f"http://127.0.0.1:{port}/metrics", timeout=60).raise_for_status().text
    return {
        sample.name + "".join(f" {value}" for value in sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_a_job_is_in_the_metrics_and_one_trace(
    tmp_path: Path, receiver: Receiver, make_service: Any, small_pair: drivers.CapturedPair
) -> None:
    port = free_port(2)
    service = make_service(tmp_path, metrics_port=port)
    service.environment["OTEL_EXPORTER_OTLP_ENDPOINT"] = receiver.url
    service.start()
    trace, caller = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"
    answer = service.http.post(
        "/jobs",
        files={
            "no_flash": ("holiday1.dng", small_pair.no_flash.best),
            "flash": ("holiday2.dng", small_pair.flash.best),
        },
        data={"options": '{"lights": 2}'},
        headers={"traceparent": f"00-{trace}-{caller}-01"},
    )
    assert (answer.status_code, answer.headers["trace-id"]) == (202, trace)
    assert service.await_end(answer.json())["state"] == "succeeded"
    refused = service.http.get("/jobs/nothing")
    # The worker counts a job once it has written its end.
    service.await_that(
        "the job is counted",
        lambda: _figures(port + 1).get("lightlayers_jobs_finished_total succeeded"),
    )
    api, worker = _figures(port), _figures(port + 1)
    assert service.stop() == 0

    for figures in (api, worker):  # what the database says, all processes say
        assert figures["lightlayers_database_up"] == 1
        assert figures["lightlayers_workers"] == 1
        assert figures["lightlayers_jobs succeeded"] == 1
        assert figures["lightlayers_jobs queued"] == figures["lightlayers_queue_oldest_seconds"]
        assert figures["lightlayers_store_errors_total"] == 0
    assert api["lightlayers_jobs_accepted_total"] == 1
    assert worker["lightlayers_jobs_finished_total succeeded"] == 1
    assert worker["lightlayers_takeovers_total"] == 0
    stages = ("fetch", "decode", "align", "lamps", "layers", "encode", "store")
    assert [worker[f"lightlayers_stage_seconds_count {stage}"] for stage in stages] == [1] * 7

    [request] = [span for span in receiver.spans if span["name"] == "POST /jobs"]
    [attempt] = [span for span in receiver.spans if span["name"] == "attempt"]
    assert (request["service"], request["trace"], request["parent"]) == ("api", trace, caller)
    assert (attempt["service"], attempt["trace"]) == ("worker", trace)
    assert attempt["parent"] == request["id"]
    within = [span["name"] for span in receiver.spans if span["parent"] == attempt["id"]]
    assert within == list(stages)
    assert "holiday" not in "".join(span["text"] for span in receiver.spans)
    # A request without a caller's trace begins one, which its answer names.
    others = {span["trace"] for span in receiver.spans if span["name"] == "GET /jobs/{job_id}"}
    assert refused.headers["trace-id"] in others


def test_a_service_that_is_told_to_stop_says_so_and_finishes_its_uploads(
    tmp_path: Path, make_service: Any, small_pair: drivers.CapturedPair
) -> None:
    service = make_service(tmp_path, drain_seconds=60)  # stop() ends it
    service.start()
    halfway, stopping = threading.Event(), threading.Event()
    request = service.http.build_request(
        "POST",
        "/jobs",
        files={"no_flash": small_pair.no_flash.best, "flash": small_pair.flash.best},
        data={"options": '{"lights": 2}'},
    )
    body = request.read()

    def slowly() -> Iterator[bytes]:
        yield body[: len(body) // 2]
        halfway.set()
        assert stopping.wait(60)
        yield body[len(body) // 2 :]

    headers = {"content-type": request.headers["content-type"]}
    with ThreadPoolExecutor(1) as pool:
        upload = pool.submit(service.http.post, "/jobs", content=slowly(), headers=headers)
        assert halfway.wait(60)
        service.terminate()
        refusal = service.await_unready()
        assert (refusal["type"], refusal["status"]) == (
            "urn:lightlayers:problem:service-not-ready",
            503,
        )
        assert "it was told to stop" in refusal["detail"]
        stopping.set()
        assert upload.result().status_code == 202
    # it goes on until it is told again
    assert service.await_end(upload.result().json())["state"] == "succeeded"
    assert service.stop() == 0
    told = [json.loads(line)["message"] for line in service.log.read_text().splitlines()]
    assert "draining" in told
    with sqlite3.connect(service.data / "lightlayers.sqlite") as database:
        rows = database.execute("SELECT id, state FROM jobs").fetchall()
    database.close()
    assert rows == [(upload.result().json()["id"], "succeeded")]
