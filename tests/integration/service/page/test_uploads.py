"""Photographs that are sent over a line that breaks, in a real browser on a real service."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import FilePayload, Page, Route, expect

import drivers
from tests.integration.service.page.looking import PATIENT, USE
from tests.png_bombs import png_of

PIECE = 8 * 2**10  # the page's own would have to pass through this process
LONG, SHORT = bytes(20 * 2**10), b"x"  # without the flash, and with it
FULL = {"type": "x", "title": "Too many jobs wait", "detail": "Send it later.", "status": 429}

QUICK = """
  const later = setTimeout;
  setTimeout = (work, time) => later(work, time / 100);
"""
"""A page that waits a hundredth of the time."""


class Line:
    """What lies between the uploads of a page and the service.

    pieces: where those began that were sent. breaks: what becomes of a piece at this number, in
    place of going through. cut: nothing goes through. uploads: of each request for a job.
    """

    def __init__(self, page: Page, done: dict[str, Any]) -> None:
        self.pieces: list[int] = []
        self.breaks: dict[int, Callable[[Route], None]] = {}
        self.cut = False
        self.uploads: list[dict[str, str]] = []
        self._done = done
        page.add_init_script(QUICK)
        page.route("**/uploads.js", _in_small_pieces)
        page.route("**/uploads/*", self._pass)
        page.route(re.compile(r"/jobs$"), self.make)

    def _pass(self, route: Route) -> None:
        if route.request.method == "PATCH" and not self.cut:
            self.pieces.append(int(route.request.headers["upload-offset"]))
            if broken := self.breaks.get(len(self.pieces)):
                broken(route)
        if self.cut or (len(self.pieces) in self.breaks and route.request.method == "PATCH"):
            route.abort()
        else:
            route.continue_()

    def make(self, route: Route) -> None:
        """Answer a request for a job."""
        self.uploads.append((route.request.post_data_json or {})["uploads"])
        route.fulfill(status=202, json=self._done)


def _in_small_pieces(route: Route) -> None:
    answer = route.fetch()
    script = answer.text()
    assert script.count("PIECE = 2 ** 23;") == 1
    route.fulfill(response=answer, body=script.replace("2 ** 23", str(PIECE)))


@pytest.fixture
def line(page: Page, done: dict[str, Any]) -> Line:
    """A pair is chosen, of which the photograph without the flash comes in three pieces."""
    line = Line(page, done)
    page.goto("/")
    files = [_photograph("a.jpg", LONG), _photograph("b.jpg", SHORT)]
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    return line


def _photograph(name: str, data: bytes) -> FilePayload:
    return {"name": name, "mimeType": "image/jpeg", "buffer": data}


def send(page: Page) -> None:
    page.get_by_role("button", name="Separate the light").click()


def expect_whole(page: Page, line: Line, service: Any, done: dict[str, Any]) -> None:
    """One job of both photographs, all of which have come."""
    page.wait_for_url(re.compile(done["id"]))
    (uploads,) = line.uploads
    for frame, data in (("no_flash", LONG), ("flash", SHORT)):
        told = service.http.head(f"/uploads/{uploads[frame]}", headers={"Tus-Resumable": "1.0.0"})
        assert told.headers["upload-offset"] == told.headers["upload-length"] == str(len(data))


def test_a_piece_that_breaks_off_is_sent_again_alone(
    page: Page, line: Line, service: Any, done: dict[str, Any]
) -> None:
    line.breaks[2] = lambda _: None
    send(page)
    expect_whole(page, line, service, done)
    assert line.pieces == [0, PIECE, PIECE, 2 * PIECE, 0]


def test_a_piece_whose_answer_got_lost_is_not_sent_again(
    page: Page, line: Line, service: Any, done: dict[str, Any]
) -> None:
    def come(route: Route) -> None:
        names = ("tus-resumable", "upload-offset", "content-type")
        headers = {name: route.request.headers[name] for name in names}
        service.http.patch(route.request.url, headers=headers, content=bytes(PIECE))

    line.breaks[2] = come
    send(page)
    expect_whole(page, line, service, done)
    assert line.pieces == [0, PIECE, 2 * PIECE, 0]


@pytest.mark.parametrize("gone", [False, True], ids=["kept", "gone meanwhile"])
def test_what_has_come_before_a_long_break_stays(
    page: Page, line: Line, service: Any, done: dict[str, Any], gone: bool
) -> None:
    """Until the service removes it, as it does after a day: then it is sent anew."""
    uploads: list[str] = []

    def cut(route: Route) -> None:
        uploads.append(route.request.url)
        line.cut = True

    line.breaks[2] = cut
    send(page)
    expect(page.get_by_role("alert")).to_contain_text("No connection")
    assert line.uploads == []
    if gone:
        headers = {"Tus-Resumable": "1.0.0"}
        service.http.delete(uploads[0], headers=headers).raise_for_status()
    line.cut = False
    send(page)
    expect_whole(page, line, service, done)
    again = [0, PIECE] if gone else [PIECE]
    assert line.pieces == [0, PIECE, *again, 2 * PIECE, 0]


def test_a_pair_that_is_refused_is_not_kept(page: Page, line: Line, service: Any) -> None:
    """It would count among the bytes that a key may store."""
    page.unroute(re.compile(r"/jobs$"))
    with (
        page.expect_request(re.compile(r"/jobs$")) as asked,
        page.expect_response(lambda one: one.request.method == "DELETE"),
    ):
        send(page)
    expect(page.get_by_role("alert")).to_contain_text("photograph without the flash")
    uploads = (asked.value.post_data_json or {})["uploads"]
    headers = {"Tus-Resumable": "1.0.0"}
    told = service.http.head(f"/uploads/{uploads['no_flash']}", headers=headers)
    assert told.status_code == 404
    assert line.pieces == [0, PIECE, 2 * PIECE, 0]


def test_a_pair_of_too_many_pixels_is_not_kept(page: Page, service: Any) -> None:
    """As one that is refused for another reason; the service says so with another status."""
    page.goto("/")
    files = [_photograph(name, png_of(40_000, 40_000)) for name in ("a.png", "b.png")]
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    with (
        page.expect_request(re.compile(r"/jobs$")) as asked,
        page.expect_response(lambda one: one.request.method == "DELETE"),
    ):
        send(page)
    expect(page.get_by_role("alert")).to_contain_text("40000 × 40000 pixels")
    uploads = (asked.value.post_data_json or {})["uploads"]
    headers = {"Tus-Resumable": "1.0.0"}

    def is_gone() -> bool:
        told = [service.http.head(f"/uploads/{one}", headers=headers) for one in uploads.values()]
        return all(answer.status_code == 404 for answer in told)

    service.await_that("both are removed", is_gone)


def test_a_pair_that_is_gone_before_a_job_was_made_of_it_is_sent_anew(
    page: Page, line: Line, service: Any, done: dict[str, Any]
) -> None:
    """As after a day in which too many jobs waited."""
    job = re.compile(r"/jobs$")
    page.unroute(job)
    page.route(job, lambda route: route.fulfill(status=429, json=FULL))
    with page.expect_request(job) as asked:
        send(page)
    expect(page.get_by_role("alert")).to_contain_text("Too many jobs wait")
    for upload in (asked.value.post_data_json or {})["uploads"].values():
        headers = {"Tus-Resumable": "1.0.0"}
        service.http.delete(f"/uploads/{upload}", headers=headers).raise_for_status()
    page.unroute(job)
    page.route(job, line.make)
    send(page)
    expect_whole(page, line, service, done)
    assert line.pieces == [0, PIECE, 2 * PIECE, 0] * 2


def test_whatever_window_is_used_the_line_has_its_time_to_come_back(page: Page) -> None:
    """Looking elsewhere and back took all tries within a second."""
    tries: list[Route] = []

    def cut(route: Route) -> None:
        tries.append(route)
        route.abort()

    page.add_init_script(PATIENT)  # the second pause never ends
    page.route("**/uploads", cut)
    page.goto("/")
    files = [_photograph("a.jpg", SHORT), _photograph("b.jpg", SHORT)]
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    send(page)
    while len(tries) < 2:
        page.wait_for_timeout(50)
    for used in (False, True, False, True):
        page.evaluate(USE, used)
        page.wait_for_timeout(100)
    assert len(tries) == 2
    page.get_by_role("button", name="Cancel").click()
    expect(page.get_by_role("button", name="Cancel")).to_be_hidden()


def choose(page: Page, service: Any, key: str, *pair: bytes) -> list[tuple[str, str]]:
    """Choose a pair with a key; what is asked for from then on, but files of the page."""
    asked: list[tuple[str, str]] = []
    page.on("request", lambda request: asked.append((request.method, urlsplit(request.url).path)))
    page.add_init_script(f"sessionStorage.setItem('lightlayers-key', '{key}')")
    page.goto(service.url)
    chosen = page.get_by_label("Choose a file: Without the flash")
    names = ("a.jpg", "b.jpg")
    chosen.set_input_files([_photograph(*one) for one in zip(names, pair, strict=True)])
    return asked


def test_a_key_that_may_make_no_more_jobs_is_told_before_anything_is_sent(
    page: Page, keyed_queue: tuple[Any, str], small_pair: drivers.CapturedPair
) -> None:
    service, _ = keyed_queue
    key = service.make_key("once", "--jobs-per-day", "1")
    files = {"no_flash": small_pair.no_flash.best, "flash": small_pair.flash.best}
    headers = {"authorization": f"Bearer {key}"}
    service.http.post("/jobs", files=files, headers=headers).raise_for_status()
    asked = choose(page, service, key, b"x", b"x")
    send(page)
    expect(page.get_by_role("alert")).to_contain_text("This key may make 1 job a day")
    assert [one for one in asked if one[0] != "GET"] == [("POST", "/uploads")]
    expect(page.locator(".chosen .name")).to_have_count(2)  # to be sent tomorrow


def test_a_second_photograph_without_room_is_told_before_the_first_is_sent(
    page: Page, keyed_queue: tuple[Any, str]
) -> None:
    service, _ = keyed_queue
    key = service.make_key("small", "--stored-bytes", "1000000")
    asked = choose(page, service, key, bytes(600_000), bytes(600_000))
    send(page)
    expect(page.get_by_role("alert")).to_contain_text("may take 1,000,000 bytes")
    assert [one for one in asked if one[0] != "GET"] == [("POST", "/uploads")] * 2


def test_a_file_that_is_too_large_is_named_before_anything_is_sent(
    page: Page, service: Any, tmp_path: Path
) -> None:
    files = [tmp_path / "a.dng", tmp_path / "b.dng"]
    files[0].write_bytes(b"x")
    with files[1].open("wb") as file:
        file.truncate(3 * 2**30)  # takes no room
    asked: list[tuple[str, str]] = []
    page.on("request", lambda request: asked.append((request.method, urlsplit(request.url).path)))
    page.goto(service.url)
    page.get_by_label("Choose a file: Without the flash").set_input_files(files)
    expect(page.locator(".chosen .name")).to_have_text(["a.dng · 1 byte", "b.dng · 3.2 GB"])
    send(page)
    expect(page.get_by_role("alert")).to_contain_text(
        "b.dng has 3.2 GB, and this service takes 537 MB at most: choose a smaller file."
    )
    sent = [("POST", "/uploads")] * 2 + [("OPTIONS", "/uploads")]
    assert [one for one in asked if one[0] != "GET"] == sent
    expect(page.locator(".chosen .name")).to_have_count(2)
