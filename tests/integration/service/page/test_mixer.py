"""What the mixer takes for its own and what it leaves, in a real browser on a real service."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import FilePayload, Locator, Page, expect

from tests.integration.service.page.looking import (
    FACING,
    TWO_FRAMES,
    choose_normals,
    drawn,
    open_mixer,
    open_normals,
    result,
    strip,
)

COUNT_DRAWN = """(canvas) => {
  window.drawn = 0;
  Object.defineProperty(canvas, "isConnected", { get: () => (window.drawn++, false) });
}"""
"""Counts in window.drawn how often it was meant to draw on a canvas."""


@pytest.fixture
def normals(page: Page, done: dict[str, Any], tmp_path: Path) -> Locator:
    """The canvas, drawn, of a job as if it had found normals, all of which look at the camera."""
    return open_normals(page, done, FACING, tmp_path)


def leave_and_change_colours(page: Page) -> int:
    """How often it was drawn on the canvas of COUNT_DRAWN after the result was left."""
    page.evaluate("location.hash = '#/jobs'")
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    page.evaluate(TWO_FRAMES)  # the observer of its size is told that it went
    page.evaluate("window.drawn = 0")
    page.emulate_media(color_scheme="light")
    page.evaluate(TWO_FRAMES)
    return int(page.evaluate("window.drawn"))


def test_a_mixer_that_is_left_follows_the_colours_no_longer(
    page: Page, done: dict[str, Any]
) -> None:
    open_mixer(page, done).evaluate(COUNT_DRAWN)
    assert leave_and_change_colours(page) == 0


def test_normals_that_are_left_follow_the_colours_no_longer(page: Page, normals: Locator) -> None:
    normals.evaluate(COUNT_DRAWN)
    assert leave_and_change_colours(page) == 0


def test_normals_that_cannot_be_read_are_told_of_and_waited_for_no_longer(
    page: Page, done: dict[str, Any]
) -> None:
    choose_normals(page, done, b"no picture")
    page.get_by_role("alert").click()  # which nothing lies before
    expect(page.locator("#normals")).not_to_have_attribute("aria-busy", "true")


@pytest.mark.parametrize(("convention", "up"), [("gl", 1), ("dx", -1)])
def test_normals_of_both_conventions_are_lit_from_above(
    page: Page, done: dict[str, Any], service: Any, tmp_path: Path, convention: str, up: int
) -> None:
    """Those of a roll that lies from left to right."""
    y = np.linspace(0.7, -0.7, 60)[:, None] * np.ones((60, 90))
    roll = np.stack([0 * y, up * y, np.sqrt(1 - y * y)], -1).astype(np.float32)
    manifest = json.loads(result(service, done, "manifest.json"))
    manifest["options"]["normals"] = convention
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    canvas = open_normals(page, done, roll, tmp_path)
    canvas.hover(position={"x": 200, "y": 2})
    page.evaluate(TWO_FRAMES)
    grey = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("L")).astype(float)
    upper, lower = np.array_split(grey, 2)
    assert upper.mean() > 1.5 * lower.mean()


@pytest.mark.parametrize("width", [104, 4108], ids=["enlarged", "made smaller"])
def test_normals_have_no_rim_where_they_end(
    page: Page, done: dict[str, Any], tmp_path: Path, width: int
) -> None:
    """Between one and none lies no direction: those that were shown there nobody had found."""
    stripes = np.tile(np.array([0, 0, 1], np.float32), (60, width, 1))
    stripes[:, np.arange(width) // 13 % 2 == 1] = np.nan
    canvas = open_normals(page, done, stripes, tmp_path)
    canvas.hover(position={"x": 20, "y": 400})
    page.evaluate(TWO_FRAMES)
    grey = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("L"))
    row = grey[len(grey) // 2]
    assert len(set(row.tolist())) == 2  # of what is lit, and of what is around
    assert np.mean(row == row.max()) == pytest.approx(0.5, abs=0.05)


def test_what_is_shown_follows_the_colours(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done).evaluate(COUNT_DRAWN)
    page.evaluate(TWO_FRAMES)  # a frame that was asked for before
    page.evaluate("window.drawn = 0")
    page.emulate_media(color_scheme="light")
    page.evaluate(TWO_FRAMES)
    assert page.evaluate("window.drawn") == 1


TAKEN = """(canvas) => {
  window.taken = [];
  addEventListener("keydown", (event) => window.taken.push(event.defaultPrevented));
  canvas.focus();
}"""
"""Notes in window.taken of each key whether the canvas took it from the browser."""


@pytest.mark.parametrize(
    ("view", "keys"),
    [("#mix", ["+", "0", "1", "ArrowLeft"]), ("#normals", ["ArrowLeft", "ArrowUp"])],
)
def test_keys_with_another_are_left_to_the_browser(
    page: Page, normals: Locator, view: str, keys: list[str]
) -> None:
    expect(normals).to_be_visible()
    if view == "#mix":
        page.get_by_role("radio", name="Mix", exact=True).check(force=True)
    page.locator(view).evaluate(TAKEN)
    send = """([view, key, held]) => document.querySelector(view).dispatchEvent(
      new KeyboardEvent("keydown", { key, [held]: true, bubbles: true, cancelable: true }),
    )"""
    for key in keys:
        for held in ("ctrlKey", "metaKey", "altKey", "shiftKey"):
            page.evaluate(send, [view, key, held])
    assert page.evaluate("window.taken") == [False, False, False, True] * len(keys)


def test_two_warnings_of_the_same_places_are_shown_and_hidden_together(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    manifest = json.loads(result(service, done, "manifest.json"))
    told = [("flash_too_weak", "The flash is weak."), ("clipped", "The picture is clipped.")]
    manifest["warnings"] = [{"code": code, "message": words, "figures": {}} for code, words in told]
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    canvas = open_mixer(page, done)
    plain = canvas.screenshot()
    weak, clipped = (page.get_by_role("button", name=f"Show where: {words}") for _, words in told)
    for button, pressed in ((weak, "true"), (clipped, "false"), (clipped, "true"), (weak, "false")):
        button.click()
        expect(weak).to_have_attribute("aria-pressed", pressed)
        expect(clipped).to_have_attribute("aria-pressed", pressed)
        drawn(page)
        assert (canvas.screenshot() == plain) is (pressed == "false")


CONTRASTS = """(strip) => {
  const codes = (colour) => colour.match(/[0-9.]+/g).slice(0, 3).map(Number);
  const curve = (value) => (value <= 0.04 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
  const linear = (code) => curve(code / 255);
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);
  const ground = codes(getComputedStyle(strip.closest(".controls")).backgroundColor);
  return [...strip.querySelectorAll(".who *, .slider span")].map((one) => {
    let opacity = 1;
    for (let part = one; part; part = part.parentElement) opacity *= getComputedStyle(part).opacity;
    const ink = codes(getComputedStyle(one).color);
    const seen = ink.map((code, index) => opacity * code + (1 - opacity) * ground[index]);
    const [dark, light] = [luminance(seen), luminance(ground)].sort((a, b) => a - b);
    return (light + 0.05) / (dark + 0.05);
  });
}"""
"""The contrasts of all words of a strip, as WCAG has them."""


def test_a_lamp_that_is_off_can_be_read(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done)
    page.get_by_role("button", name="Lamp 1 on").click()
    schemes: list[Literal["dark", "light"]] = ["dark", "light"]
    for scheme in schemes:
        page.emulate_media(color_scheme=scheme)
        contrasts = strip(page, 1).evaluate(CONTRASTS)
        assert len(contrasts) == 4
        assert min(contrasts) >= 4.5  # AA


def pixels(element: Locator) -> NDArray[np.int64]:
    """Codes of an element on the screen."""
    return np.asarray(Image.open(io.BytesIO(element.screenshot())).convert("RGB")).astype(int)


@pytest.mark.parametrize("change", ["Exposure", "Solo", "Reset", "preset", "Render full size"])
@pytest.mark.parametrize("view", ["Lamp 2", "Unexplained"])
def test_whatever_is_looked_at_a_change_shows_the_mix(
    page: Page, done: dict[str, Any], view: str, change: str
) -> None:
    page.route("**/mix", lambda route: route.abort())
    open_mixer(page, done)
    look = page.get_by_role("radio", name=view, exact=True)
    look.check(force=True)
    if change == "Exposure":
        strip(page, 1).get_by_role("slider", name="Exposure").fill("-1")
    elif change == "Solo":
        page.get_by_role("button", name="Solo Lamp 1").click()
    elif change == "preset":
        preset = json.dumps({"lamps": [{"ev": 1}, {"ev": -1}]}).encode()
        file: FilePayload = {"name": "a.json", "mimeType": "", "buffer": preset}
        page.get_by_label("Load preset").set_input_files(file)
    else:
        page.get_by_role("button", name=change, exact=True).click()
    expect(page.get_by_role("radio", name="Mix", exact=True)).to_be_checked()
    found = pixels(drawn(page))
    look.check(force=True)
    page.get_by_role("radio", name="Mix", exact=True).check(force=True)
    # without a graphics card the lamp that changed last is added last: sums differ by rounding
    assert np.abs(found - pixels(drawn(page))).max() <= 1


def test_a_menu_that_takes_the_end_of_a_drag_leaves_the_picture(
    page: Page, done: dict[str, Any]
) -> None:
    canvas = open_mixer(page, done)
    for _ in range(6):
        page.get_by_role("button", name="Larger").click()
    seen = drawn(page).screenshot()
    box = canvas.bounding_box()
    assert box is not None
    page.evaluate(
        """() => document.querySelector("#mix").addEventListener(
          "pointerup", (event) => event.stopImmediatePropagation(), { capture: true })"""
    )
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down(button="right")
    page.mouse.up(button="right")
    page.mouse.move(box["x"] + 240, box["y"] + 230)
    page.evaluate(TWO_FRAMES)
    assert drawn(page).screenshot() == seen


NOTE_ASKED = """
  const ask = matchMedia;
  window.asked = [];
  matchMedia = (query) => {
    asked.push(ask(query));
    return asked.at(-1);
  };
