"""A graphics card that is taken from the page and given back, in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.integration.service.page.looking import (
    FACING,
    TWO_FRAMES,
    drawn,
    halve_preview,
    open_mixer,
    open_normals,
    shown,
)
from tests.integration.service.page.test_drawing import UNTOLD

LOSE = """(canvas) => new Promise((done) => {
  const lose = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
  canvas.addEventListener("webglcontextrestored", () => done(true));
  canvas.addEventListener("webglcontextlost", (event) => {
    if (!event.defaultPrevented) done(false);
    else setTimeout(() => lose.restoreContext());
  });
  lose.loseContext();
})"""
"""Whether a canvas that loses its context would have it back, and has it."""


@pytest.fixture
def card(page: Page) -> Page:
    """A page that draws by WebGL."""
    page.add_init_script(f"({UNTOLD})()")
    return page


def test_the_mixer_comes_back(
    card: Page, done: dict[str, Any], service: Any, tmp_path: Path
) -> None:
    """With its detail: the preview is given half as large as the photograph."""
    size = halve_preview(card, service, done, tmp_path)
    canvas = open_mixer(card, done)
    before = shown(card, size)
    assert before.std() > 1
    assert canvas.evaluate(LOSE)
    drawn(card)
    assert np.array_equal(shown(card, size), before)


def test_normals_come_back(page: Page, done: dict[str, Any], tmp_path: Path) -> None:
    slopes = np.linspace(-0.7, 0.7, 90, dtype=np.float32)
    normals = np.stack([slopes, 0 * slopes, np.sqrt(1 - slopes**2)], -1)
    whole = np.ascontiguousarray(np.broadcast_to(normals, (60, 90, 3)))
    canvas = open_normals(page, done, whole, tmp_path)
    before = canvas.screenshot()
    assert canvas.evaluate(LOSE)
    page.evaluate(TWO_FRAMES)
    assert canvas.screenshot() == before


@pytest.mark.parametrize("view", ["#mix", "#normals"])
def test_a_view_that_is_left_gives_the_card_back(
    card: Page, done: dict[str, Any], tmp_path: Path, view: str
) -> None:
    """Not when the browser thinks of it: a card has room for few views, a browser for 16."""
    if view == "#mix":
        canvas = open_mixer(card, done)
    else:
        canvas = open_normals(card, done, FACING, tmp_path)
    context = canvas.evaluate_handle("(canvas) => canvas.getContext('webgl2')")
    assert context.evaluate("(context) => context.isContextLost()") is False
    card.get_by_role("link", name="Jobs").click()
    expect(card.get_by_role("heading", name="Jobs")).to_be_visible()
    assert context.evaluate("(context) => context.isContextLost()") is True
