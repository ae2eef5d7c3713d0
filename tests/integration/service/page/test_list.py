"""The list of jobs as time goes by, in a real browser."""

from __future__ import annotations

import re
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Locator, Page, Route, expect

from tests.integration.service.page.looking import HIDE, TWO_FRAMES, check_access

AWAY = {"type": "x", "title": "Away", "detail": "Back in a minute.", "status": 503}


class Listed:
    """Jobs that the service tells of; `failing`: it does not."""

    def __init__(self, page: Page, done: dict[str, Any]) -> None:
        self.done = {**done, "files": []}
        self.jobs = [self.job(1, state="running"), self.job(0)]
        self.failing = False
        page.route(re.compile(r"/jobs\?"), self._answer)

    def job(self, number: int, **more: Any) -> dict[str, Any]:
        """The job of this number, which is that of the second when it was made."""
        created = f"2030-01-01T12:00:0{number}Z"
        return {**self.done, "id": f"{number:032x}", "created": created, **more}

    def _answer(self, route: Route) -> None:
        if self.failing:
            route.fulfill(status=503, json=AWAY)
        elif "after=" in route.request.url:
            route.abort()
        else:
            after = f"/jobs?limit=48&after=1764085200.5-{self.jobs[-1]['id']}"
            route.fulfill(json={"jobs": self.jobs, "next": after})


@pytest.fixture
def listed(page: Page, done: dict[str, Any]) -> Listed:
    """The list is shown."""
    listed = Listed(page, done)
    page.goto("/#/jobs")
    expect(states(page)).to_have_text(["Runs", "Done"])
    return listed


def states(page: Page) -> Locator:
    return page.locator(".jobs .state")


def look_away_and_back(page: Page) -> None:
    """Which refreshes the list."""
    for hidden in (True, False):
        page.evaluate(HIDE, hidden)


def await_job(page: Page) -> None:
    """Wait until a job is shown for the list: who goes back before that has not left it."""
    page.wait_for_url(re.compile(r"#/jobs/0+"))
    expect(states(page)).to_have_count(0)


def test_jobs_under_way_are_shown_as_they_become(page: Page, listed: Listed) -> None:
    page.get_by_role("button", name=re.compile("^Delete")).last.focus()
    listed.failing = True
    with page.expect_response(re.compile(r"/jobs\?")):
        pass  # which is told of nowhere: it is asked for again
    listed.failing = False
    listed.jobs = [listed.job(2, state="queued"), listed.job(1, state="failed"), listed.job(0)]
    expect(states(page)).to_have_text(["Waits", "Failed", "Done"])
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(page.get_by_role("button", name=re.compile("^Delete")).last).to_be_focused()
    listed.jobs = [listed.job(2), listed.job(0)]
    expect(states(page)).to_have_text(["Done", "Done"])


def test_a_list_that_is_seen_again_is_that_of_now(page: Page, listed: Listed) -> None:
    """Even where nothing was under way."""
    listed.jobs = [listed.job(1), listed.job(0)]
    expect(states(page)).to_have_text(["Done", "Done"])
    page.evaluate(HIDE, True)
    listed.jobs = [listed.job(2, state="queued"), *listed.jobs]
    with page.expect_request(re.compile(r"/jobs\?")):
        page.evaluate(HIDE, False)
    expect(states(page)).to_have_text(["Waits", "Done", "Done"])


def test_the_link_to_where_one_is_shows_it_anew(page: Page, listed: Listed) -> None:
    listed.jobs = [listed.job(2), listed.job(1), listed.job(0)]
    page.get_by_role("link", name="Jobs").click()
    expect(states(page)).to_have_text(["Done", "Done", "Done"])
    expect(page.locator("main")).to_be_focused()


def test_a_list_that_one_comes_back_to_is_where_it_was(page: Page, listed: Listed) -> None:
    """With as many jobs as were shown; the link to it begins at the newest."""
    listed.jobs = [listed.job(number) for number in range(60)]
    asked: list[str] = []
    page.on("request", lambda one: asked.append(one.url) if "/jobs?" in one.url else None)
    page.reload()
    expect(states(page)).to_have_count(60)
    chosen = page.locator(".jobs a").nth(55)
    chosen.scroll_into_view_if_needed()
    place = page.evaluate("scrollY")
    assert place > 500
    chosen.click()
    await_job(page)
    page.go_back()
    expect(states(page)).to_have_count(60)
    page.wait_for_function("place => Math.abs(scrollY - place) < 2", arg=place)
    assert [url.partition("?")[2] for url in asked] == ["limit=48", "limit=60"]
    page.get_by_role("link", name="Jobs").click()
    page.wait_for_function("scrollY === 0")
    expect(states(page)).to_have_count(60)
    assert page.evaluate("scrollY") == 0


def test_a_list_is_where_it_was_whatever_way_one_comes_back(page: Page, listed: Listed) -> None:
    """By the ways back and forth, or loaded anew: not by a job that was chosen alone."""
    listed.jobs = [listed.job(number) for number in range(60)]
    page.reload()
    expect(states(page)).to_have_count(60)

    def scroll(place: int) -> None:
        page.evaluate("place => scrollTo(0, place)", place)
        page.wait_for_function("place => history.state?.y === place", arg=place)

    def expect_at(place: int) -> None:
        expect(states(page)).to_have_count(60)
        page.wait_for_function("place => Math.abs(scrollY - place) < 2", arg=place)

    scroll(400)
    page.reload()
    expect_at(400)
    page.locator(".jobs a").nth(20).click()
    await_job(page)
    page.go_back()
    expect_at(page.evaluate("history.state.y"))
    scroll(600)
    page.go_forward()
    await_job(page)
    page.go_back()
    expect_at(600)
    page.get_by_role("link", name="Jobs").click()
    expect_at(0)


