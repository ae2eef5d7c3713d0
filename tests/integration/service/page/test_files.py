"""Saving files of a job, in a real browser on a real service."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from playwright.sync_api import Page, Route, expect

from tests.integration.service.page.looking import give_key, open_mixer, result


def open_files(page: Page, job: dict[str, Any]) -> None:
    open_mixer(page, job)
    page.get_by_text("Files", exact=True).click()


def test_all_files_are_fetched_once_at_a_time(page: Page, done: dict[str, Any]) -> None:
    """With a key, with which the page fetches them itself."""
    held: list[Route] = []

    give_key(page)
    page.route("**/results.zip", lambda route: held.append(route))
    open_files(page, done)
    everything = page.get_by_role("button", name="Download all")
    with page.expect_request("**/results.zip"):
        everything.click()
    expect(everything).to_contain_text("on its way")
    expect(everything).to_be_focused()
    everything.evaluate("(button) => button.click()")
    with page.expect_download() as saved:
        for route in held:
            route.fulfill(body=b"PK", content_type="application/zip")
    assert Path(saved.value.path()).read_bytes() == b"PK"
    expect(everything).not_to_contain_text("on its way")
    assert len(held) == 1
    with page.expect_request("**/results.zip"):
        everything.click()


def test_a_file_that_breaks_off_is_told_in_words(page: Page, done: dict[str, Any]) -> None:
    """A route can break off no body: reading it fails as it does then."""
    open_files(page, done)
    page.evaluate(
        """() => {
          for (const method of ["blob", "arrayBuffer"]) {
            Response.prototype[method] = () => Promise.reject(new TypeError("Failed to fetch"));
          }
        }"""
    )
    page.get_by_role("button", name="gamma.png").click()
    alert = page.locator(".files").get_by_role("alert")
    expect(alert).to_contain_text("No connection")
    expect(alert).to_contain_text("check that it runs and that this device is on its network")
    page.get_by_role("radio", name="Unexplained").check(force=True)
    expect(page.locator(".picture").get_by_role("alert")).to_contain_text("No connection")


def test_a_file_of_a_store_does_not_replace_the_page(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    """A store's answer is shown where its headers say inline, so the page asks for none.

    No route sees what a link with `download` asks for, but one sees what the page fetches.
    """

    def results(route: Route) -> None:
        if route.request.headers.get("prefer") == "no-redirect":
            asked.append(route.request.url.rpartition("/")[2])
            route.continue_()
        else:
            route.fulfill(status=307, headers={"location": "http://store.invalid/a"})

    asked: list[str] = []
    page.route("**/results/*", results)
    open_files(page, done)
    assert "residual.png" not in asked
    with page.expect_download() as saved:
        page.get_by_role("button", name="residual.png").click()
    assert saved.value.suggested_filename == "residual.png"
    assert Path(saved.value.path()).read_bytes() == result(service, done, "residual.png")
    assert "residual.png" in asked
    expect(page.locator("#mix")).to_be_visible()