"""
"""Notes in window.asked what the page asks of the screen."""
TELL_CHANGED = """() => {
  for (const one of asked.filter(({ media }) => media.includes("resolution"))) {
    if (!one.matches) one.dispatchEvent(new Event("change"));
  }
}"""
"""Tells a page that its screen has other pixels, which a browser without a screen does not."""


@pytest.mark.parametrize("view", ["#mix", "#normals"])
def test_a_screen_of_finer_pixels_shows_them(
    page: Page, done: dict[str, Any], tmp_path: Path, view: str
) -> None:
    """As after a window has moved to another screen, where its size on the page stays."""
    page.add_init_script(NOTE_ASKED)
    open_normals(page, done, FACING, tmp_path)
    if view == "#mix":
        page.get_by_role("radio", name="Mix", exact=True).check(force=True)
    drawn(page, view)
    devtools = page.context.new_cdp_session(page)
    screen = {"width": 1280, "height": 800, "mobile": False}
    for ratio in (2, 1.5, 1):
        devtools.send("Emulation.setDeviceMetricsOverride", {**screen, "deviceScaleFactor": ratio})
        page.evaluate(TELL_CHANGED)
        width = page.locator(view).evaluate("(canvas) => canvas.clientWidth")
        expect(page.locator(view)).to_have_js_property("width", round(ratio * width))


COUNT_CLOSED = """
  window.freed = 0;
  const close = ImageBitmap.prototype.close;
  ImageBitmap.prototype.close = function () {
    window.freed++;
    close.call(this);
  };
