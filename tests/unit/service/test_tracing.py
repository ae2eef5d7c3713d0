"""What is done where no traces are made; those that are: tests/integration/service."""

from __future__ import annotations

import pytest
from opentelemetry import trace

from service import tracing

TRACE, SPAN = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"


@pytest.mark.parametrize(
    ("header", "found"),
    [
        (f"00-{TRACE}-{SPAN}-01", TRACE),
        (f"00-{TRACE}-{SPAN}-00", TRACE),  # not recorded elsewhere, and the same request
        (f"00-{'0' * 32}-{SPAN}-01", None),
        (f"00-{TRACE}-{'0' * 16}-01", None),
        (f"ff-{TRACE}-{SPAN}-01", None),
        (f"00-{TRACE[:-1]}-{SPAN}-01", None),
        ("00-xyz-1-01", None),
        ("", None),
    ],
)
def test_the_trace_is_that_of_the_header(header: str, found: str | None) -> None:
    assert tracing.trace_id(header) == found


def _here() -> tuple[str, str]:
    place = trace.get_current_span().get_span_context()
    return trace.format_trace_id(place.trace_id), trace.format_span_id(place.span_id)


@pytest.mark.parametrize(
    ("trace_id", "span_id", "parent"),
    [
        (TRACE, SPAN, SPAN),
        (TRACE, None, TRACE[:16]),
        ("0" * 16 + TRACE[16:], None, f"{1:016x}"),  # no span is called 0
    ],
)
def test_an_attempt_goes_on_with_the_trace_of_its_request(
    trace_id: str, span_id: str | None, parent: str
) -> None:
    with tracing.attempt(trace_id, span_id, {"job": "a"}):
        assert _here() == (trace_id, parent)
        tracing.note("outcome", "succeeded")
        tracing.begin("layers").end()
        assert tracing.span_id() is None
    assert _here() == ("0" * 32, "0" * 16)


def test_without_an_endpoint_nothing_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT"):
        monkeypatch.setenv(name, "")  # as compose writes what is not set
    monkeypatch.setattr(trace, "set_tracer_provider", pytest.fail)
    tracing.configure("api")
    tracing.flush()
