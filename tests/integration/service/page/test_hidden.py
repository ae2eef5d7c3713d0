"""Tabs that are hidden, and windows that are not used, in a real browser on a real service."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page, expect

from tests.integration.service.page.looking import CAMERA, HIDE, USE


def test_hidden_tabs_leave_connections_to_others(page: Page) -> None:
    """A browser has six to a service without TLS, which a stream of events in each would take."""
    capture = "Capture with NIKON D5100"
    for _ in range(6):
        tab = page.context.new_page()
        with tab.expect_response("**/cameras/events"):
            tab.goto("/")
        tab.evaluate(HIDE, True)
    page.goto("/")
    expect(page.get_by_role("button", name=capture)).to_be_visible()


def test_windows_that_are_not_used_leave_connections_to_others(
    page: Page, service: Any, unending: dict[str, Any]
) -> None:
    """Six of them are seen, as on a large screen, and follow the job all the same."""
    here = f"/jobs/{unending['id']}"
    tabs = [page.context.new_page() for _ in range(6)]
    for tab in tabs:
        with tab.expect_response("**/events"):
            tab.goto(f"/#{here}")
        tab.evaluate(USE, False)
    page.goto("/")
    capture = page.get_by_role("button", name="Capture with NIKON D5100")
    expect(capture).to_be_visible()
    with tabs[0].expect_response("**/events"):
        tabs[0].evaluate(USE, True)
    service.http.post(f"{here}/cancel").raise_for_status()
    for tab in tabs:
        expect(tab.get_by_role("alert")).to_contain_text("Canceled")


def test_cameras_are_kept_up_with_in_a_window_that_is_not_used(page: Page) -> None:
    page.route("**/cameras/events", lambda _: None)
    with page.expect_request("**/cameras/events"):
        page.goto("/")
    page.evaluate(USE, False)
    page.route("**/cameras", lambda route: route.fulfill(json=[CAMERA]))
    expect(page.locator(".cameras li")).to_contain_text("Takes photographs")


def test_a_hidden_tab_follows_a_job_by_its_title_and_takes_its_events_again(
    page: Page, service: Any, unending: dict[str, Any]
) -> None:
    here = f"/jobs/{unending['id']}"
    with page.expect_response("**/events"):
        page.goto(f"/#{here}")
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    page.evaluate(HIDE, True)
    with page.expect_response(f"**{here}"):  # it is asked for, not once alone
        pass
    with page.expect_response(f"**{here}"):
        pass
    with page.expect_response("**/events"):
        page.evaluate(HIDE, False)
    page.evaluate(HIDE, True)
    service.http.post(f"{here}/cancel").raise_for_status()
    expect(page).to_have_title(f"Canceled: Separation {unending['id'][:8]} · lightlayers")


def test_cameras_are_followed_again_by_a_tab_that_is_seen_again(page: Page) -> None:
    with page.expect_response("**/cameras/events"):
        page.goto("/")
    with page.expect_event("requestfailed", lambda one: one.url.endswith("/cameras/events")):
        page.evaluate(HIDE, True)
    with page.expect_response("**/cameras/events"):
        page.evaluate(HIDE, False)
