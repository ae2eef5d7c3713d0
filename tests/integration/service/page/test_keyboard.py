"""Where the keyboard is after its button has gone, in a real browser on a real service."""

from __future__ import annotations

import json
import re
from typing import Any

from playwright.sync_api import Page, Route, expect

from tests.integration.service.page.looking import CAMERA, PATIENT, TWO_FRAMES, drop, tab_to


def test_the_keyboard_goes_on_at_the_first_of_older_jobs(page: Page, done: dict[str, Any]) -> None:
    def jobs(route: Route) -> None:
        older = "after=" in route.request.url
        made = [{**done, "id": f"{2 * older + number:032x}", "files": []} for number in range(2)]
        route.fulfill(json={"jobs": made, "next": None if older else "/jobs?limit=48&after=1"})

    page.route(re.compile(r"/jobs\?"), jobs)
    page.goto("/#/jobs")
    tab_to(page, page.get_by_role("button", name="Older jobs"))
    page.keyboard.press("Enter")
    expect(page.locator(".jobs li")).to_have_count(4)
    expect(page.locator(".jobs a").nth(2)).to_be_focused()


def test_the_keyboard_stays_in_the_page_after_the_last_job_is_deleted(
    page: Page, done: dict[str, Any]
) -> None:
    found = {"jobs": [{**done, "files": []}], "next": None}
    page.route(re.compile(r"/jobs\?"), lambda route: route.fulfill(json=found))
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(status=204))
    page.on("dialog", lambda dialog: dialog.accept())
    page.goto("/#/jobs")
    tab_to(page, page.get_by_role("button", name="Delete"))
    page.keyboard.press("Enter")
    expect(page.locator(".jobs li")).to_have_count(0)
    expect(page.locator("main")).to_be_focused()


def test_the_keyboard_stays_with_a_job_that_goes_on(page: Page, done: dict[str, Any]) -> None:
    here = f"/jobs/{done['id']}"
    job = {
        **done,
        "state": "waiting_for_operator",
        "operator": {"request": "Switch the flash off, then confirm.", "until": None},
        "links": {**done["links"], "confirm": f"{here}/confirm"},
    }
    page.route(f"**{here}", lambda route: route.fulfill(json=job))
    page.route(f"**{here}/events", lambda route: route.abort())
    page.goto(f"/#{here}")
    tab_to(page, page.get_by_role("button", name="Confirm"))
    job |= {"state": "running", "operator": None}
    expect(page.get_by_role("button", name="Confirm")).to_have_count(0)
    expect(page.locator("main")).to_be_focused()
    tab_to(page, page.get_by_role("button", name="Cancel"))
    job |= {"state": "canceled"}
    expect(page.get_by_role("alert")).to_contain_text("Canceled")
    expect(page.locator("main")).to_be_focused()


def test_the_keyboard_stays_at_a_job_that_is_being_stopped(
    page: Page, done: dict[str, Any]
) -> None:
    here = f"/jobs/{done['id']}"
    job = {**done, "state": "running", "stage": "lamps", "fraction": 0.5}
    canceled: list[str] = []

    def cancel(route: Route) -> None:
        canceled.append(route.request.method)
        job["state"] = "canceling"
        route.fulfill(status=202, json=job)

    page.route(f"**{here}", lambda route: route.fulfill(json=job))
    page.route(f"**{here}/events", lambda route: route.abort())
    page.route(f"**{here}/cancel", cancel)
    page.goto(f"/#{here}")
    button = page.get_by_role("button", name="Cancel")
    tab_to(page, button)
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Separation: stops")).to_be_visible()
    expect(button).to_be_disabled()
    expect(button).to_be_focused()
    page.keyboard.press("Enter")
    page.evaluate(TWO_FRAMES)
    assert canceled == ["POST"]


def test_the_keyboard_stays_with_photographs_that_can_be_canceled_no_longer(page: Page) -> None:
    """All of them are sent; or sent anew, as with another key."""
    page.add_init_script(
        """const send = XMLHttpRequest.prototype.send;
        XMLHttpRequest.prototype.send = function (body) {
          window.sent = (loaded) => this.upload.onprogress({ loaded, total: 2 });
          send.call(this, body);
        };"""
    )
    page.route("**/uploads/*", lambda _: None)
    page.goto("/")
    drop(page, "Without the flash", "1.dng", "2.dng")
    send, cancel = (page.get_by_role("button", name=name) for name in ("Separate", "Cancel"))
    with page.expect_request("**/uploads/*"):
        send.click()
    cancel.focus()
    page.evaluate("window.sent(2)")
    page.evaluate(TWO_FRAMES)
    expect(cancel).to_be_hidden()
    expect(send).to_be_focused()
    page.evaluate("window.sent(1)")
    expect(cancel).to_be_visible()


def test_the_keyboard_stays_at_a_camera_that_goes_away(page: Page) -> None:
    waits: list[Route] = []
    captured: list[Route] = []
    page.add_init_script(PATIENT)
    page.route("**/cameras", lambda route: route.fulfill(json=[{**CAMERA, "state": "idle"}]))
    page.route("**/cameras/events", lambda route: waits.append(route))
    page.route("**/captures", lambda route: captured.append(route))
    with page.expect_request("**/cameras/events"):
        page.goto("/")
    capture = page.get_by_role("button", name="Capture with Nikon D5100")
    tab_to(page, capture)
    body = f"data: {json.dumps([{**CAMERA, 'state': 'away'}])}\n\n"
    waits[0].fulfill(content_type="text/event-stream", body=body)
    expect(capture).to_be_disabled()
    page.evaluate(TWO_FRAMES)
    expect(capture).to_be_focused()
    page.keyboard.press("Enter")
    page.evaluate(TWO_FRAMES)
    assert captured == []
