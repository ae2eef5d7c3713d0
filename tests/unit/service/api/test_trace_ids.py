from __future__ import annotations

import httpx


def test_a_trace_id_of_the_caller_is_kept(http: httpx.Client) -> None:
    trace = "0af7651916cd43dd8448eb211c80319c"
    headers = {"traceparent": f"00-{trace}-b7ad6b7169203331-01"}
    answer = http.get("/jobs/nothing", headers=headers)
    assert answer.json()["trace_id"] == trace == answer.headers["trace-id"]
    broken = http.get("/jobs/nothing", headers={"traceparent": "00-xyz-1-01"})
    assert broken.json()["trace_id"] not in ("xyz", trace)
    assert len(broken.json()["trace_id"]) == 32