"""
"""Counts in window.freed the pictures of which the memory was given back."""


def test_pictures_of_normals_are_given_back(
    page: Page, done: dict[str, Any], tmp_path: Path
) -> None:
    """That of full size once there is a smaller one, and that with the view."""
    page.add_init_script(COUNT_CLOSED)
    open_normals(page, done, FACING, tmp_path)
    assert page.evaluate("window.freed") == 1
    page.get_by_role("link", name="Jobs").click()
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    assert page.evaluate("window.freed") == 2


def test_a_small_picture_pixel_by_pixel_does_not_become_larger_by_the_button_for_smaller(
    page: Page, done: dict[str, Any]
) -> None:
    canvas = open_mixer(page, done)
    whole = canvas.screenshot()
    page.get_by_role("button", name="pixel by pixel").click()
    seen = drawn(page).screenshot()
    assert seen != whole
    page.get_by_role("button", name="Smaller").click()
    assert drawn(page).screenshot() == seen
    page.get_by_role("button", name="Larger").click()
    assert drawn(page).screenshot() not in (seen, whole)
    page.get_by_role("button", name="Show all").click()
    assert drawn(page).screenshot() == whole


def test_a_picture_that_comes_at_last_is_without_the_alarm_before_it(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    manifest = json.loads(result(service, done, "manifest.json"))
    manifest["warnings"] = [{"code": "unexplained", "message": "Look there.", "figures": {}}]
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    page.route("**/residual.png", lambda route: route.abort())
    open_mixer(page, done)
    where = page.get_by_role("button", name="Show where: Look there.")
    alerts = page.get_by_role("alert")
    for _ in range(2):
        with page.expect_event("requestfailed", lambda one: one.url.endswith("/residual.png")):
            where.click()
        expect(alerts).to_have_count(1)
    page.unroute("**/residual.png")
    where.click()
    expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    expect(alerts).to_have_count(0)
