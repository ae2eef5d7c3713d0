"""What the mixer fetches of a photograph in full size, in a real browser."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Page

LOOK = """async ({ size, room, corner, scale }) => {
  const { Detail } = await import("/page/detail.js");
  const plane = (left, top, width, height) => Uint16Array.from(
    { length: width * height },
    (_, place) => left + (place % width) + 7 * (top + Math.floor(place / width)),
  );
  const asked = [];
  let shown = null;
  const light = { step: 2, size, showDetail: (part) => (shown = part) };
  const detail = new Detail(light, async (left, top, width, height) => {
    asked.push([left, top, width, height]);
    return { width, height, channels: new Map([["lamp1.R", plane(left, top, width, height)]]) };
  });
  const done = await detail.look(room, corner, scale);
  if (!shown) return { done, asked };
  const { width, height, channels } = shown.picture;
  const [left, top] = shown.corner.map((side) => 2 * side);
  const found = channels.get("lamp1.R");
  const wanted = plane(left, top, width, height);
  const alike = String(found) === String(wanted);
  return { done, asked, area: [left, top, width, height], alike };
}"""
"""A Detail looks at a photograph of twice `size`, whose pixels tell where they are."""


@pytest.mark.parametrize(
    ("room", "corner", "area", "heights"),
    [
        ([1280, 800], [-100, -60], [100, 60, 1280, 800], [800]),
        ([2560, 1440], [-100, -60], [100, 60, 2560, 1440], [819, 621]),
        ([3840, 2160], [-100, -60], [100, 60, 3840, 2160], [546, 546, 546, 522]),
        ([3840, 2160], [20, 40], [0, 0, 3820, 2120], [548, 548, 548, 476]),
    ],
)
def test_pixel_by_pixel_a_canvas_of_any_size_is_filled(
    page: Page, room: list[int], corner: list[int], area: list[int], heights: list[int]
) -> None:
    page.goto("/")
    look: dict[str, Any] = {"size": [3000, 2000], "room": room, "corner": corner, "scale": 2}
    found = page.evaluate(LOOK, look)
    assert (found["done"], found["area"], found["alike"]) == (True, area, True)
    left, top, width, _ = area
    tops = [top + sum(heights[:index]) for index in range(len(heights))]
    strips = zip(tops, heights, strict=True)
    assert found["asked"] == [[left, row, width, height] for row, height in strips]
    assert all(width * height <= 2**21 for height in heights)


def test_what_is_smaller_than_the_photograph_is_not_fetched_beyond_the_canvas(page: Page) -> None:
    page.goto("/")
    look: dict[str, Any] = {"size": [3000, 2000], "room": [3840, 2160], "corner": [0, 0]}
    assert page.evaluate(LOOK, {**look, "scale": 1.5}) == {"done": None, "asked": []}
