"""How pictures come to the page, in a real browser on a real service."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page, Route, expect

from tests.integration.service.page.looking import COUNT_KEPT, open_mixer


def test_pictures_come_from_the_service_itself_where_a_store_gives_results(
    page: Page, done: dict[str, Any]
) -> None:
    def results(route: Route) -> None:
        if route.request.headers.get("prefer") == "no-redirect":
            route.continue_()
        else:
            route.fulfill(status=307, headers={"location": "http://store.invalid/a"})

    page.route("**/results/*", results)
    page.goto("/#/jobs")
    expect(page.locator(".thumb img").first).to_be_visible()
    open_mixer(page, done)
    page.get_by_role("radio", name="Unexplained").check(force=True)
    expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    expect(page.get_by_role("alert")).to_have_count(0)


def test_pictures_that_were_shown_are_not_kept_in_memory(page: Page, done: dict[str, Any]) -> None:
    page.add_init_script(COUNT_KEPT)
    page.goto("/#/jobs")
    expect(page.locator(".thumb img").first).to_be_visible()
    expect(page.locator("html")).to_have_attribute("data-kept", "0")
    open_mixer(page, done)
    page.get_by_role("radio", name="Unexplained").check(force=True)
    expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    expect(page.locator("html")).to_have_attribute("data-kept", "0")


def test_a_picture_that_is_on_its_way_is_shown_as_no_broken_one(
    page: Page, done: dict[str, Any]
) -> None:
    held: list[Route] = []
    page.route("**/residual.png", lambda route: held.append(route))
    open_mixer(page, done)
    with page.expect_request("**/residual.png"):
        page.get_by_role("radio", name="Unexplained").check(force=True)
    picture = page.locator(".picture img")
    expect(picture).to_be_attached()
    expect(picture).to_be_hidden()
    held[0].continue_()
    expect(picture).to_be_visible()
    expect(picture).not_to_have_js_property("naturalWidth", 0)
