"""A camera on the network, used from the page, in a real browser on a real service."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Page, expect

import drivers
from tests.integration.service.page.looking import check_access, drawn, strip, tab_to


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
