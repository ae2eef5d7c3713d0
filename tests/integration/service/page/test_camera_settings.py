"""The settings of a camera on the page, in a real browser."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from tests.integration.service.page.looking import CAMERA


@pytest.fixture
def settings(page: Page) -> dict[str, Any]:
    """Those of a camera that takes what is chosen."""
    told: dict[str, Any] = {
        "iso": {"value": 125, "choices": [100, 200, 400], "writable": True},
        "f_number": {"value": 4, "choices": [2.8, 4, 5.6], "writable": True},
    }

    def change(route: Route) -> None:
        for key, value in (route.request.post_data_json or {}).items():
            told[key]["value"] = value
        route.fulfill(json=told)

    camera = {**CAMERA, "state": "idle"}
    page.route("**/cameras", lambda route: route.fulfill(json=[camera]))
    page.route("**/cameras/events", lambda route: route.abort())
    page.route("**/cameras/c1/settings", change)
    page.goto("/")
    page.get_by_text("Settings", exact=True).click()
    return told


def test_the_keyboard_stays_at_a_setting_that_was_changed(
    page: Page, settings: dict[str, Any]
) -> None:
    page.get_by_label("f-number").focus()
    page.keyboard.press("ArrowDown")
    expect(page.get_by_role("status")).to_have_text("f-number is 5.6.")
    expect(page.get_by_label("f-number")).to_be_focused()
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("status")).to_have_text("f-number is 4.")
    assert settings["f_number"]["value"] == 4


def test_the_keyboard_stays_at_the_settings_where_one_is_locked(
    page: Page, settings: dict[str, Any]
) -> None:
    page.get_by_label("f-number").focus()
    settings["f_number"]["writable"] = False
    page.keyboard.press("ArrowDown")
    expect(page.get_by_text("f-number: 5.6")).to_be_visible()
    expect(page.locator("summary", has_text="Settings")).to_be_focused()


def test_a_value_that_cannot_be_chosen_is_shown_as_it_is(
    page: Page, settings: dict[str, Any]
) -> None:
    iso = page.get_by_label("ISO")
    shown = iso.evaluate("(select) => [...select.options].map((one) => [one.text, one.disabled])")
    assert shown == [["125", True], ["100", False], ["200", False], ["400", False]]
    assert iso.evaluate("(select) => select.selectedOptions[0].text") == "125"
    iso.select_option("100")
    expect(page.get_by_role("status")).to_have_text("ISO is 100.")
    assert settings["iso"]["value"] == 100
    expect(iso.locator("option")).to_have_text(["100", "200", "400"])
