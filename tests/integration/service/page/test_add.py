"""Photographs and cameras on the page: how a pair is added."""

from __future__ import annotations

import io
import os
import re
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import FilePayload, Page, Response, Route, expect

from tests.integration.service.page.looking import (
    COUNT_KEPT,
    PATIENT,
    TWO_FRAMES,
    check_access,
    drop,
)


def test_a_camera_takes_the_pair(page: Page, service: Any) -> None:
    page.goto("/")
    page.get_by_label("Flash of NIKON D5100").select_option("operator")  # whom the job waits for
    page.get_by_role("button", name="Capture with NIKON D5100").click()
    expect(page.locator(".steps").get_by_text("Take both photographs")).to_be_visible()
    page.wait_for_url(re.compile("#/jobs/"))
    job = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    assert job["capture"]["camera"] == "sim://studio"
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("alert")).to_contain_text("Canceled")


def test_a_camera_that_fails_leaves_nothing_to_send(page: Page) -> None:
    problem = {"type": "x", "title": "No camera", "detail": "Switch it on.", "status": 503}
    page.route("**/captures", lambda route: route.fulfill(status=503, json=problem))
    page.goto("/")
    page.get_by_role("button", name="Capture with NIKON D5100").click()
    expect(page.get_by_role("alert")).to_contain_text("Switch it on.")
    expect(page.get_by_role("button", name="Separate the light")).to_be_disabled()


def test_a_key_that_is_not_for_cameras_is_told_of_and_changed(
    page: Page, keyed_queue: tuple[Any, str]
) -> None:
    service, key = keyed_queue
    reader = service.make_key("reader", "--scopes", "read")
    page.add_init_script(f"sessionStorage.setItem('lightlayers-key', '{reader}')")
    page.goto(f"{service.url}/")
    cameras = page.locator(".cameras")
    expect(cameras).to_contain_text(
        "No cameras are shown. This key lacks the scope capture; use one that has it."
    )
    expect(page.get_by_role("alert")).to_have_count(0)  # photographs can be added all the same
    check_access(page, "no_cameras")
    cameras.get_by_role("button", name="Use another key").click()
    page.get_by_role("textbox", name="Key").fill(key)
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Capture with NIKON D5100")).to_be_visible()
    expect(cameras).not_to_contain_text("No cameras are shown")


def test_cameras_that_a_key_is_no_longer_for_are_told_of(page: Page) -> None:
    problem = {"type": "urn:lightlayers:problem:forbidden", "title": "x", "status": 403}
    refused = {**problem, "detail": "This key lacks the scope capture."}
    held: list[Route] = []
    page.add_init_script(PATIENT)
    page.route("**/cameras/events", lambda route: held.append(route))
    with page.expect_request("**/cameras/events"):
        page.goto("/")
    capture = page.get_by_role("button", name="Capture with NIKON D5100")
    expect(capture).to_be_visible()
    held[0].fulfill(status=403, json=refused)
    expect(page.locator(".cameras")).to_contain_text("This key lacks the scope capture.")
    expect(capture).to_have_count(0)


def test_cameras_of_a_service_that_fails_are_told_of(page: Page) -> None:
    problem = {"type": "x", "title": "Down", "detail": "Try again in a minute.", "status": 503}
    page.route("**/cameras", lambda route: route.fulfill(status=503, json=problem))
    page.goto("/")
    told = page.locator(".cameras")
    expect(told).to_contain_text("No cameras are shown. Try again in a minute.")
    expect(told.get_by_role("button")).to_have_count(0)


def test_a_double_click_takes_one_pair(page: Page, done: dict[str, Any]) -> None:
    held: list[Route] = []
    page.route("**/captures", lambda route: held.append(route))
    page.goto("/")
    with page.expect_request("**/captures"):
        page.get_by_role("button", name="Capture with NIKON D5100").dblclick()
    page.evaluate(TWO_FRAMES)
    assert len(held) == 1
    held[0].fulfill(status=202, json={"jobs": [done]})
    page.wait_for_url(re.compile(done["id"]))


def _expect_added(page: Page, no_flash: str, flash: str) -> None:
    for zone, name in (("Without the flash", no_flash), ("With the flash", flash)):
        shown = page.get_by_role("region", name=zone, exact=True).locator(".name")
        expect(shown).to_have_text(re.compile(f"^{re.escape(name)} "))


