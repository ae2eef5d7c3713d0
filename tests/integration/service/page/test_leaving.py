"""Views that are left before what was asked for there is answered, in a real browser."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import FilePayload, Locator, Page, Route, expect

from tests.integration.service.page.looking import TWO_FRAMES, check_access, drop, open_mixer

PROBLEM = {"type": "x", "title": "Too much", "detail": "Come back tomorrow.", "status": 429}


def send_pair(page: Page) -> None:
    """Add two photographs of nothing, and send them."""
    page.goto("/")
    files: list[FilePayload] = [
        {"name": name, "mimeType": "image/jpeg", "buffer": b"x"} for name in ("a.jpg", "b.jpg")
    ]
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    with page.expect_request(re.compile(r"/jobs$")):
        page.get_by_role("button", name="Separate the light").click()


@pytest.fixture
def held(page: Page) -> list[Route]:
    """Photographs that are on their way, which the test answers."""
    held: list[Route] = []
    page.route(re.compile(r"/jobs$"), lambda route: held.append(route))
    send_pair(page)
    return held


def leave(page: Page) -> Locator:
    """Go to the jobs; what is told there above them."""
    page.get_by_role("link", name="Jobs").click()
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    return page.locator("#notes")


def test_a_job_that_was_made_meanwhile_takes_nobody_to_it(
    page: Page, held: list[Route], done: dict[str, Any]
) -> None:
    notes = leave(page)
    held[0].fulfill(status=202, json=done)
    expect(notes).to_contain_text("The job that you asked for is made.")
    assert page.url.endswith("#/jobs")
    check_access(page, "made")
    notes.get_by_role("link", name="Show it").click()
    page.wait_for_url(re.compile(done["id"]))
    expect(notes).to_be_empty()


def test_photographs_that_fail_after_their_view_was_left_are_told_of(
    page: Page, held: list[Route]
) -> None:
    notes = leave(page)
    held[0].fulfill(status=429, json=PROBLEM)
    expect(notes.get_by_role("alert")).to_contain_text("Come back tomorrow.")
    check_access(page, "not_sent")
    page.get_by_role("link", name="New").click()
    expect(page.get_by_role("button", name="Separate the light")).to_be_visible()
    expect(notes.get_by_role("alert")).to_be_visible()  # until it is answered
    notes.get_by_role("button", name="Close").click()
    expect(notes).to_be_empty()
    expect(page.locator("main")).to_be_focused()


def test_photographs_that_failed_after_their_view_was_left_are_found_there(
    page: Page, held: list[Route], done: dict[str, Any]
) -> None:
    """And sent again as the same, for their answer may have got lost."""
    names = page.locator(".chosen .name")
    send = page.get_by_role("button", name="Separate the light")
    notes = leave(page)
    new = page.get_by_role("link", name="New")
    new.click()
    expect(send).to_be_disabled()  # what is under way is not sent twice
    expect(names).to_have_count(0)
    leave(page)
    held[0].abort()
    expect(notes.get_by_role("alert")).to_contain_text("No connection")
    new.click()
    expect(names).to_have_text([re.compile("a.jpg"), re.compile("b.jpg")])
    send.click()
    while len(held) < 2:
        page.wait_for_timeout(50)
    again, first = (one.request.headers["idempotency-key"] for one in (held[1], held[0]))
    assert again == first
    held[1].fulfill(status=202, json=done)
    page.wait_for_url(re.compile(done["id"]))
    new.click()
    expect(send).to_be_disabled()
    expect(names).to_have_count(0)


def test_photographs_that_fail_are_found_in_the_view_that_was_gone_to_meanwhile(
    page: Page, held: list[Route]
) -> None:
    """Of which nothing is filled in; else what is chosen there would take their place."""
    names = page.locator(".chosen .name")
    notes = leave(page)
    page.get_by_role("link", name="New").click()
    expect(names).to_have_count(0)
    held[0].abort()
    expect(notes.get_by_role("alert")).to_contain_text("No connection")
    expect(names).to_have_text([re.compile("a.jpg"), re.compile("b.jpg")])
    page.get_by_role("button", name="Swap").click()
    expect(names).to_have_text([re.compile("b.jpg"), re.compile("a.jpg")])
    with page.expect_request(re.compile(r"/jobs$")) as sent:
        page.get_by_role("button", name="Separate the light").click()
    first, swapped = (
        (one.post_data_json or {})["uploads"] for one in (held[0].request, sent.value)
    )
    assert swapped == {"no_flash": first["flash"], "flash": first["no_flash"]}


def test_what_is_chosen_stays_until_it_is_sent(page: Page) -> None:
    page.goto("/")
    drop(page, "With the flash", "2.dng")
    page.get_by_label("Lamps").select_option("2")
    leave(page)
    page.go_back()
    drop(page, "Without the flash", "1.dng")
    leave(page)
    page.get_by_role("link", name="New").click()
    expect(page.locator(".chosen .name")).to_have_text([re.compile("1.dng"), re.compile("2.dng")])
    expect(page.get_by_label("Lamps")).to_have_value("2")
    expect(page.get_by_role("button", name="Swap")).to_be_enabled()
    expect(page.get_by_role("button", name="Separate the light")).to_be_enabled()


def test_what_is_being_sent_cannot_be_changed(page: Page, held: list[Route]) -> None:
    """A camera that fails meanwhile does not change that."""
    send = page.get_by_role("button", name="Separate the light")
    expect(send).to_be_focused()
    page.route("**/captures", lambda route: route.fulfill(status=429, json=PROBLEM))
    page.get_by_role("button", name="Capture with NIKON D5100").click()
    expect(page.get_by_role("alert")).to_contain_text("Come back tomorrow.")
    expect(page.get_by_role("progressbar", name="Sent")).to_be_visible()
    expect(page.get_by_label("Lamps")).to_be_disabled()
    expect(page.get_by_role("button", name="Swap")).to_be_disabled()
    for zone in ("Without the flash", "With the flash"):
        expect(page.get_by_label(f"Choose a file: {zone}")).to_be_disabled()
        expect(page.get_by_label(f"Use the camera: {zone}")).to_be_disabled()
    drop(page, "Without the flash", "c.jpg")
    expect(page.locator(".chosen .name").first).to_contain_text("a.jpg")
    check_access(page, "sending")
    send.press("Enter")
    page.evaluate(TWO_FRAMES)
    assert len(held) == 1
    held[0].fulfill(status=429, json=PROBLEM)
    expect(page.get_by_label("Lamps")).to_be_enabled()
    expect(page.get_by_role("progressbar", name="Sent")).to_be_hidden()
    with page.expect_request(re.compile(r"/jobs$")):
        page.keyboard.press("Enter")


def test_what_is_being_sent_can_be_canceled(page: Page, service: Any, done: dict[str, Any]) -> None:
    """And sent again as it is. Over a line of 100 kB a second, without an answer made up."""
    before = service.http.get("/jobs").json()["jobs"]
    network = page.context.new_cdp_session(page)
    line = {"offline": False, "latency": 0, "downloadThroughput": -1}
    page.goto("/")
    network.send("Network.enable")
    network.send("Network.emulateNetworkConditions", {**line, "uploadThroughput": 100_000})
    files: list[FilePayload] = [
        {"name": name, "mimeType": "image/jpeg", "buffer": bytes(10**7)}
        for name in ("a.jpg", "b.jpg")
    ]
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    send, cancel = (page.get_by_role("button", name=name) for name in ("Separate", "Cancel"))
    expect(cancel).to_be_hidden()
    send.click()
    check_access(page, "cancel")
    with page.expect_event("requestfailed", lambda one: "/uploads/" in one.url):
        cancel.press("Enter")
    expect(send).to_be_focused()
    expect(cancel).to_be_hidden()
    expect(page.get_by_role("progressbar", name="Sent")).to_be_hidden()
    expect(page.locator("#said")).to_have_text("The photographs were not sent.")
    expect(page.get_by_role("alert")).to_have_count(0)
    assert service.http.get("/jobs").json()["jobs"] == before
    network.send("Network.emulateNetworkConditions", {**line, "uploadThroughput": -1})
    page.route(re.compile(r"/jobs$"), lambda route: route.fulfill(status=202, json=done))
    send.press("Enter")
    page.wait_for_url(re.compile(done["id"]))


def test_the_browser_asks_before_photographs_are_lost_that_are_being_sent(
    page: Page, held: list[Route]
) -> None:
    with page.expect_event("dialog") as asked:
        page.close(run_before_unload=True)
    assert asked.value.type == "beforeunload"
    asked.value.dismiss()
    held[0].fulfill(status=429, json=PROBLEM)
    expect(page.get_by_role("alert")).to_contain_text("Come back tomorrow.")
    with page.expect_event("close"):  # which it does not ask about any more
        page.close(run_before_unload=True)


@pytest.mark.parametrize("name", ["Run again", "Find normals"])
def test_a_late_answer_takes_nobody_from_another_view(
    page: Page, done: dict[str, Any], name: str
) -> None:
    held: list[Route] = []
    page.route("**/rerun", lambda route: held.append(route))
    open_mixer(page, done)
    page.get_by_text("Find the surface").click()
    with page.expect_request("**/rerun"):
        page.get_by_role("button", name=name).click()
    page.get_by_role("link", name="New").click()
    drop(page, "Without the flash", "1.dng", "2.dng")
    held[0].fulfill(status=202, json={**done, "id": "made"})
    made = page.locator("#notes").get_by_role("link", name="Show it")
    expect(made).to_have_attribute("href", "#/jobs/made")
    expect(page.locator(".chosen .name")).to_have_count(2)
    assert page.url.endswith("#/")


def test_a_deletion_that_is_late_takes_nobody_from_another_view(
    page: Page, done: dict[str, Any]
) -> None:
    held: list[Route] = []
    expired = {**done, "state": "expired", "files": []}

    def job(route: Route) -> None:
        if route.request.method == "DELETE":
            held.append(route)
        else:
            route.fulfill(json=expired)

    page.route(f"**/jobs/{done['id']}", job)
    page.on("dialog", lambda dialog: dialog.accept())
    page.goto(f"/#/jobs/{done['id']}")
    with page.expect_request(lambda one: one.method == "DELETE"):
        page.get_by_role("button", name="Delete").click()
    page.locator("nav").get_by_role("link", name="New").click()
    with page.expect_response(lambda one: one.request.method == "DELETE"):
        held[0].fulfill(status=204)
    page.evaluate(TWO_FRAMES)
    assert page.url.endswith("#/")


def test_a_job_that_is_told_of_too_late_is_not_followed(page: Page, done: dict[str, Any]) -> None:
    """A stream of its events would take one of six connections from what is looked at."""
    here = f"/jobs/{done['id']}"
    held: list[Route] = []
    followed: list[Route] = []
    page.route(f"**{here}", lambda route: held.append(route))
    page.route(f"**{here}/events", lambda route: followed.append(route))
    with page.expect_request(f"**{here}"):
        page.goto(f"/#{here}")
    leave(page)
    with page.expect_response(f"**{here}"):
        held[0].fulfill(json={**done, "state": "running"})
    page.evaluate(TWO_FRAMES)
    assert followed == []


def test_a_result_that_is_left_is_not_said_to_be_there(page: Page, done: dict[str, Any]) -> None:
    page.route("**/preview.exr", lambda _: None)
    with page.expect_request("**/preview.exr"):
        page.goto(f"/#/jobs/{done['id']}")
    leave(page)
    page.evaluate(TWO_FRAMES)
    expect(page.locator("#said")).to_have_text("")


def test_a_job_that_could_not_be_canceled_is_told_of_in_another_view(
    page: Page, done: dict[str, Any]
) -> None:
    here = f"/jobs/{done['id']}"
    held: list[Route] = []
    running = {**done, "state": "running", "stage": "lamps", "fraction": 0.5}
    page.route(f"**{here}", lambda route: route.fulfill(json=running))
    page.route(f"**{here}/events", lambda route: route.abort())
    page.route(f"**{here}/cancel", lambda route: held.append(route))
    page.goto(f"/#{here}")
    with page.expect_request(f"**{here}/cancel"):
        page.get_by_role("button", name="Cancel").click()
    notes = leave(page)
    held[0].fulfill(status=429, json=PROBLEM)
    expect(notes.get_by_role("alert")).to_contain_text("Come back tomorrow.")
