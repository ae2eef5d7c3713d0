"""What the browser's tab is called, in a real browser on a real service."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page, expect


def test_every_view_has_its_title(page: Page, done: dict[str, Any]) -> None:
    gone = {"type": "x", "title": "No such job", "detail": "It is gone.", "status": 404}
    page.route("**/jobs/gone", lambda route: route.fulfill(status=404, json=gone))
    page.goto("/")
    expect(page).to_have_title("Add two photographs · lightlayers")
    page.get_by_role("link", name="Jobs").click()
    expect(page).to_have_title("Jobs · lightlayers")
    page.goto("/#/jobs/gone")
    expect(page).to_have_title("No such job · lightlayers")
    page.goto(f"/#/jobs/{done['id']}")
    expect(page).to_have_title(f"Done: Separation {done['id'][:8]} · lightlayers")
    page.get_by_role("link", name="New").click()
    expect(page).to_have_title("Add two photographs · lightlayers")


def test_the_title_of_a_job_follows_its_state(page: Page, done: dict[str, Any]) -> None:
    job = {**done, "id": "0123456789abcdef", "state": "running", "stage": "lamps", "fraction": 0.5}
    page.route("**/events", lambda route: route.fulfill(body=""))  # the page asks instead
    page.route("**/jobs/0123456789abcdef", lambda route: route.fulfill(json=job))
    page.goto("/#/jobs/0123456789abcdef")
    expect(page).to_have_title("Runs: Separation 01234567 · lightlayers")
    job["state"] = "waiting_for_operator"
    expect(page).to_have_title("Waits for you: Separation 01234567 · lightlayers")
    job["state"] = "canceled"
    expect(page).to_have_title("Canceled: Separation 01234567 · lightlayers")


def test_an_address_of_nothing_adds_photographs(page: Page) -> None:
    page.goto("/#/nothing")
    expect(page.get_by_role("button", name="Separate the light")).to_be_visible()
    expect(page.locator("nav a[aria-current]")).to_have_text("New")