def test_a_list_that_one_comes_back_to_has_all_jobs_that_it_had(page: Page, listed: Listed) -> None:
    """More than may be asked for at once."""
    jobs = [{**listed.job(0), "id": f"{number:032x}"} for number in range(250)]

    def answer(route: Route) -> None:
        query = parse_qs(urlsplit(route.request.url).query)
        start = int(query.get("after", ["0"])[0])
        end = start + int(query["limit"][0])
        more = f"/jobs?limit={query['limit'][0]}&after={end}" if end < len(jobs) else None
        route.fulfill(json={"jobs": jobs[start:end], "next": more})

    page.route(re.compile(r"/jobs\?"), answer)
    page.reload()
    for count in (48, 96, 144, 192):
        expect(states(page)).to_have_count(count)
        page.get_by_role("button", name="Older jobs").click()
    expect(states(page)).to_have_count(240)
    page.locator(".jobs a").nth(230).click()
    await_job(page)
    page.go_back()
    expect(page.locator(".jobs a").nth(230)).to_be_in_viewport()


def test_jobs_that_cannot_be_listed_are_tried_again(page: Page, listed: Listed) -> None:
    listed.failing = True
    page.get_by_role("link", name="Jobs").click()
    expect(page.get_by_role("alert")).to_contain_text("Back in a minute.")
    check_access(page, "no_jobs")
    listed.failing = False
    page.get_by_role("button", name="Try again").click()
    expect(states(page)).to_have_text(["Runs", "Done"])
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(page.locator("main")).to_be_focused()


def test_what_cannot_come_back_is_not_tried_again(page: Page) -> None:
    page.goto("/#/jobs/gone")
    expect(page.get_by_role("alert")).to_contain_text("No such job")
    expect(page.get_by_role("button", name="Try again")).to_have_count(0)


def test_a_key_that_is_refused_meanwhile_is_asked_for_once(page: Page, listed: Listed) -> None:
    page.add_init_script("sessionStorage.setItem('lightlayers-key', 'revoked')")
    page.reload()
    expect(states(page)).to_have_text(["Runs", "Done"])
    asked: list[str | None] = []

    def refuse(route: Route) -> None:
        asked.append(route.request.headers.get("authorization"))
        if asked[-1] == "Bearer another":
            route.fallback()
        else:
            route.fulfill(status=401, json={**AWAY, "detail": "Send a key.", "status": 401})

    page.route(re.compile(r"/jobs\?"), refuse)
    look_away_and_back(page)
    page.get_by_role("button", name="Not now").click()
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("Send a key.")
    for _ in range(3):
        look_away_and_back(page)
    page.evaluate(TWO_FRAMES)
    expect(page.locator("#key")).to_be_hidden()
    assert asked == ["Bearer revoked"]
    alert.get_by_role("button", name="Use another key").click()
    page.get_by_role("textbox", name="Key").fill("another")
    page.keyboard.press("Enter")
    expect(alert).to_have_count(0)
    listed.jobs = [listed.job(1, state="failed"), listed.job(0)]
    look_away_and_back(page)
    expect(states(page)).to_have_text(["Failed", "Done"])


@pytest.mark.usefixtures("listed")
def test_a_job_that_another_tab_has_deleted_is_gone_here_too(page: Page) -> None:
    gone = {"type": "x", "title": "No such job", "detail": "It is gone.", "status": 404}
    page.route(re.compile(r"/jobs/0+$"), lambda route: route.fulfill(status=404, json=gone))
    page.on("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name=re.compile("^Delete")).last.click()
    expect(states(page)).to_have_text(["Runs"])
    expect(page.get_by_role("alert")).to_have_count(0)


def test_pictures_of_a_list_that_is_left_are_waited_for_no_longer(
    page: Page, listed: Listed, done: dict[str, Any]
) -> None:
    """They would hold up what is looked at instead."""
    listed.jobs = [{**one, "files": done["files"]} for one in listed.jobs]
    page.route("**/thumbnail.jpg", lambda _: None)
    with page.expect_request("**/thumbnail.jpg"):
        page.get_by_role("link", name="Jobs").click()
    with page.expect_event("requestfailed", lambda one: one.url.endswith("/thumbnail.jpg")):
        page.get_by_role("link", name="New").click()


def test_problems_are_told_beside_their_buttons(page: Page, listed: Listed) -> None:
    """Of which there may be many screens of jobs."""
    listed.jobs = [listed.job(9 - number) for number in range(10)] * 4
    page.reload()
    expect(states(page)).to_have_count(40)
    page.get_by_role("button", name="Older jobs").click()
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("No connection")
    expect(alert).to_be_in_viewport()
    page.reload()
    expect(states(page)).to_have_count(40)
    page.route(re.compile(r"/jobs/0+"), lambda route: route.fulfill(status=503, json=AWAY))
    page.on("dialog", lambda dialog: dialog.accept())
    last = page.locator(".jobs li").last
    last.get_by_role("button", name=re.compile("^Delete")).click()
    expect(last.get_by_role("alert")).to_contain_text("Back in a minute.")
    expect(alert).to_be_in_viewport()
