"""Leaving the dialog that asks for a key, in a real browser on a real service."""

from __future__ import annotations

import re
from typing import Any

from playwright.sync_api import FilePayload, Locator, Page, Route, expect

from tests.integration.service.page.looking import give_key, open_mixer

NO_KEY = {"type": "x", "title": "A key is needed", "detail": "Send a key.", "status": 401}


def refused(route: Route) -> bool:
    """Whether a request had no good key, which was answered then."""
    if route.request.headers.get("authorization") == "Bearer open sesame":
        return False
    route.fulfill(status=401, json=NO_KEY)
    return True


def enter_key(page: Page, alert: Locator) -> None:
    """Use the button of a problem."""
    alert.get_by_role("button", name="Enter a key").click()
    page.get_by_role("textbox", name="Key").fill("open sesame")
    page.keyboard.press("Enter")


def leave(page: Page, way: str) -> None:
    """Leave the dialog with something typed, which nobody wanted to send."""
    page.get_by_role("textbox", name="Key").fill("half a k")
    if way == "Escape":
        page.keyboard.press("Escape")
    else:
        page.get_by_role("button", name=way).click()


def test_a_dialog_that_is_left_comes_back_only_when_it_is_wanted(page: Page) -> None:
    asked: list[str] = []

    def guard(route: Route) -> None:
        asked.append(route.request.url)
        if not refused(route):
            route.fulfill(json={"jobs": [], "next": None})

    page.route(re.compile(r":\d+/jobs\?"), guard)
    page.goto("/#/jobs")
    leave(page, "Escape")
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("Send a key.")
    expect(page.locator("#key")).to_be_hidden()
    assert len(asked) == 1
    assert page.evaluate("sessionStorage.length") == 0
    enter_key(page, alert)
    expect(page.get_by_text("There are none yet.")).to_be_visible()
    expect(alert).to_have_count(0)


def without_key(route: Route) -> None:
    """Pass a request on without its key, which the service itself refuses."""
    headers = route.request.headers
    headers.pop("authorization", None)
    route.continue_(headers=headers)


def test_photographs_can_be_sent_after_the_dialog_was_left(page: Page) -> None:
    def guard(route: Route) -> None:
        if not refused(route):
            route.fulfill(status=202, json={"id": "made"})

    gone: dict[str, Any] = {"type": "x", "title": "Gone", "detail": "It is gone.", "status": 404}
    page.route("**/cameras", lambda route: route.abort())  # they would ask for a key of their own
    page.route("**/jobs", guard)
    page.route("**/jobs/made", lambda route: route.fulfill(status=404, json=gone))
    page.route("**/uploads/*", without_key)
    page.goto("/")
    files: list[FilePayload] = [
        {"name": name, "mimeType": "image/jpeg", "buffer": b"x"} for name in ("a.jpg", "b.jpg")
    ]
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    send = page.get_by_role("button", name="Separate the light")
    send.click()
    leave(page, "Not now")
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("Send a key.")
    enter_key(page, alert)
    expect(alert).to_have_count(0)
    send.click()
    expect(alert).to_contain_text("It is gone.")
    assert page.url.endswith("#/jobs/made")


def test_a_picture_comes_with_the_key_that_is_entered_at_its_place(
    page: Page, done: dict[str, Any]
) -> None:
    def guard(route: Route) -> None:
        if not refused(route):
            without_key(route)

    page.route("**/gamma.png", guard)
    open_mixer(page, done)
    page.get_by_role("radio", name="Why these lamps").check(force=True)
    leave(page, "Escape")
    alert = page.locator(".picture").get_by_role("alert")
    enter_key(page, alert)
    expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    expect(alert).to_have_count(0)


def test_a_picture_of_a_job_of_another_key_comes_with_that_key(
    page: Page, done: dict[str, Any]
) -> None:
    """Of such a job the service tells no more than of one that is gone."""
    urn = "urn:lightlayers:problem:unknown-job"
    gone = {"type": urn, "title": "No such job", "detail": "It is gone.", "status": 404}

    def guard(route: Route) -> None:
        if route.request.headers.get("authorization") == "Bearer open sesame":
            without_key(route)
        else:
            route.fulfill(status=404, json=gone)

    give_key(page)
    page.route("**/gamma.png", guard)
    open_mixer(page, done)
    page.get_by_role("radio", name="Why these lamps").check(force=True)
    alert = page.locator(".picture").get_by_role("alert")
    expect(alert).to_contain_text("It is gone.")
    alert.get_by_role("button", name="Use another key").click()
    page.get_by_role("textbox", name="Key").fill("open sesame")
    page.keyboard.press("Enter")
    expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    expect(alert).to_have_count(0)
