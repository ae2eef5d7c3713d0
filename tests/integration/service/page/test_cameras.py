"""Cameras on the page, in a real browser on a real service; one on the network is used."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Page, Route, expect

import drivers
from tests.integration.service.page.looking import (
    CAMERA,
    PATIENT,
    check_access,
    drawn,
    strip,
    tab_to,
)


@pytest.fixture
def camera() -> Iterator[Any]:
    """A simulated camera on the network."""
    served = drivers.serve_simulated("sim://studio?width=96&height=64&noise=off", "127.0.0.1", 0)
    yield served
    served.close()


@pytest.fixture
def studio(make_service: Callable[..., Any], tmp_path: Path, camera: Any) -> Any:
    """A service that may use this camera."""
    service = make_service(tmp_path / "service", cameras=f"ptp+ip://{camera.address}")
    service.start()
    return service


def test_a_camera_is_seen_set_and_used_with_a_hand_at_its_flash(
    page: Page, studio: Any, camera: Any
) -> None:
    page.goto(f"{studio.url}/")
    row = page.locator(".cameras li")
    expect(row).to_contain_text("Ready · battery 87 %")
    (listed,) = studio.http.get("/cameras").json()

    page.get_by_text("Settings", exact=True).click()
    page.get_by_label("ISO").select_option("400")
    expect(page.get_by_role("status")).to_have_text("ISO is 400.")
    check_access(page, "camera_settings")
    settings = studio.http.get(f"/cameras/{listed['id']}/settings").raise_for_status().json()
    assert settings["iso"]["value"] == 400
    refused = studio.http.patch(f"/cameras/{listed['id']}/settings", json={"iso": 401})
    assert refused.status_code == 422
    assert studio.http.get(f"/cameras/{listed['id']}/settings").json() == settings

    page.get_by_label("Flash of NIKON D5100").select_option("operator")
    tab_to(page, page.get_by_role("button", name="Capture with NIKON D5100"))
    page.keyboard.press("Enter")
    asked = page.get_by_role("region", name="What you are asked to do")
    expect(asked).to_contain_text("flash off")
    check_access(page, "operator")
    job_id = page.url.rpartition("/")[2]
    list_ = page.context.new_page()
    list_.goto(f"{studio.url}/")
    camera_now = list_.locator(".cameras li")
    expect(camera_now).to_contain_text("Waits for somebody")
    holder = list_.get_by_role("link", name="by this job")
    expect(holder).to_have_attribute("href", f"#/jobs/{job_id}")
    for words, order in (("flash off", "flash off"), ("flash on", "flash external")):
        expect(asked).to_contain_text(words)
        camera.order(order)
        tab_to(page, asked.get_by_role("button", name="Confirm"))
        page.keyboard.press("Enter")
    drawn(page)
    expect(camera_now).to_contain_text("Ready")
    job = studio.look({"links": {"self": f"/jobs/{job_id}"}})
    assert (job["state"], job["camera_settings"]["iso"]) == ("succeeded", 400)

    tab_to(page, strip(page, 1).get_by_role("slider", name="Exposure"))
    page.keyboard.press("ArrowLeft")
    tab_to(page, page.get_by_role("button", name="Render full size"))
    page.keyboard.press("Enter")
    tab_to(page, page.get_by_role("button", name="Download mix.jpg"))
    with page.expect_download() as saved:
        page.keyboard.press("Enter")
    with Image.open(saved.value.path()) as picture:
        assert picture.size == (96, 64)


def test_a_camera_tells_how_it_is_and_takes_settings(page: Page, done: dict[str, Any]) -> None:
    """As the service tells it of a camera that another job holds."""
    told = {"battery_percent": 71, "free_bytes": 3_100_000_000, "holder": done["id"], "waiting": 2}
    camera = {**CAMERA, **told}
    settings: dict[str, Any] = {
        "iso": {"value": 100, "choices": [100, 200, 400], "writable": True},
        "exposure_time": {"value": "1/30", "choices": None, "writable": False},
    }
    sent: list[Any] = []

    def change(route: Route) -> None:
        if route.request.method == "PATCH":
            sent.append(route.request.post_data_json)
            settings["iso"]["value"] = sent[-1]["iso"]
        route.fulfill(json=settings)

    def capture(route: Route) -> None:
        sent.append(route.request.post_data_json)
        route.fulfill(status=202, json={"jobs": [done]})

    idle = json.dumps([{**camera, "state": "idle", "holder": None, "waiting": 0}])
    page.route("**/cameras", lambda route: route.fulfill(json=[camera]))
    page.route(
        "**/cameras/events",
        lambda route: route.fulfill(content_type="text/event-stream", body=f"data: {idle}\n\n"),
    )
    page.route("**/cameras/c1/settings", change)
    page.route("**/cameras/c1/captures", capture)
    page.goto("/")
    expect(page.get_by_text("Ready · battery 71 % · 3.1 GB free")).to_be_visible()
    page.get_by_text("Settings").click()
    expect(page.get_by_text("Exposure time: 1/30")).to_be_visible()
    check_access(page, "camera")
    page.get_by_label("ISO").select_option("400")
    expect(page.get_by_role("status")).to_have_text("ISO is 400.")
    page.get_by_label("Flash of Nikon D5100").select_option("operator")
    page.get_by_role("button", name="Capture").click()
    page.wait_for_url(re.compile(done["id"]))
    assert sent == [{"iso": 400}, {"flash": "operator", "options": {}}]


@pytest.mark.parametrize("trouble", ["away", "held back"])
def test_cameras_are_kept_up_with_through_trouble(page: Page, trouble: str) -> None:
    tried: list[str] = []
    busy_seen: list[bool] = []

    def events(route: Route) -> None:
        tried.append(route.request.url)
        if trouble == "away" and (len(tried) == 1 or not busy_seen):
            route.fulfill(status=503, json={"title": "Away", "detail": "Away.", "status": 503})
        elif trouble == "away":
            body = f"data: {json.dumps([{**CAMERA, 'state': 'idle'}])}\n\n"
            route.fulfill(content_type="text/event-stream", body=body)

    def cameras(route: Route) -> None:
        route.fulfill(json=[{**CAMERA, "state": "idle" if tried and busy_seen else "capturing"}])

    page.route("**/cameras/events", events)
    page.route("**/cameras", cameras)
    page.goto("/")
    row = page.locator(".cameras li")
    expect(row).to_contain_text("Takes photographs")
    busy_seen.append(True)
    expect(row).to_contain_text("Ready")


def test_cameras_of_a_service_that_starts_anew_are_shown_once_it_has(page: Page) -> None:
    page.route("**/cameras", lambda route: route.abort())
    page.goto("/")
    told = page.locator(".cameras")
    expect(told).to_contain_text("No cameras are shown. The service does not answer")
    page.unroute("**/cameras")
    expect(page.get_by_role("button", name="Capture with NIKON D5100")).to_be_visible()
    expect(told).not_to_contain_text("No cameras are shown")


def test_a_camera_that_is_connected_while_the_page_is_open_is_shown(page: Page) -> None:
    camera = {"id": "c1", "address": "ptp+usb://", "make": "Nikon", "model": "D5100"}
    waits: list[Route] = []
    page.add_init_script(PATIENT)
    page.route("**/cameras", lambda route: route.fulfill(json=[]))
    page.route("**/cameras/events", lambda route: waits.append(route))
    with page.expect_request("**/cameras/events"):
        page.goto("/")
    heading = page.get_by_role("heading", name="Or let a connected camera take both")
    expect(heading).to_have_count(0)
    body = f"data: {json.dumps([{**camera, 'state': 'idle', 'waiting': 0}])}\n\n"
    waits[0].fulfill(content_type="text/event-stream", body=body)
    expect(heading).to_be_visible()
    expect(page.get_by_role("button", name="Capture with Nikon D5100")).to_be_enabled()


def test_a_camera_that_comes_later_is_named_then(page: Page) -> None:
    away = {
        "id": "c1",
        "address": "ptp+ip://192.168.1.20",
        "make": "",
        "model": "",
        "serial": "",
        "state": "away",
        "battery_percent": None,
        "free_bytes": None,
        "holder": None,
        "waiting": 0,
    }
    told: list[Any] = [{**away, "make": "Nikon", "model": "D5100", "state": "idle"}]
    waits: list[Route] = []
    page.add_init_script(PATIENT)
    page.route("**/cameras", lambda route: route.fulfill(json=[away]))
    page.route("**/cameras/events", lambda route: waits.append(route))
    with page.expect_request("**/cameras/events"):
        page.goto("/")
    row = page.locator(".cameras li")
    expect(row).to_contain_text("Not connected")
    expect(page.get_by_role("button", name=f"Capture with {away['address']}")).to_be_disabled()
    body = f"data: {json.dumps(told)}\n\n"
    waits[0].fulfill(content_type="text/event-stream", body=body)
    expect(page.get_by_role("button", name="Capture with Nikon D5100")).to_be_enabled()
    expect(row).to_have_count(1)
    expect(row).to_contain_text("Nikon D5100 ptp+ip://192.168.1.20")


def test_two_cameras_of_a_model_are_told_apart_by_who_sees_nothing(page: Page) -> None:
    two = [{**CAMERA, "id": at, "address": f"ptp+ip://{at}", "state": "idle"} for at in ("a", "b")]
    page.route("**/cameras/events", lambda route: route.abort())
    page.route("**/cameras", lambda route: route.fulfill(json=two))
    page.route("**/settings", lambda route: route.fulfill(json={}))
    page.route("**/captures", lambda route: route.abort())
    page.goto("/")
    for at in ("b", "a"):
        name = f"Nikon D5100 at ptp+ip://{at}"
        expect(page.get_by_label(f"Flash of {name}")).to_have_count(1)
        expect(page.get_by_label(f"Settings of {name}")).to_have_count(1)
        with page.expect_request(f"**/cameras/{at}/captures"):
            page.get_by_role("button", name=f"Capture with {name}").click()
        expect(page.get_by_role("alert")).to_contain_text("No connection")
