"""Mixes that are left and found again, in a real browser on a real service."""

from __future__ import annotations

from typing import Any

from playwright.sync_api import Page, expect

from tests.integration.service.page.looking import drawn, open_mixer, strip


def leave(page: Page) -> None:
    page.get_by_role("link", name="Jobs").click()
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()


def test_a_mix_that_was_left_is_found_again(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done)
    strip(page, 1).get_by_role("slider", name="Exposure").fill("-1.5")
    strip(page, 2).get_by_role("radio", name="Gel").check(force=True)
    page.get_by_role("button", name="Solo Lamp 2").click()
    leave(page)
    open_mixer(page, done)
    for _ in range(2):
        expect(strip(page, 1).get_by_role("slider", name="Exposure")).to_have_value("-1.5")
        expect(strip(page, 2).get_by_role("radio", name="Gel")).to_be_checked()
        solo = page.get_by_role("button", name="Solo Lamp 2")
        expect(solo).to_have_attribute("aria-pressed", "true")
        page.reload()
    page.get_by_role("button", name="Reset", exact=True).click()
    page.reload()
    expect(strip(page, 1).get_by_role("slider", name="Exposure")).to_have_value("0")
    expect(solo).to_have_attribute("aria-pressed", "false")


def test_how_much_is_compared_is_found_again(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done)
    compare = page.get_by_role("slider", name="Before")
    expect(compare).to_have_value("0")
    compare.fill("62.5")
    seen = drawn(page).screenshot()
    leave(page)
    open_mixer(page, done)
    for _ in range(2):
        expect(compare).to_have_value("62.5")
        words = "62.5 % of the picture as photographed"
        expect(compare).to_have_attribute("aria-valuetext", words)
        assert drawn(page).screenshot() == seen
        page.reload()


def test_a_browser_that_keeps_no_data_of_sites_has_all_of_the_page(
    page: Page, done: dict[str, Any]
) -> None:
    page.add_init_script(
        """Object.defineProperty(window, "sessionStorage", {
          get() { throw new DOMException("Access is denied for this document.", "SecurityError"); },
        });"""
    )
    open_mixer(page, done)
    exposure = strip(page, 1).get_by_role("slider", name="Exposure")
    exposure.fill("-1.5")
    leave(page)
    page.go_back()
    expect(exposure).to_have_value("-1.5")
    expect(page.get_by_role("alert")).to_have_count(0)


def test_the_way_back_from_a_rendered_mix_shows_it(
    page: Page, service: Any, done: dict[str, Any]
) -> None:
    """But nothing is lost that was left in the mixer meanwhile."""
    wanted = {"lamps": [{"ev": -2, "neutral": True}, {"temperature_k": 2700}], "format": "jpeg"}
    made = service.http.post(f"/jobs/{done['id']}/mix", json=wanted).raise_for_status().json()
    assert service.await_end(made)["state"] == "succeeded"
    open_mixer(page, done)  # and changed nothing there
    exposure = strip(page, 1).get_by_role("slider", name="Exposure")
    back = page.get_by_role("link", name="Back to the mixer")
    for found, left in (("-2", "0.5"), ("0.5", "0.5")):
        page.goto(f"/#/jobs/{made['id']}")
        back.click()
        expect(exposure).to_have_value(found)
        expect(strip(page, 2).get_by_label("Kelvin")).to_be_checked()
        exposure.fill(left)


def test_what_a_full_store_does_not_take_is_not_what_it_was_before(page: Page) -> None:
    page.goto("/")
    kept = """async () => {
      const { keep, kept } = await import("/page/tab.js");
      keep("a", "1");
      Storage.prototype.setItem = () => { throw new DOMException("", "QuotaExceededError"); };
      keep("a", "2");
      return kept("a");
    }"""
    assert page.evaluate(kept) == "2"
