"""What the mixer fetches of a photograph in full size, in a real browser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from pipeline.encode.jpeg import to_srgb8

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


TRY = """async (statuses) => {
  const { Detail } = await import("/page/detail.js");
  const { Problem } = await import("/page/api.js");
  const told = [];
  const later = [];
  window.setTimeout = (work) => later.push(work);
  const light = { step: 2, size: [300, 200], showDetail: () => told.push("shown") };
  light.draw = () => told.push("drawn");
  const detail = new Detail(light, async (left, top, width, height) => {
    told.push("asked");
    const status = statuses.shift();
    if (status !== 200) throw new Problem({ title: "x", detail: "x", status });
    return { width, height, channels: new Map() };
  });
  const look = () => detail.look([200, 200], [0, 0], 2);
  while (statuses.length) {
    await look();
    if (look()) told.push("asked at once");
    if (!later.length) break;
    later.shift()();
  }
  if (look()) told.push("asked still");
  return told;
}"""
"""A Detail looks again and again while the service answers with these statuses."""


@pytest.mark.parametrize(
    ("statuses", "told"),
    [
        ([200], ["asked", "shown"]),
        ([0, 503, 200], ["asked", "drawn", "asked", "drawn", "asked", "shown"]),
        ([500, 200], ["asked", "drawn", "asked", "shown"]),
        ([404, 200], ["asked"]),
        ([422, 200], ["asked"]),
        ([0, 410, 200], ["asked", "drawn", "asked"]),
    ],
)
def test_what_fails_for_now_is_fetched_later_and_what_is_refused_is_not(
    page: Page, statuses: list[int], told: list[str]
) -> None:
    page.goto("/")
    assert page.evaluate(TRY, statuses) == told


SUPERSEDE = """async () => {
  const { Detail } = await import("/page/detail.js");
  const shown = [];
  const held = [];
  const light = { step: 2, size: [3000, 2000], showDetail: (part) => shown.push(part.corner) };
  const detail = new Detail(light, (left, top, width, height) => new Promise((done, fail) => {
    held.push({ fail, done: () => done({ width, height, channels: new Map() }) });
  }));
  const looks = [0, -1000].map((corner) => detail.look([100, 100], [corner, 0], 2));
  held[0].fail(new TypeError("it broke off"));
  held[1].done();
  const first = await Promise.all(looks);
  const third = detail.look([100, 100], [-2000, 0], 2);
  held[2].done();
  return { first, third: await third, shown };
}"""
"""A Detail looks elsewhere before the first area has come, which then fails."""


def test_an_area_that_is_wanted_no_longer_may_fail(page: Page) -> None:
    page.goto("/")
    found = page.evaluate(SUPERSEDE)
    assert found == {"first": [True, True], "third": True, "shown": [[500, 0], [1000, 0]]}


REFUSE = """async () => {
  const { Detail } = await import("/page/detail.js");
  const { Problem } = await import("/page/api.js");
  const told = [];
  const light = { step: 2, size: [300, 200], showDetail: () => told.push("shown") };
  const detail = new Detail(light, async (left, top, width, height) => {
    const key = sessionStorage.getItem("lightlayers-key");
    told.push(key);
    if (key !== "good") throw new Problem({ title: "x", detail: "x", status: 401 });
    return { width, height, channels: new Map() };
  });
  for (const key of [null, "bad", "good"]) {
    if (key) sessionStorage.setItem("lightlayers-key", key);
    for (let time = 0; time < 2; time++) await detail.look([200, 200], [0, 0], 2);
  }
  return told;
}"""
"""A Detail looks twice with each key, of which the last is good."""


def test_after_a_key_was_refused_another_is_tried_and_the_same_is_not(page: Page) -> None:
    page.goto("/")
    assert page.evaluate(REFUSE) == [None, "bad", "good", "shown"]


DRAW = """async ({ preview, photograph, scale, size }) => {
  const { Processor } = await import("/page/processor.js");
  const light = (bits, width) => ({
    width,
    height: bits.length / width,
    channels: new Map(["R", "G", "B"].map((name) => [`lamp1.${name}`, Uint16Array.from(bits)])),
  });
  const context = new OffscreenCanvas(size, size).getContext("2d");
  const processor = new Processor(context, light(preview, 4), 1);
  processor.showDetail({ picture: light(photograph, 8), step: 1 / 2, corner: [0, 0] });
  const identity = [[1, 0, 0, 0, 1, 0, 0, 0, 1]];
  const view = {
    width: size, height: size, corner: [0, 0], scale, level: 0, smooth: false, detailed: true,
    split: 0, marked: false, around: [0, 0, 0], now: identity, before: identity,
  };
  return [true, false].map((moving) => {
    const sharp = processor.draw({ ...view, moving });
    return [sharp, [...context.getImageData(0, 0, size, 1).data].filter((_, at) => at % 4 === 0)];
  });
}"""
"""The first row that the processor draws, while a picture moves and at rest, and whether that is
all: a preview of 4 pixels to a side, larger than the screen's, and its photograph of 8."""


@pytest.mark.parametrize(("scale", "waits"), [(3, True), (4, False), (2, False)])
def test_at_rest_the_processor_draws_between_the_pixels_of_the_photograph(
    page: Page, scale: int, waits: bool
) -> None:
    """Of which each takes 1.5 pixels of the screen, or whole ones, between which nothing is."""
    size, full = 4 * scale, scale / 2
    row = np.tile(np.array([0.0, 0.5], np.float16), 4)
    page.goto("/")
    bits = [np.full((4, 4), 0.25, np.float16), np.tile(row, (8, 1))]
    preview, photograph = (one.view(np.uint16).ravel().tolist() for one in bits)
    draw = {"preview": preview, "photograph": photograph, "scale": scale, "size": size}
    (settled, _), (sharp, codes) = page.evaluate(DRAW, draw)
    points = (np.arange(size) + 0.5) / full
    light = np.interp(points - 0.5, np.arange(8), row) if waits else row[points.astype(int)]
    wanted = to_srgb8(np.repeat(light.astype(np.float32)[None, :, None], 3, axis=2))[0, :, 0]
    assert (settled, sharp) == (not waits, True)
    assert np.abs(np.array(codes) - wanted).max() <= 1
