"""Lamps that are pinned and forbidden by places in the picture, in a real browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.integration.service.page.looking import (
    check_access,
    drawn,
    halve_preview,
    open_mixer,
    tab_to,
)

WIDTH, HEIGHT = 300, 200  # of the photograph
RADIUS = 5  # of a new circle on it

Places = list[dict[str, float]]


def open_known(page: Page, job: dict[str, Any]) -> Locator:
    """The canvas of a job's picture, ready for places to be marked there."""
    canvas = open_mixer(page, job)
    page.get_by_text("Pin or forbid lamps").click()
    return canvas


def click(canvas: Locator, x: float, y: float) -> tuple[float, float]:
    """Click so far from the middle of a canvas, in pixels of the page; how far it really was."""
    box = canvas.bounding_box()
    assert box is not None
    place = round(box["width"] / 2 + x), round(box["height"] / 2 + y)
    canvas.click(position={"x": place[0], "y": place[1]})
    return place[0] - box["width"] / 2, place[1] - box["height"] / 2


def drag(page: Page, canvas: Locator, x: float, y: float) -> None:
    box = canvas.bounding_box()
    assert box is not None
    middle = box["x"] + box["width"] // 2, box["y"] + box["height"] // 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + x, middle[1] + y, steps=4)
    page.mouse.up()


def forbid(page: Page) -> None:
    page.get_by_role("radio", name="No lamp: forbid").check(force=True)


def separate_again(page: Page, service: Any, job: dict[str, Any]) -> dict[str, Any]:
    """The options of the job that is made, which is canceled."""
    page.get_by_role("button", name="Separate again").click()
    page.wait_for_url(lambda url: "#/jobs/" in url and job["id"] not in url)
    made = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    service.http.post(f"/jobs/{made['id']}/cancel")
    assert made["inputs"] == job["inputs"]
    options: dict[str, Any] = made["options"]
    return options


@pytest.fixture(params=[1, 2.5], ids=["screen", "dense screen"])
def dense(request: pytest.FixtureRequest, browser: Browser, service: Any) -> Iterator[Page]:
    """A page on a screen of so many pixels for each of the page."""
    context = browser.new_context(base_url=service.url, device_scale_factor=request.param)
    yield context.new_page()
    context.close()


def test_places_are_told_in_pixels_of_the_photograph(
    dense: Page, done: dict[str, Any], service: Any, tmp_path: Path
) -> None:
    """Whatever the screen, the preview, which is half as large, and how it is looked at."""
    halve_preview(dense, service, done, tmp_path)
    ratio = float(dense.evaluate("devicePixelRatio"))
    canvas = open_known(dense, done)
    wanted: list[tuple[float, float]] = []

    def mark(x: float, y: float, larger: float, moved: tuple[float, float]) -> None:
        """Click at about this pixel, from the middle; larger: pixels of the screen for one."""
        way = (value * larger / ratio for value in (x - moved[0], y - moved[1]))
        real = click(canvas, *way)
        found = (value * ratio / larger + more for value, more in zip(real, moved, strict=True))
        wanted.append((next(found) + WIDTH / 2, next(found) + HEIGHT / 2))

    dense.get_by_role("button", name="pixel by pixel").click()
    drawn(dense)
    mark(-60, 20, 1, (0, 0))
    for _ in range(6):
        dense.get_by_role("button", name="Larger").click()
    drawn(dense)
    larger = 1.5**6
    mark(10, -20, larger, (0, 0))
    drag(dense, canvas, -120, 80)
    drawn(dense)
    forbid(dense)
    mark(15, -20, larger, (120 * ratio / larger, -80 * ratio / larger))
    options = separate_again(dense, service, done)
    places: Places = [*options["pinned_lamps"], *options["forbidden_lamps"]]
    assert [one["radius"] for one in places] == [RADIUS] * 3
    assert len(options["pinned_lamps"]) == 2
    for place, (x, y) in zip(places, wanted, strict=True):
        assert place["x"] + 0.5 == pytest.approx(x, abs=1)
        assert place["y"] + 0.5 == pytest.approx(y, abs=1)
    others = {"pinned_lamps", "forbidden_lamps"}
    assert {name: value for name, value in options.items() if name not in others} == done["options"]


def test_circles_lie_where_was_clicked(page: Page, done: dict[str, Any]) -> None:
    """Also once the picture is moved, and not in other pictures."""
    canvas = open_known(page, done)
    page.get_by_role("button", name="Larger").click()
    drawn(page)
    box = canvas.bounding_box()
    assert box is not None
    x, y = click(canvas, 90, -40)
    x, y = x + box["x"] + box["width"] / 2, y + box["y"] + box["height"] / 2
    circle = page.locator(".spots .line circle")

    def middle() -> tuple[float, float]:
        found = circle.bounding_box()
        assert found is not None
        return found["x"] + found["width"] / 2, found["y"] + found["height"] / 2

    assert middle() == pytest.approx((x, y), abs=4)  # less than a pixel of the photograph
    before = middle()
    drag(page, canvas, 30, 0)
    drawn(page)
    assert middle() == pytest.approx((before[0] + 30, before[1]), abs=1)
    page.get_by_role("radio", name="Why these lamps").check(force=True)
    expect(circle).to_have_count(0)
    page.get_by_role("radio", name="Lamp 1", exact=True).check(force=True)
    expect(circle).to_have_count(1)
    page.get_by_text("Pin or forbid lamps").click()
    expect(circle).to_have_count(0)
    click(canvas, 0, 0)
    page.get_by_text("Pin or forbid lamps").click()
    expect(circle).to_have_count(1)