@pytest.mark.parametrize(
    ("names", "no_flash", "flash"),
    [
        (("dark.dng", "bright.dng"), "dark.dng", "bright.dng"),
        (("a_flash.jpg", "a_no_flash.jpg"), "a_no_flash.jpg", "a_flash.jpg"),
        (("Flash.JPG", "NoFlash.JPG"), "NoFlash.JPG", "Flash.JPG"),
        (("with.nef", "without.nef"), "without.nef", "with.nef"),
        (("casino_flash.jpg", "room.jpg"), "room.jpg", "casino_flash.jpg"),
        (("2_no_flash.jpg", "1_no_flash.jpg"), "2_no_flash.jpg", "1_no_flash.jpg"),
    ],
)
def test_two_files_are_dropped_at_once(
    page: Page, names: tuple[str, str], no_flash: str, flash: str
) -> None:
    page.goto("/")
    drop(page, "With the flash", *names)
    _expect_added(page, no_flash, flash)
    expect(page.get_by_role("button", name="Separate the light")).to_be_enabled()
    expect(page.get_by_role("alert")).to_have_count(0)


def test_a_third_file_is_told_of(page: Page) -> None:
    page.goto("/")
    drop(page, "Without the flash", "1.dng", "2.dng", "3.dng")
    _expect_added(page, "1.dng", "2.dng")
    expect(page.get_by_role("alert")).to_contain_text("The others were left out.")
    check_access(page, "third")
    drop(page, "With the flash", "3.dng")
    _expect_added(page, "1.dng", "3.dng")
    expect(page.get_by_role("alert")).to_have_count(0)


def test_what_is_no_file_is_told_of(page: Page, tmp_path: Path) -> None:
    """As the browser itself drops it."""
    page.goto("/")
    alert = page.get_by_role("alert")
    devtools = page.context.new_cdp_session(page)
    folder, file = tmp_path / "folder", tmp_path / "a.dng"
    folder.mkdir()
    file.write_bytes(b"x")

    def drop_really(**what: Any) -> None:
        box = page.get_by_role("region", name="Without the flash", exact=True).bounding_box()
        assert box is not None
        where = {"x": box["x"] + 40, "y": box["y"] + 40}
        data = {"items": [], "dragOperationsMask": 1, **what}
        for step in ("dragEnter", "dragOver", "drop"):
            devtools.send("Input.dispatchDragEvent", {"type": step, **where, "data": data})

    drop_really(files=[str(folder)])
    expect(alert).to_contain_text("Folders, and pictures out of other pages, cannot be taken")
    expect(page.locator(".chosen .name")).to_have_count(0)
    drop_really(files=[str(folder), str(file)])
    expect(alert).to_contain_text("The others were left out.")
    expect(page.locator(".chosen .name")).to_have_text(["a.dng · 1 byte"])
    drop_really(files=[str(file)])
    expect(alert).to_have_count(0)
    drop_really(items=[{"mimeType": "text/plain", "data": "a link"}], files=[])
    expect(alert).to_contain_text("drop the files themselves")
    expect(page.locator(".chosen .name")).to_have_text(["a.dng · 1 byte"])


def test_what_is_chosen_stays_where_its_view_is_wanted_again(page: Page) -> None:
    page.goto("/")
    drop(page, "Without the flash", "1.dng", "2.dng")
    page.get_by_label("Lamps").select_option("2")
    for name in ("New", "lightlayers"):
        page.get_by_role("link", name=name).click()
        expect(page.locator("main")).to_be_focused()
        _expect_added(page, "1.dng", "2.dng")
        expect(page.get_by_label("Lamps")).to_have_value("2")


def test_a_name_from_right_to_left_stays_apart_from_its_size(page: Page) -> None:
    page.goto("/")
    drop(page, "Without the flash", "חדר.png")
    expect(page.locator(".chosen bdi")).to_have_text("חדר.png")
    expect(page.locator(".chosen .name")).to_have_text("חדר.png · 1 byte")


def test_two_files_are_swapped_and_sent_so(page: Page, done: dict[str, Any]) -> None:
    lengths: dict[str, str] = {}  # of files, by the ids of their uploads
    sent: list[dict[str, str]] = []

    def begun(answer: Response) -> None:
        if answer.url.endswith("/uploads"):
            upload = answer.headers["location"].rpartition("/")[2]
            lengths[upload] = answer.request.headers["upload-length"]

    def jobs(route: Route) -> None:
        sent.append((route.request.post_data_json or {})["uploads"])
        route.fulfill(status=202, json=done)

    page.on("response", begun)
    page.route(re.compile(r"/jobs$"), jobs)
    page.goto("/")
    swap = page.get_by_role("button", name="Swap")
    for label, name in (("Without the flash", "1.dng"), ("With the flash", "longer.dng")):
        expect(swap).to_be_disabled()
        choose = page.get_by_label(f"Choose a file: {label}")
        choose.set_input_files({"name": name, "mimeType": "", "buffer": name.encode()})
        expect(choose).to_have_value("")  # so that the same one can be chosen there again
    swap.click()
    _expect_added(page, "longer.dng", "1.dng")
    page.get_by_role("button", name="Separate the light").click()
    page.wait_for_url(re.compile(done["id"]))
    (pair,) = sent
    assert {frame: lengths[upload] for frame, upload in pair.items()} == {
        "no_flash": str(len("longer.dng")),
        "flash": str(len("1.dng")),
    }


