"""Traces (OpenTelemetry): one from the request through the attempts at its job and their stages.

Made only where OTEL_EXPORTER_OTLP_ENDPOINT says who gets them; its variables say the rest. A span
names methods, routes, stages and ids, never a file, a key or a body.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from opentelemetry import context as current
from opentelemetry import trace
from opentelemetry.trace import NonRecordingSpan, Span, SpanContext, SpanKind, TraceFlags
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

_ENDPOINTS = ("OTEL_EXPORTER_OTLP_ENDPOINT", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT")
_FLUSH_SECONDS = 2.0

_tracer = trace.get_tracer("lightlayers")
_NOWHERE = current.Context()
_w3c = TraceContextTextMapPropagator()


def configure(service: str) -> None:
    """Send the traces of this process, as those of a service, to the endpoint if one is set."""
    if not any(os.environ.get(name) for name in _ENDPOINTS):
        return
    # Imported only where it is used, so that all else starts as quickly as before.
    from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
    from opentelemetry.sdk.resources import Resource
    from opentelemetry.sdk.trace import TracerProvider
    from opentelemetry.sdk.trace.export import BatchSpanProcessor

    resource = Resource.create({"service.name": service, "service.namespace": "lightlayers"})
    provider = TracerProvider(resource=resource)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)


def flush() -> None:
    """Send what has not been sent yet, for a process that ends without its exit handlers."""
    provider = trace.get_tracer_provider()
    send = getattr(provider, "force_flush", None)  # which only the SDK's provider has
    if send is not None:
        send(int(_FLUSH_SECONDS * 1000))


def trace_id(traceparent: str) -> str | None:
    """Tell the trace we are in, else the one that W3C's header names; None for neither."""
    here = trace.get_current_span()
    if not here.is_recording():
        here = trace.get_current_span(_w3c.extract({"traceparent": traceparent}, _NOWHERE))
    place = here.get_span_context()
    return trace.format_trace_id(place.trace_id) if place.is_valid else None


def span_id() -> str | None:
    """Tell the span we are in; None where no traces are made."""
    here = trace.get_current_span()
    return trace.format_span_id(here.get_span_context().span_id) if here.is_recording() else None


@contextmanager
def attempt(trace_id: str, span_id: str | None, attributes: Mapping[str, Any]) -> Iterator[None]:
    """Trace an attempt at the job that a request made; span_id: of the request, if it is known."""
    request_span = SpanContext(
        int(trace_id, 16),
        int(span_id or trace_id[:16], 16) or 1,  # else the trace begins with a span nobody knows
        is_remote=True,
        trace_flags=TraceFlags(TraceFlags.SAMPLED),
    )
    where = trace.set_span_in_context(NonRecordingSpan(request_span), _NOWHERE)
    with _tracer.start_as_current_span(
        "attempt", where, SpanKind.CONSUMER, attributes, record_exception=False
    ):
        yield


def note(name: str, value: str) -> None:
    """Write something to the span we are in."""
    trace.get_current_span().set_attribute(name, value)


def begin(name: str) -> Span:
    """Begin a span within the one we are in; the caller ends it."""
    return _tracer.start_span(name)
