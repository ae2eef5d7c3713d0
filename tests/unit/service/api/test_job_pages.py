from __future__ import annotations

import httpx
import pytest

from service.api.context import Context
from tests.unit.service.asking import bearing, owner_of, post_capture, problem_of
from tests.unit.service.job_rows import added


def test_jobs_are_listed_page_by_page(http: httpx.Client) -> None:
    made = [post_capture(http)["id"] for _ in range(5)]
    page = http.get("/jobs", params={"limit": 2}).json()
    found = [job["id"] for job in page["jobs"]]
    while page["next"]:
        page = http.get(page["next"]).json()
        found += [job["id"] for job in page["jobs"]]
    assert sorted(found) == sorted(made)
    assert len(found) == 5
    places = {job["id"]: job["position"] for job in http.get("/jobs").json()["jobs"]}
    assert sorted(places.values()) == [1, 2, 3, 4, 5]


def test_a_page_is_shorter_where_jobs_have_long_options(
    http: httpx.Client, context: Context
) -> None:
    # As long as options of a request may be: a page of 200 such jobs were 200 MB.
    table = {"camera": "x" * 1_000_000}
    made = [added(context.engine, f"{number:032x}", options=table).id for number in range(6)]

    pages = [http.get("/jobs?limit=200")]
    while following := pages[-1].json()["next"]:
        pages.append(http.get(following))

    listed = [[job["id"] for job in page.json()["jobs"]] for page in pages]
    assert listed == [made[:1:-1], made[1::-1]]
    assert all(len(page.content) < 5_000_000 for page in pages)


def test_a_page_is_no_shorter_for_the_long_options_of_others(
    http: httpx.Client, context: Context
) -> None:
    key = bearing(context, "read")
    for number in range(6):
        added(context.engine, f"{number:032x}", owner=owner_of(key))
        added(context.engine, f"f{number:031x}", options={"camera": "x" * 2_000_000})

    page = http.get("/jobs?limit=6", headers=key).json()

    assert (len(page["jobs"]), page["next"]) == (6, None)


def test_a_page_begins_where_the_one_before_ended_though_that_job_is_deleted(
    http: httpx.Client,
) -> None:
    for _ in range(4):
        post_capture(http)
    everyone = [job["id"] for job in http.get("/jobs").json()["jobs"]]
    page = http.get("/jobs", params={"limit": 2}).json()
    assert [job["id"] for job in page["jobs"]] == everyone[:2]
    assert http.delete(f"/jobs/{everyone[1]}").status_code == 204
    older = http.get(page["next"]).json()
    assert ([job["id"] for job in older["jobs"]], older["next"]) == (everyone[2:], None)


@pytest.mark.parametrize(
    "place",
    [
        "",
        "nothing",
        "0" * 32,
        "1764085200.5",
        f"1764085200-{'0' * 32}",
        f"nan-{'0' * 32}",
        f"-1.5-{'0' * 32}",
        f"1764085200.5-{'0' * 32}x",
    ],
)
def test_a_place_in_the_list_that_no_page_gave_is_refused(place: str, http: httpx.Client) -> None:
    assert problem_of(http.get("/jobs", params={"after": place})) == (
        422,
        "invalid-request",
        "query.after: use the whole address that `next` of the page before gives.",
    )


@pytest.mark.parametrize("query", ["limit=0", "limit=201", "limit=many"])
def test_a_page_of_no_sensible_length_is_refused(query: str, http: httpx.Client) -> None:
    assert problem_of(http.get(f"/jobs?{query}"))[:2] == (422, "invalid-request")
