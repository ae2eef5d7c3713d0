"""The page where there is little room, in a real browser on a real service."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.chromium import find_chromium
from tests.integration.service.page.looking import CAMERA, check_access, drawn, open_mixer, result


def inside(part: Locator, whole: Locator) -> bool:
    inner, outer = part.bounding_box(), whole.bounding_box()
    assert inner is not None and outer is not None
    beside = outer["x"] <= inner["x"]
    beside &= inner["x"] + inner["width"] <= outer["x"] + outer["width"]
    above = outer["y"] <= inner["y"]
    return beside and above and inner["y"] + inner["height"] <= outer["y"] + outer["height"]


@pytest.mark.parametrize("size", [(320, 256), (568, 320)], ids=["enlarged", "small phone across"])
def test_a_mixer_of_little_height_has_a_picture_and_all_buttons(
    page: Page, done: dict[str, Any], size: tuple[int, int]
) -> None:
    """A window of 1280 × 1024 that is enlarged four times, and a phone that is held across."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    picture = open_mixer(page, done)
    box = picture.bounding_box()
    assert box is not None and box["height"] > 150
    for name in ("Show all", "pixel by pixel", "Smaller", "Larger"):
        assert inside(page.get_by_role("button", name=name), page.locator(".picture")), name
    lamp = page.get_by_role("group", name="Lamp 2")
    lamp.get_by_role("slider", name="Exposure").scroll_into_view_if_needed()
    expect(picture).not_to_be_in_viewport(ratio=0.5)  # nor in the way of the lamps
    check_access(page, f"mixer_{size[0]}")


def test_long_words_stay_within_their_boxes(page: Page, done: dict[str, Any], service: Any) -> None:
    page.set_viewport_size({"width": 320, "height": 640})
    word = "w" * 90
    page.route("**/cameras/events", lambda route: route.abort())
    page.route("**/cameras", lambda route: route.fulfill(json=[{**CAMERA, "address": word}]))
    problem = {"type": "x", "title": word, "detail": f"{word}.dng", "status": 422}
    page.route("**/captures", lambda route: route.fulfill(status=422, json=problem))
    page.goto("/")
    page.get_by_role("button", name="Capture").click()
    expect(page.get_by_role("alert")).to_contain_text(word)
    flash, row = page.get_by_label(re.compile("^Flash of")), page.locator(".cameras li")
    assert inside(flash, row)
    assert page.evaluate("document.documentElement.scrollWidth") == 320
    manifest = json.loads(result(service, done, "manifest.json"))
    manifest["warnings"] = [{"code": "clipped", "message": word, "figures": {}}]
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    open_mixer(page, done)
    drawn(page)
    expect(page.get_by_text(word, exact=True)).to_be_attached()
    assert page.evaluate("document.documentElement.scrollWidth") == 320


def test_what_the_keyboard_is_at_does_not_hide_behind_the_picture(
    phone: Page, done: dict[str, Any]
) -> None:
    open_mixer(phone, done)
    phone.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
    exposure = phone.get_by_role("group", name="Lamp 1").get_by_role("slider", name="Exposure")
    exposure.focus()
    stage, focused = phone.locator(".stage").bounding_box(), exposure.bounding_box()
    assert stage is not None and focused is not None
    assert focused["y"] >= stage["y"] + stage["height"]


def test_folds_are_large_enough_for_fingers(phone: Page) -> None:
    phone.goto("/")
    fold = phone.get_by_text("Settings", exact=True)
    box = fold.bounding_box()
    assert box is not None and box["height"] >= 24


def test_text_is_as_large_as_the_browser_is_told_and_fits_a_phone(
    browser: Browser, done: dict[str, Any], service: Any
) -> None:
    """Twice as large: who needs that has set it in the browser, and not on each page."""
    arguments = ["--no-sandbox", "--blink-settings=defaultFontSize=32"]
    large = browser.browser_type.launch(executable_path=find_chromium(), args=arguments)
    page = large.new_page(base_url=service.url, viewport={"width": 360, "height": 740})
    open_mixer(page, done)
    for summary in page.locator("summary").all():
        summary.evaluate("(element) => (element.parentElement.open = true)")
    button = page.get_by_role("button", name="Reset", exact=True)
    for text in (page.locator(".who strong").first, button):
        assert text.evaluate("(element) => getComputedStyle(element).fontSize") == "30px"
    lamp = page.get_by_role("group", name="Lamp 2")
    assert inside(lamp.get_by_role("button", name="Solo"), lamp)
    assert inside(lamp.get_by_role("slider", name="Exposure"), lamp)
    width = "document.documentElement.scrollWidth"
    assert page.evaluate(width) == 360
    page.get_by_role("link", name="Jobs").click()
    card = page.locator(".jobs li").first
    assert inside(card.locator("strong"), card)
    assert page.evaluate(width) == 360
    page.get_by_role("link", name="New").click()
    expect(page.get_by_role("button", name="Separate the light")).to_be_visible()
    assert page.evaluate(width) == 360
    large.close()
