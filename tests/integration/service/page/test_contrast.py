"""The page in a contrast theme of the system, in a real browser."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Locator, Page

from tests.integration.service.page.looking import SHOTS, open_mixer


def ground(element: Locator) -> list[int]:
    """The colour of most of an element."""
    pixels = np.asarray(Image.open(io.BytesIO(element.screenshot())).convert("RGB"))
    colours, counts = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
    return [int(code) for code in colours[np.argmax(counts)]]


def test_what_is_chosen_can_be_told_in_a_contrast_theme(page: Page, done: dict[str, Any]) -> None:
    page.emulate_media(forced_colors="active")
    open_mixer(page, done)
    on = page.get_by_role("button", name="Lamp 1 on")
    page.get_by_role("button", name="Lamp 2 on").click()
    off = page.get_by_role("button", name="Lamp 2 on")
    chosen, other = (
        page.locator(".bar label", has_text=name).locator("span") for name in ("Mix", "Unexplained")
    )
    highlight = ground(on)
    assert ground(chosen) == highlight
    assert ground(off) == ground(other) != highlight
    page.screenshot(path=SHOTS / "contrast.png")
    chips = page.locator(".chip")
    assert ground(chips.nth(0)) != ground(chips.nth(1))
    page.get_by_role("link", name="Jobs").click()
    nav = page.get_by_role("navigation")
    assert ground(nav.get_by_role("link", name="Jobs")) == highlight
    assert ground(nav.get_by_role("link", name="New")) != highlight
