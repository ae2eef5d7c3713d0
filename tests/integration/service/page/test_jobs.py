"""Jobs on the page, in a real browser on a real service."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

import drivers
from tests.integration.service.page.looking import (
    PATIENT,
    TWO_FRAMES,
    check_access,
    open_mixer,
    result,
)

LATER = "2030-01-01T12:00:00Z"


def known(page: Page) -> list[str]:
    """Paths that the page asks for from now on."""
    asked: list[str] = []
    page.on(
        "request", lambda request: asked.append(request.url.partition("//")[2].partition("/")[2])
    )
    return asked


def test_a_job_is_followed_by_its_events(
    page: Page, service: Any, unending: dict[str, Any]
) -> None:
    here = f"jobs/{unending['id']}"
    page.add_init_script(PATIENT)
    asked = known(page)
    page.goto(f"/#/{here}")
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    service.http.post(f"/{here}/cancel").raise_for_status()
    expect(page.get_by_role("alert")).to_contain_text("Canceled")
    assert [path for path in asked if path.startswith("jobs")] == [here, f"{here}/events"]


def test_events_carry_the_key(page: Page, keyed_queue: tuple[Any, str]) -> None:
    service, key = keyed_queue
    job = service.capture("sim://studio")
    sent: list[str | None] = []
    page.on("request", lambda request: sent.append(request.headers.get("authorization")))
    with page.expect_request("**/events"):
        page.goto(f"{service.url}/#/jobs/{job['id']}")
        page.get_by_role("textbox", name="Key").fill(key)
        page.keyboard.press("Enter")
    assert sent[-1] == f"Bearer {key}"
    assert not any(key in address for address in (page.url, page.content()))


def test_a_link_to_a_job_of_another_key_is_followed_with_that(
    page: Page, keyed_queue: tuple[Any, str], pair: drivers.CapturedPair
) -> None:
    """The service does not tell that there is such a job."""
    service, key = keyed_queue
    job = service.upload(pair)
    mine = service.make_key("visitor", "--scopes", "read")
    page.goto(f"{service.url}/")
    page.evaluate("(key) => sessionStorage.setItem('lightlayers-key', key)", mine)
    page.goto(f"{service.url}/#/jobs/{job['id']}")
    page.reload()
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("No such job")
    alert.get_by_role("button", name="Use another key").click()
    page.get_by_role("textbox", name="Key").fill(key)
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Separation: waits")).to_be_visible()
    expect(page.locator("main")).to_be_focused()


def test_what_the_browser_keeps_of_results_still_needs_the_key(
    page: Page, keyed_service: tuple[Any, str], pair: drivers.CapturedPair
) -> None:
    service, key = keyed_service
    job = service.await_end(service.upload(pair, lights=2))
    page.goto(f"{service.url}/")
    fetched = """async ([path, key]) => {
      const headers = { Authorization: `Bearer ${key}` };
      const first = await fetch(path, { headers });
      await first.arrayBuffer(); // only then is it kept
      return [first.status, (await fetch(path)).status];
    }"""
    path = f"/jobs/{job['id']}/results/layers.exr"
    assert page.evaluate(fetched, [path, key]) == [200, 401]


def test_where_events_do_not_come_the_page_asks(
    page: Page, keyed_queue: tuple[Any, str], pair: drivers.CapturedPair
) -> None:
    service, key = keyed_queue
    page.add_init_script(f"sessionStorage.setItem('lightlayers-key', '{key}')")
    page.route("**/events", lambda route: route.abort())
    job = service.upload(pair)
    page.goto(f"{service.url}/#/jobs/{job['id']}")
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    service.http.post(f"/jobs/{job['id']}/cancel").raise_for_status()
    expect(page.get_by_role("alert")).to_contain_text("Canceled")
    page.get_by_role("button", name="Run again").click()
    page.wait_for_url(lambda url: job["id"] not in url)
    other = page.url.rpartition("/")[2]
    now = service.look({"links": {"self": f"/jobs/{other}"}})
    assert now["inputs"] == service.look(job)["inputs"]
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("alert")).to_contain_text("Canceled")


@pytest.mark.parametrize("name", ["Run again", "Find normals"])
def test_a_double_click_makes_one_job(page: Page, done: dict[str, Any], name: str) -> None:
    held: list[Route] = []
    page.route("**/rerun", lambda route: held.append(route))
    open_mixer(page, done)
    page.get_by_text("Find the surface").click()
    with page.expect_request("**/rerun"):
        page.get_by_role("button", name=name).dblclick()
    page.evaluate(TWO_FRAMES)
    assert len(held) == 1
    held[0].fulfill(status=503, json={"title": "Full", "detail": "Come back.", "status": 503})
    expect(page.get_by_role("alert")).to_contain_text("Come back.")
    with page.expect_request("**/rerun"):  # what failed may be tried again
        page.get_by_role("button", name=name).click()


@pytest.mark.parametrize(
    ("name", "end"),
    [("Run again", "rerun"), ("Find normals", "rerun"), ("Render full size", "mix")],
)
def test_what_got_no_answer_is_sent_again_as_the_same(
    page: Page, done: dict[str, Any], name: str, end: str
) -> None:
    once: list[str] = []

    def lose(route: Route) -> None:
        once.append(route.request.headers["idempotency-key"])
        route.abort()

    page.route(f"**/{end}", lose)
    open_mixer(page, done)
    page.get_by_text("Find the surface").click()
    for _ in range(2):
        with page.expect_event("requestfailed", lambda one: one.url.endswith(f"/{end}")):
            page.get_by_role("button", name=name).click()
        expect(page.get_by_role("alert")).to_contain_text("No connection")
    first, again = once
    assert first == again


def test_the_same_mix_is_another_job_once_the_first_was_made(
    page: Page, done: dict[str, Any]
) -> None:
    once: list[str] = []
    file = {"name": "mix.jpg", "size": 1000, "href": "/jobs/mixed/results/mix.jpg"}
    mixed = {**done, "id": "mixed", "files": [file]}

    def mix(route: Route) -> None:
        once.append(route.request.headers["idempotency-key"])
        route.fulfill(status=202, json=mixed)

    page.route("**/mix", mix)
    page.route("**/jobs/mixed", lambda route: route.fulfill(json=mixed))
    open_mixer(page, done)
    render = page.get_by_role("button", name="Render full size")
    for _ in range(2):
        with page.expect_request("**/mix"):
            render.click()
        expect(render).to_be_enabled()
    assert len(set(once)) == 2


def test_a_job_that_failed_says_why_and_is_deleted(page: Page, service: Any) -> None:
    job = service.capture("sim://studio", deadline_seconds=0.01)
    ended = service.await_end(job)
    assert ended["state"] == "failed"
    page.goto(f"/#/jobs/{job['id']}")
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text(ended["error"]["title"])
    expect(alert).to_contain_text(ended["error"]["detail"])
    check_access(page, "failed")
    page.once("dialog", lambda dialog: dialog.dismiss())
    page.get_by_role("button", name="Delete").click()
    assert service.look(job)["id"] == job["id"]
    page.once("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Delete").click()
    page.wait_for_url(re.compile("#/jobs$"))
    assert service.http.get(f"/jobs/{job['id']}").status_code == 404


def test_a_job_whose_time_is_over_was_not_stopped(page: Page, done: dict[str, Any]) -> None:
    expired = {**done, "state": "expired", "files": []}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=expired))
    page.goto(f"/#/jobs/{done['id']}")
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("Expired")
    expect(alert).to_contain_text("The job's time is over; its files are being removed.")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("doesnotexist", "doesnotexist"),
        ("%E0%A4%A", "The address ends in %E0%A4%A, which names no job: choose it under Jobs"),
    ],
)
def test_of_a_job_that_is_not_there_the_error_and_a_way_home_are_shown(
    page: Page, name: str, words: str
) -> None:
    page.goto(f"/#/jobs/{name}")
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("No such job")
    expect(alert).to_contain_text(words)
    expect(page.locator("main > *")).to_have_count(2)
    page.locator("main").get_by_role("link", name="Add two photographs").click()
    expect(page.get_by_role("button", name="Separate the light")).to_be_visible()


def test_layers_as_another_camera_sees_them_are_told_from_those_of_the_lamps(page: Page) -> None:
    words = {
        "lamp1.jpg": "The light of lamp 1",
        "lamp2.tif": "The light of lamp 2, 16-bit",
        "response_lamp2.jpg": "The light of lamp 2 as another camera sees it",
        "response_lampx.jpg": "",
        "gamma.png": "The light of every pixel, and the lamps",
    }
    page.goto("/")
    found = page.evaluate(
        """async (names) => {
          const { filesOf } = await import("/page/files.js");
          const files = names.map((name) => ({ name, size: 1, href: "" }));
          const shown = filesOf({ id: "a", files, links: { zip: "" } }).querySelectorAll(".what");
          return [...shown].map((element) => element.textContent);
        }""",
        list(words),
    )
    assert found == list(words.values())


def test_many_jobs_come_by_pages_and_go_one_by_one(page: Page, done: dict[str, Any]) -> None:
    def jobs(route: Route) -> None:
        last = "after=" in route.request.url
        made = [{**done, "id": f"{number:032x}"} for number in range(2 if last else 48)]
        more = None if last else f"/jobs?limit=48&after=1764085200.5-{made[-1]['id']}"
        route.fulfill(json={"jobs": made, "next": more})

    page.route(re.compile(r"/jobs\?"), jobs)
    page.route("**/thumbnail.jpg", lambda route: route.abort())
    page.route(re.compile(r"/jobs/0+$"), lambda route: route.fulfill(status=204))
    page.goto("/#/jobs")
    expect(page.locator(".jobs li")).to_have_count(48)
    page.get_by_role("button", name="Older jobs").click()
    expect(page.locator(".jobs li")).to_have_count(50)
    expect(page.get_by_role("button", name="Older jobs")).to_have_count(0)
    page.once("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name=re.compile("^Delete Separation")).first.click()
    expect(page.locator(".jobs li")).to_have_count(49)


def test_older_jobs_that_cannot_be_fetched_are_told_in_words(
    page: Page, done: dict[str, Any]
) -> None:
    def jobs(route: Route) -> None:
        if "after=" in route.request.url:
            route.abort()
        else:
            more = f"/jobs?limit=48&after=1764085200.5-{done['id']}"
            route.fulfill(json={"jobs": [done], "next": more})

    page.route(re.compile(r"/jobs\?"), jobs)
    page.goto("/#/jobs")
    page.get_by_role("button", name="Older jobs").click()
    expect(page.get_by_role("alert")).to_contain_text("No connection")
    expect(page.get_by_role("button", name="Older jobs")).to_be_visible()


def test_of_a_job_that_is_deleted_meanwhile_the_error_and_a_way_home_are_shown(
    page: Page, done: dict[str, Any]
) -> None:
    there = [True]
    problem = {"title": "No such job", "detail": "It may have been deleted.", "status": 404}

    def job(route: Route) -> None:
        if there:
            route.fulfill(json={**done, "state": "running"})
        else:
            route.fulfill(status=404, json=problem)

    page.route(f"**/jobs/{done['id']}", job)
    page.route("**/events", lambda route: route.abort())
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    there.clear()
    expect(page.get_by_role("alert")).to_contain_text("No such job")
    expect(page.locator("main").get_by_role("link", name="Add two photographs")).to_be_visible()
    expect(page.locator("main > *")).to_have_count(2)


def test_taking_the_pair_is_no_attempt_that_failed(page: Page, done: dict[str, Any]) -> None:
    attempt = [2]

    def job(route: Route) -> None:
        taken = {"capture": {"camera": "sim://studio"}, "state": "running", "stage": "lamps"}
        route.fulfill(json={**done, **taken, "position": 7, "attempt": attempt[0]})

    page.route(f"**/jobs/{done['id']}", job)
    page.route("**/events", lambda route: route.abort())
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.locator(".lead")).to_have_text("Place 7 in the queue")
    attempt[0] = 3
    expect(page.locator(".lead")).to_have_text("Place 7 in the queue · Attempt 2")


def test_the_same_request_asked_anew_is_confirmed_anew(page: Page, done: dict[str, Any]) -> None:
    here = f"/jobs/{done['id']}"
    number = [1]
    confirmed: list[str] = []

    def job(route: Route) -> None:
        request = {"request": "Switch the flash off, then confirm.", "until": LATER}
        links = {**done["links"], "confirm": f"{here}/confirm?request={number[0]}"}
        told = {"state": "waiting_for_operator", "operator": request, "links": links}
        route.fulfill(json={**done, **told})

    def confirm(route: Route) -> None:
        confirmed.append(route.request.url.rpartition("=")[2])
        route.fulfill(status=202, json=done)

    page.route(f"**{here}", job)
    page.route(f"**{here}/events", lambda route: route.abort())
    page.route(f"**{here}/confirm?*", confirm)
    page.goto(f"/#{here}")
    expect(page.get_by_role("button", name="Confirm")).to_be_visible()
    number[0] = 3  # its worker died, and another one begins the pair anew
    for _ in range(3):  # one that was on its way, one that tells of it, one asked for after that
        with page.expect_response(f"**{here}"):
            pass
    with page.expect_response(f"**{here}/confirm?*"):
        page.get_by_role("button", name="Confirm").click()
    expect(page.get_by_role("alert")).to_have_count(0)
    assert confirmed == ["3"]


def test_on_a_small_phone_a_job_tells_its_kind_and_state(phone: Page, done: dict[str, Any]) -> None:
    phone.set_viewport_size({"width": 320, "height": 568})
    made = {**done, "state": "waiting_for_operator", "options": {"kind": "camera"}, "files": []}
    phone.route(
        re.compile(r"/jobs\?"), lambda route: route.fulfill(json={"jobs": [made] * 2, "next": None})
    )
    phone.goto("/#/jobs")
    cards = phone.locator(".jobs a")
    expect(cards).to_have_count(2)
    for card in cards.all():
        whole = card.bounding_box()
        assert whole is not None
        for words in ("Calibration of a camera", "Waits for you"):
            part = card.get_by_text(words).bounding_box()
            assert part is not None
            assert part["x"] + part["width"] <= whole["x"] + whole["width"]


def test_what_a_calibration_warns_of_is_told(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    manifest = json.loads(result(service, done, "manifest.json"))
    words = "The flash was not told: name it."
    manifest["warnings"] = [{"code": "flash_doubtful", "message": words, "figures": {}}]
    calibration = {**done, "options": {"kind": "camera"}}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=calibration))
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.get_by_role("button", name="Download all")).to_be_visible()
    expect(page.locator(".warnings")).to_contain_text("1 warning")
    expect(page.locator(".warnings").get_by_text(words)).to_be_visible()
    check_access(page, "calibration")


def test_somebody_is_asked_and_confirms(page: Page, done: dict[str, Any]) -> None:
    """As the service tells it: the job waits for its operator until it is confirmed."""
    here = f"/jobs/{done['id']}"
    request = "Switch the flash off, then confirm."
    waiting = {
        **done,
        "state": "waiting_for_operator",
        "stage": "capture",
        "capture": {"camera": "sim://studio"},
        "operator": {"request": request, "until": LATER},
        "links": {**done["links"], "confirm": f"{here}/confirm"},
    }
    confirmed: list[str] = []

    def events(route: Route) -> None:
        if not confirmed:
            route.abort()
            return
        data = json.dumps({**waiting, "state": "canceled", "operator": None})
        route.fulfill(content_type="text/event-stream", body=f"id: 2\ndata: {data}\n\n")

    def confirm(route: Route) -> None:
        confirmed.append(route.request.method)
        route.fulfill(status=202, json=waiting)

    page.route(f"**{here}", lambda route: route.fulfill(json=waiting))
    page.route(f"**{here}/events", events)
    page.route(f"**{here}/confirm", confirm)
    page.goto(f"/#{here}")
    expect(page.get_by_role("heading", name="Separation: waits for you")).to_be_visible()
    expect(page.get_by_role("status")).to_have_text(request)
    check_access(page, "operator")
    page.get_by_role("button", name="Confirm").click()
    expect(page.get_by_role("alert")).to_contain_text("Canceled")
    assert confirmed == ["POST"]