def test_lamps_are_pinned_by_a_finger(phone: Page, done: dict[str, Any], service: Any) -> None:
    canvas = open_mixer(phone, done)
    phone.get_by_text("Pin or forbid lamps").tap()
    forbid(phone)
    canvas.tap()
    check_access(phone, "known_phone")
    assert phone.evaluate("document.documentElement.scrollWidth") == 390
    options = separate_again(phone, service, done)
    assert options["pinned_lamps"] == []
    (place,) = options["forbidden_lamps"]
    assert place["x"] == pytest.approx(WIDTH / 2, abs=2)
    assert place["y"] == pytest.approx(HEIGHT / 2, abs=2)


def test_lamps_are_pinned_by_keys_alone(page: Page, done: dict[str, Any], service: Any) -> None:
    open_mixer(page, done)
    tab_to(page, page.get_by_text("Pin or forbid lamps"))
    page.keyboard.press("Enter")
    tab_to(page, page.get_by_role("button", name="Mark the middle"))
    page.keyboard.press("Enter")
    for label, number in (("x", "31.5"), ("y", "42"), ("radius", "9")):
        page.get_by_label(f"Pinned lamp 1: {label}", exact=True).fill(number)
    page.get_by_role("button", name="Mark the middle").press("Enter")
    page.get_by_role("button", name="Remove pinned lamp 2").press("Enter")
    expect(page.get_by_role("button", name="Mark the middle")).to_be_focused()
    check_access(page, "known")
    options = separate_again(page, service, done)
    assert options["pinned_lamps"] == [{"x": 31.5, "y": 42, "radius": 9}]
    assert options["forbidden_lamps"] == []


def test_the_middle_is_that_of_the_mix_whatever_else_was_looked_at(
    page: Page, done: dict[str, Any]
) -> None:
    """A picture that is not shown has no middle: its upper left corner was marked."""
    open_known(page, done)
    middle = page.get_by_role("button", name="Mark the middle")
    middle.click()
    page.get_by_role("radio", name="Why these lamps").check(force=True)
    middle.click()
    expect(page.get_by_role("radio", name="Mix", exact=True)).to_be_checked()
    for axis, side in (("x", WIDTH), ("y", HEIGHT)):
        first, second = (page.get_by_label(f"Pinned lamp {lamp}: {axis}") for lamp in (1, 2))
        assert float(first.input_value()) == pytest.approx(side / 2, abs=1)
        expect(second).to_have_value(first.input_value())


def test_what_the_service_refuses_is_told_and_stays(page: Page, done: dict[str, Any]) -> None:
    """Three pins for two lamps."""
    canvas = open_known(page, done)
    for place in (-80, 0, 80):
        click(canvas, place, 10)
    page.get_by_role("button", name="Separate again").click()
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("An option cannot be used")
    expect(alert).to_contain_text("3 lamps are pinned and only 2 asked for")
    expect(alert).to_be_in_viewport()
    assert done["id"] in page.url
    numbers = page.get_by_label(re.compile(r"^Pinned lamp \d: x"))
    left = [one.input_value() for one in numbers.all()]
    assert len(left) == 3
    page.get_by_role("link", name="Jobs").click()
    page.go_back()
    drawn(page)
    assert [one.input_value() for one in numbers.all()] == left
    expect(page.locator(".spots .line circle")).to_have_count(3)


def test_what_marks_nothing_is_not_sent(page: Page, done: dict[str, Any]) -> None:
    """Neither clicks beside the picture, nor numbers of places that lie there."""
    sent: list[str] = []
    page.on("request", lambda one: sent.append(one.url) if one.url.endswith("/rerun") else None)
    canvas = open_known(page, done)
    page.get_by_role("button", name="pixel by pixel").click()
    drawn(page)
    click(canvas, -WIDTH / 2 - 20, 0)
    again = page.get_by_role("button", name="Separate again")
    again.click()
    expect(page.get_by_role("alert")).to_contain_text("No place is marked")
    click(canvas, -WIDTH / 2 + 20, 0)
    expect(page.get_by_role("alert")).to_have_count(0)
    x = page.get_by_label("Pinned lamp 1: x")
    expect(x).to_have_value("20")
    for wrong in (str(WIDTH), "-1", ""):
        x.fill(wrong)
        again.click()
        assert x.evaluate("(input) => input.validity.valid") is False
        expect(x).to_be_focused()
    assert sent == []


def test_lamps_that_the_job_was_told_of_can_be_taken_back(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    known = {
        "pinned_lamps": ["D65", {"x": WIDTH - 0.5, "y": 30, "radius": 8}],  # in the last column
        "forbidden_lamps": [{"x": 250, "y": 30, "radius": 12}],
    }
    told = {**done, "options": {**done["options"], **known}}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=told))
    open_known(page, done)
    expect(page.locator(".known li").first).to_contain_text("D65")
    expect(page.get_by_label("Forbidden lamp 1: radius")).to_have_value("12")
    expect(page.locator(".spots .line circle")).to_have_count(2)
    page.get_by_role("button", name="Remove forbidden lamp 1").click()
    expect(page.locator(".spots .line circle")).to_have_count(1)
    options = separate_again(page, service, done)
    assert options["pinned_lamps"] == known["pinned_lamps"]
    assert options["forbidden_lamps"] == []