def test_a_pair_whose_answer_got_lost_is_sent_again_as_the_same(page: Page) -> None:
    once: list[str] = []

    def jobs(route: Route) -> None:
        once.append(route.request.headers["idempotency-key"])
        route.abort()

    page.route(re.compile(r"/jobs$"), jobs)
    page.goto("/")
    drop(page, "Without the flash", "1.dng", "2.dng")
    for change in (None, None, "Swap", "Lamps"):
        if change == "Swap":
            page.get_by_role("button", name="Swap").click()
        if change == "Lamps":
            page.get_by_label("Lamps").select_option("2")
        with page.expect_request(re.compile(r"/jobs$")):
            page.get_by_role("button", name="Separate the light").click()
        expect(page.get_by_role("alert")).to_contain_text("No connection")
        expect(page.get_by_role("button", name="Separate the light")).to_be_enabled()
    first, again, swapped, counted = once
    assert first == again
    assert len({first, swapped, counted}) == 3


def test_a_capture_whose_answer_got_lost_is_wanted_again_as_the_same(
    page: Page, service: Any
) -> None:
    once: list[str] = []
    made: list[str] = []

    def captures(route: Route) -> None:
        once.append(route.request.headers["idempotency-key"])
        made.append(route.fetch().json()["jobs"][0]["id"])
        route.abort()

    page.route("**/captures", captures)
    page.goto("/")
    for flash in ("", "", "operator"):
        page.get_by_label("Flash of NIKON D5100").select_option(flash)
        with page.expect_event("requestfailed", lambda one: one.url.endswith("/captures")):
            page.get_by_role("button", name="Capture with NIKON D5100").click()
        expect(page.get_by_role("alert")).to_contain_text("No connection")
    for job_id in set(made):
        service.http.post(f"/jobs/{job_id}/cancel").raise_for_status()
    assert once[0] == once[1] != once[2]
    assert made[0] == made[1] != made[2]


def test_a_file_dropped_beside_its_place_does_not_replace_the_page(page: Page) -> None:
    page.goto("/")
    kept = page.evaluate(
        """() => ["dragover", "drop"].map((type) => {
          const over = new DragEvent(type, { bubbles: true, cancelable: true });
          document.querySelector("h1").dispatchEvent(over);
          return over.defaultPrevented;
        })"""
    )
    assert kept == [True, True]


def test_photographs_that_were_shown_are_not_held_on_to(page: Page) -> None:
    page.add_init_script(COUNT_KEPT)
    page.goto("/")
    picture = io.BytesIO()
    Image.new("RGB", (3, 2)).save(picture, "PNG")
    contents = {"Without the flash": picture.getvalue(), "With the flash": b"no picture"}
    for label, buffer in contents.items():
        file: FilePayload = {"name": "a.png", "mimeType": "image/png", "buffer": buffer}
        page.get_by_label(f"Choose a file: {label}").set_input_files(file)
    expect(page.locator("html")).to_have_attribute("data-kept", "0")
    expect(page.locator(".chosen img")).to_have_count(1)
    expect(page.locator(".chosen img")).to_have_js_property("naturalWidth", 3)


def test_a_file_that_changes_after_it_was_chosen_is_named(page: Page, tmp_path: Path) -> None:
    page.goto("/")
    files = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    for file in files:
        file.write_bytes(b"no picture")
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    files[1].write_bytes(b"another one, edited")
    os.utime(files[1], (0, 0))  # another second: the browser looks no closer
    page.get_by_role("button", name="Separate the light").click()
    alert = page.get_by_role("alert")
    expect(alert).to_contain_text("b.jpg was changed or removed after it was chosen")
    page.get_by_label("Choose a file: With the flash").set_input_files(files[1])
    page.get_by_role("button", name="Separate the light").click()
    expect(alert).to_contain_text("photograph without the flash")  # of what was sent


def test_a_bad_file_is_told_in_words(page: Page) -> None:
    page.goto("/")
    for label in ("Without the flash", "With the flash"):
        file: FilePayload = {"name": "a.jpg", "mimeType": "image/jpeg", "buffer": b"no picture"}
        page.get_by_label(f"Choose a file: {label}").set_input_files(file)
    page.get_by_role("button", name="Separate the light").click()
    expect(page.get_by_role("alert")).to_contain_text("photograph without the flash")
    check_access(page, "refused")
    expect(page.get_by_role("button", name="Separate the light")).to_be_enabled()


def test_a_device_without_a_touch_screen_is_not_asked_for_its_camera(page: Page) -> None:
    """There the button would choose a file, as the one beside it does."""
    page.goto("/")
    expect(page.get_by_text("Choose a file")).to_have_count(2)
    expect(page.get_by_text("Use the camera").filter(visible=True)).to_have_count(0)
