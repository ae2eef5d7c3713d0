"""What tests do with the page again and again."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Locator, Page, Route, expect

from pipeline.arrays import Floats32
from pipeline.encode.exr import ExrFile
from pipeline.encode.png import NormalsPng
from tests.layers import layers_of, planes_of

SHOTS = Path(__file__).parents[4] / "build" / "page"
"""Where the tests leave what they have seen."""

PATIENCE_MS = 120_000

CAMERA: dict[str, Any] = {
    "id": "c1",
    "address": "ptp+usb://",
    "make": "Nikon",
    "model": "D5100",
    "serial": "1",
    "state": "capturing",
    "battery_percent": None,
    "free_bytes": None,
    "holder": None,
    "waiting": 0,
}
"""A busy camera as the service tells it."""

FACING = np.tile(np.array([0, 0, 1], np.float32), (60, 90, 1))
"""Surface normals (h, W, 3) that all look at the camera."""

TWO_FRAMES = """() => new Promise((done) => {
  requestAnimationFrame(() => requestAnimationFrame(() => done(true)));
})"""
"""What was drawn before the first of them is on the screen with the second."""

PATIENT = """
  const later = setTimeout;
  setTimeout = (work, time) => (time >= 1000 ? 0 : later(work, time));
"""
"""A page that waits for ever: it neither takes a slow answer for none nor asks again."""

HIDE = """(hidden) => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""
"""Tells a page that its tab is hidden, or seen again: a browser without a screen hides none."""

USE = """(used) => {
  document.hasFocus = () => used;
  dispatchEvent(new Event(used ? "focus" : "blur"));
}"""
"""Tells a page that its window is used, or another one: to each of a browser without a screen
it is its own."""

COUNT_KEPT = """
  const kept = new Set();
  const make = URL.createObjectURL.bind(URL);
  const free = URL.revokeObjectURL.bind(URL);
  const tell = () => (document.documentElement.dataset.kept = kept.size);
  URL.createObjectURL = (what) => {
    const url = make(what);
    kept.add(url);
    tell();
    return url;
  };
  URL.revokeObjectURL = (url) => {
    kept.delete(url);
    tell();
    free(url);
  };
"""
"""Tells in data-kept how many pictures and files the page keeps in memory by their URLs."""


def open_mixer(page: Page, job: dict[str, Any]) -> Locator:
    page.goto(f"/#/jobs/{job['id']}")
    return drawn(page)


def open_normals(page: Page, job: dict[str, Any], normals: Floats32, folder: Path) -> Locator:
    """The drawn canvas of a job's surface normals (h, W, 3), which had none; folder: for its file.

    Unit vectors, NaN where unknown.
    """
    height, width = normals.shape[:2]
    png = NormalsPng(folder / "normals.png", (width, height))
    png.write(normals)
    png.close()
    choose_normals(page, job, (folder / "normals.png").read_bytes())
    return drawn(page, "#normals")


def choose_normals(page: Page, job: dict[str, Any], png: bytes) -> None:
    """Look at the surface normals of a job, which had none."""
    file = {"name": "normals.png", "size": 1, "sha256": "", "media_type": "image/png", "href": ""}
    more = {**job, "files": [*job["files"], file]}
    page.route(f"**/jobs/{job['id']}", lambda route: route.fulfill(json=more))
    page.route("**/normals.png", lambda route: route.fulfill(body=png))
    open_mixer(page, job)
    page.get_by_role("radio", name="Normals").check(force=True)


def halve_preview(page: Page, service: Any, job: dict[str, Any], folder: Path) -> tuple[int, int]:
    """Give a page a preview half as large as the photograph, whose size; folder: for its file."""
    layers = layers_of(planes_of(result(service, job, "layers.exr")), 2)
    size = layers.shape[2], layers.shape[1]
    halved = layers.reshape(2, size[1] // 2, 2, size[0] // 2, 2, 3).mean((2, 4))
    file = ExrFile(folder / "preview.exr", (size[0] // 2, size[1] // 2), half=True)
    sure = np.ones(halved.shape[1:3], np.float32)
    file.write({"lamp1": halved[0], "lamp2": halved[1], "Y": sure})
    file.close()
    page.route("**/preview.exr", lambda route: route.fulfill(path=folder / "preview.exr"))
    return size


def drawn(page: Page, name: str = "#mix") -> Locator:
    """The canvas once what it shows is exact."""
    canvas = page.locator(name)
    expect(canvas).to_have_attribute("aria-busy", "false")
    page.evaluate(TWO_FRAMES)
    return canvas


def shown(page: Page, size: tuple[int, int]) -> NDArray[np.int64]:
    """What of a picture of this size (width, height) is on the screen, pixel by pixel."""
    page.get_by_role("button", name="pixel by pixel").click()
    canvas = drawn(page)
    pixels = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    left, top = ((pixels.shape[1 - axis] - size[axis] + 1) // 2 for axis in (0, 1))  # as the page
    return np.asarray(pixels[top : top + size[1], left : left + size[0]])


def strip(page: Page, lamp: int) -> Locator:
    return page.get_by_role("group", name=f"Lamp {lamp}")


def tab_to(page: Page, wanted: Locator) -> None:
    """Go to an element by the tab key alone."""
    wanted.wait_for()
    for _ in range(60):
        if wanted.evaluate("(element) => element === document.activeElement"):
            return
        page.keyboard.press("Tab")
    pytest.fail("no way there by the tab key")


def drop(page: Page, zone: str, *names: str) -> None:
    """Drop files of these names at a place for a photograph."""
    dropped = page.evaluate_handle(
        """(names) => {
          const data = new DataTransfer();
          for (const name of names) data.items.add(new File(["?"], name));
          return data;
        }""",
        names,
    )
    region = page.get_by_role("region", name=zone, exact=True)
    region.dispatch_event("drop", {"dataTransfer": dropped})


def result(service: Any, job: dict[str, Any], name: str) -> bytes:
    found: bytes = service.http.get(f"/jobs/{job['id']}/results/{name}").raise_for_status().content
    return found


_RULES = {"rules": {"label-content-name-mismatch": {"enabled": True}}}
"""More than axe-core looks for by itself: a name that is spoken has to hold what is read."""


def check_access(page: Page, name: str) -> None:
    """Look for what keeps people out; leave a picture of it."""
    page.screenshot(path=SHOTS / f"{name}.png")
    found = Axe().run(page, options=_RULES).response["violations"]
    assert [(one["id"], one["nodes"][0]["html"]) for one in found] == []


def give_key(page: Page) -> None:
    """Have the page fetch with a key what a service without keys gives."""

    def guard(route: Route) -> None:
        headers = route.request.headers
        headers.pop("authorization", None)  # which the service itself refuses
        route.continue_(headers=headers)

    page.add_init_script("sessionStorage.setItem('lightlayers-key', 'x')")
    page.route("**/jobs/**", guard)
