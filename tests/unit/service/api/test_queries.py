from __future__ import annotations

import httpx
import pytest

from service.api.context import Context
from tests.unit.service.asking import bearing, post_capture, problem_of


@pytest.mark.parametrize(
    ("path", "detail"),
    [
        ("/jobs?stat=done", "there is no parameter 'stat'; this address takes limit and after"),
        (
            "/jobs?limit=1&Limit=2",
            "there is no parameter 'Limit'; this address takes limit and after",
        ),
        ("/jobs?=", "there is no parameter ''; this address takes limit and after"),
        ("/jobs?a%0Ab=1", r"there is no parameter 'a\nb'; this address takes limit and after"),
        (
            "/calibrations?kind=flash",
            "there is no parameter 'kind'; this address takes camera and setup",
        ),
        ("/cameras?state=idle", "there is no parameter 'state'; this address takes none"),
        ("/jobs/a?wait=5", "there is no parameter 'wait'; this address takes none"),
        (
            "/jobs/a/area?left=0&top=0&width=1&height=1&scale=2",
            "there is no parameter 'scale'; this address takes left, top, width and height",
        ),
    ],
)
def test_a_parameter_that_there_is_not_is_refused(
    path: str, detail: str, http: httpx.Client
) -> None:
    """Without a word, a list would be of everything."""
    assert problem_of(http.get(path)) == (422, "invalid-request", f"query: {detail}.")


@pytest.mark.parametrize("path", ["/jobs?limit=1&limit=2", "/jobs?limit=1&limit=1"])
def test_a_parameter_that_comes_twice_is_refused(path: str, http: httpx.Client) -> None:
    """Without a word, the last one would count."""
    told = "query.limit: it is there more than once; give it once."
    assert problem_of(http.get(path)) == (422, "invalid-request", told)


def test_what_is_confirmed_is_named_as_it_is_called(http: httpx.Client) -> None:
    path = f"/jobs/{post_capture(http)['id']}/confirm"
    assert problem_of(http.post(path, params={"requests": 2})) == (
        422,
        "invalid-request",
        "query: there is no parameter 'requests'; this address takes request.",
    )
    assert problem_of(http.post(path, params={"request": 2}))[:2] == (409, "not-ready")


def test_a_long_name_is_told_in_short(http: httpx.Client) -> None:
    _, _, detail = problem_of(http.get("/jobs", params={"x" * 5000: 1}))
    assert f"'{'x' * 32}';" in detail


def test_parameters_that_there_are_are_taken(http: httpx.Client) -> None:
    job = post_capture(http)["id"]
    post_capture(http)
    page = http.get("/jobs", params={"limit": 1}).json()
    assert "after=" in page["next"]
    assert [one["id"] for one in http.get(page["next"]).json()["jobs"]] == [job]
    assert http.get("/calibrations?camera=d5100&setup=table").json() == {"calibrations": []}


def test_who_may_not_ask_is_told_that_first(http: httpx.Client, context: Context) -> None:
    assert http.get("/jobs?stat=done", headers=bearing(context, "read")).status_code == 422
    assert http.get("/jobs?stat=done").status_code == 401
    assert http.get("/cameras?a=b", headers=bearing(context, "read")).status_code == 403


@pytest.mark.parametrize("path", ["/", "/page/app.js", "/healthz", "/openapi.json"])
def test_what_is_no_list_may_be_asked_past_a_cache(path: str, http: httpx.Client) -> None:
    assert http.get(f"{path}?v=2").status_code == 200
