"""The page over networks that are slow, break off or tell other times, in a real browser."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

from playwright.sync_api import Page, Route, expect

from tests.integration.service.page.looking import drawn, open_mixer

AWAY = {"type": "x", "title": "Away", "detail": "Back in a minute.", "status": 503}
OF_A_PROXY = {"message": "no healthy upstream", "status": "Failure"}


def test_a_page_of_which_a_script_does_not_come_says_so(page: Page) -> None:
    page.route("**/strip.js", lambda route: route.abort())
    page.goto("/")
    expect(page.get_by_text("If this stays, load it again.")).to_be_visible()
    page.unroute("**/strip.js")
    page.reload()
    expect(page.get_by_role("button", name="Separate the light")).to_be_visible()
    expect(page.get_by_text("If this stays")).to_have_count(0)


def test_how_much_of_the_layers_has_come_is_told(page: Page, done: dict[str, Any]) -> None:
    devtools = page.context.new_cdp_session(page)
    page.goto("/#/jobs")
    slow = {"offline": False, "latency": 0, "uploadThroughput": -1, "downloadThroughput": 400_000}
    devtools.send("Network.emulateNetworkConditions", slow)
    page.goto(f"/#/jobs/{done['id']}")
    told = page.locator(".wait")
    expect(told).to_have_text(re.compile(r"^Loading the layers … [1-9]\d? %$"))
    devtools.send("Network.emulateNetworkConditions", {**slow, "downloadThroughput": -1})
    drawn(page)


def test_layers_that_break_off_are_tried_again_in_their_place(
    page: Page, done: dict[str, Any]
) -> None:
    page.route("**/preview.exr", lambda route: route.abort())
    page.goto(f"/#/jobs/{done['id']}")
    again = page.locator(".picture").get_by_role("button", name="Try again")
    again.click()
    again.wait_for()
    page.unroute("**/preview.exr")
    again.click()
    drawn(page)
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(page.locator("main")).to_be_focused()


def test_a_picture_that_breaks_off_is_tried_again_in_its_place(
    page: Page, done: dict[str, Any]
) -> None:
    open_mixer(page, done)
    page.route("**/gamma.png", lambda route: route.abort())
    view = page.get_by_role("radio", name="Why these lamps")
    view.check(force=True)
    page.unroute("**/gamma.png")
    page.locator(".picture").get_by_role("button", name="Try again").click()
    expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(view).to_be_focused()


def test_layers_of_a_mixer_that_is_left_are_waited_for_no_longer(
    page: Page, done: dict[str, Any]
) -> None:
    page.route("**/preview.exr", lambda _: None)
    with page.expect_request("**/preview.exr"):
        page.goto(f"/#/jobs/{done['id']}")
    with page.expect_event("requestfailed", lambda one: one.url.endswith("/preview.exr")):
        page.get_by_role("link", name="New").click()
    expect(page.get_by_role("alert")).to_have_count(0)


def test_a_rendering_is_made_once_where_the_network_breaks_after_it_was_asked_for(
    page: Page, done: dict[str, Any]
) -> None:
    file = {"name": "mix.jpg", "size": 1000, "href": "/jobs/mixed/results/mix.jpg"}
    mixed = {**done, "id": "mixed", "files": [file]}
    looks: list[str] = []

    def look(route: Route) -> None:
        looks.append(route.request.url)
        if len(looks) < 3:
            route.abort()
        else:
            route.fulfill(json=mixed)

    open_mixer(page, done)
    page.route("**/mix", lambda route: route.fulfill(status=202, json={**mixed, "state": "queued"}))
    page.route("**/jobs/mixed", look)
    page.get_by_role("button", name="Render full size").click()
    expect(page.get_by_role("button", name="Download mix.jpg")).to_be_visible()
    expect(page.get_by_role("alert")).to_have_count(0)


def test_a_job_is_watched_on_where_a_proxy_answers_in_words_of_its_own(
    page: Page, done: dict[str, Any]
) -> None:
    looks: list[str] = []

    def look(route: Route) -> None:
        looks.append(route.request.url)
        if len(looks) == 1:
            route.fulfill(json={**done, "state": "running", "stage": "lamps"})
        elif len(looks) < 4:
            route.fulfill(status=503, json=OF_A_PROXY)
        else:
            route.continue_()

    page.route(f"**/jobs/{done['id']}", look)
    page.route("**/events", lambda route: route.fulfill(status=503, json=OF_A_PROXY))
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.get_by_text("The service does not answer just now")).to_be_visible()
    drawn(page)
    expect(page.get_by_role("alert")).to_have_count(0)


def test_what_a_proxy_says_in_words_of_its_own_is_told_and_tried_again(page: Page) -> None:
    page.route(re.compile(r"/jobs\?"), lambda route: route.fulfill(status=503, json=OF_A_PROXY))
    page.goto("/#/jobs")
    expect(page.get_by_role("alert")).to_contain_text("The service failed")
    expect(page.get_by_role("alert")).to_contain_text("It answered with 503")
    page.unroute(re.compile(r"/jobs\?"))
    page.get_by_role("button", name="Try again").click()
    expect(page.get_by_role("alert")).to_have_count(0)


def test_a_file_that_fails_after_its_view_was_left_is_told_of(
    page: Page, done: dict[str, Any]
) -> None:
    held: list[Route] = []
    page.route("**/results/layers.exr", lambda route: held.append(route))
    open_mixer(page, done)
    page.get_by_text("Files", exact=True).click()
    with page.expect_request("**/results/layers.exr"):
        page.get_by_role("button", name="layers.exr").click()
    page.get_by_role("link", name="Jobs").click()
    held[0].fulfill(status=503, json=AWAY)
    expect(page.locator("#notes").get_by_role("alert")).to_contain_text("Back in a minute.")


def test_what_is_left_of_a_job_is_told_though_the_clock_here_is_wrong(
    page: Page, done: dict[str, Any]
) -> None:
    """The service's is two hours ahead."""
    there = datetime.now(UTC) + timedelta(hours=2)
    job = {
        **done,
        "state": "waiting_for_operator",
        "stage": "capture",
        "eta": (there + timedelta(minutes=5)).isoformat(),
        "capture": {"camera": "sim://studio"},
        "operator": {
            "request": "Switch the flash off.",
            "until": (there + timedelta(minutes=5)).isoformat(),
        },
        "links": {**done["links"], "confirm": "/confirm"},
    }
    headers = {"Date": format_datetime(there, usegmt=True)}
    page.route("**/events", lambda route: route.abort())
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=job, headers=headers))
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.get_by_text("about 5 minutes left")).to_be_visible()
    told = page.locator(".request").inner_text()
    here = page.evaluate(
        """() => [4, 5].map((minutes) =>
          new Date(Date.now() + 60000 * minutes).toLocaleTimeString([], { timeStyle: "short" }))"""
    )
    assert any(f"The job waits until {time}." in told for time in here)
