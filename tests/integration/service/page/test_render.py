"""Rendering a mix of the page at full size, in a real browser on a real service."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Locator, Page, Route, expect

from tests.integration.service.page.looking import TWO_FRAMES, open_mixer, strip


@pytest.fixture
def held(page: Page, done: dict[str, Any]) -> list[Route]:
    """An open mixer, whose rendering takes until the test answers."""
    held: list[Route] = []
    file = {"name": "mix.jpg", "size": 1000, "href": "/jobs/mixed/results/mix.jpg"}
    mixed = {**done, "id": "mixed", "files": [file]}
    page.route("**/mix", lambda route: held.append(route))
    page.route("**/jobs/mixed", lambda route: route.fulfill(json=mixed))
    open_mixer(page, done)
    return held


def render(page: Page) -> Locator:
    button = page.get_by_role("button", name="Render full size")
    with page.expect_request("**/mix"):
        button.click()
    return button


def test_a_mix_that_has_changed_since_is_not_handed_out_as_that_on_the_screen(
    page: Page, held: list[Route]
) -> None:
    render(page)
    held[0].fulfill(status=202, json={"id": "mixed"})
    download = page.get_by_role("button", name="Download mix.jpg")
    older = page.get_by_role("link", name="mix.jpg as it was")
    expect(download).to_be_visible()
    expect(older).to_be_hidden()
    exposure = strip(page, 1).get_by_role("slider", name="Exposure")
    exposure.fill("1")
    expect(download).to_be_hidden()
    expect(older).to_have_attribute("href", "#/jobs/mixed")
    exposure.fill("0")
    expect(download).to_be_visible()
    expect(older).to_be_hidden()


def test_a_mix_that_changes_while_it_is_rendered_is_not_that_on_the_screen(
    page: Page, held: list[Route]
) -> None:
    render(page)
    page.get_by_role("button", name="Solo Lamp 2").click()
    held[0].fulfill(status=202, json={"id": "mixed"})
    expect(page.get_by_role("link", name="mix.jpg as it was")).to_be_visible()
    expect(page.get_by_role("button", name="Download mix.jpg")).to_be_hidden()


def test_the_keyboard_stays_at_a_rendering_that_is_under_way(page: Page, held: list[Route]) -> None:
    button = render(page)
    expect(button).to_be_disabled()
    expect(button).to_be_focused()
    page.keyboard.press("Enter")
    page.evaluate(TWO_FRAMES)
    assert len(held) == 1
    held[0].fulfill(status=202, json={"id": "mixed"})
    expect(page.get_by_role("button", name="Download mix.jpg")).to_be_visible()
    expect(button).to_be_enabled()
    expect(button).to_be_focused()
