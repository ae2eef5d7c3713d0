"""Jobs that are run again from the page, in a real browser on a real service."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

import drivers
from tests.integration.service.page.looking import check_access, open_mixer


def test_a_pair_that_was_sent_the_wrong_way_round_is_swapped(
    page: Page, service: Any, pair: drivers.CapturedPair
) -> None:
    files = {"no_flash": pair.flash.best, "flash": pair.no_flash.best}
    wrong = service.await_end(service.http.post("/jobs", files=files).json())
    assert wrong["error"]["type"] == "urn:lightlayers:problem:swapped-pair"
    page.goto(f"/#/jobs/{wrong['id']}")
    expect(page.get_by_role("alert")).to_contain_text("swap the two")
    expect(page.get_by_role("button", name="Run again", exact=True)).to_be_hidden()
    check_access(page, "swapped")
    page.get_by_role("button", name="Swap and run again").click()
    page.wait_for_url(lambda url: wrong["id"] not in url)
    job = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    inputs = wrong["inputs"]
    assert job["inputs"] == {"no_flash": inputs["flash"], "flash": inputs["no_flash"]}
    assert service.await_end(job)["state"] == "succeeded"


def test_whether_to_swap_is_told_by_the_type_of_the_problem(
    page: Page, done: dict[str, Any]
) -> None:
    error = {"type": "urn:lightlayers:problem:unusable-pair", "title": "No", "status": 422}
    error |= {"detail": "The pair is black: swap the two.", "retryable": False, "trace_id": ""}
    failed = {**done, "state": "failed", "error": error, "files": []}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=failed))
    page.route("**/rerun", lambda route: route.abort())
    page.goto(f"/#/jobs/{done['id']}")
    with page.expect_request("**/rerun") as sent:
        page.get_by_role("button", name="Run again", exact=True).click()
    assert sent.value.post_data_json == {}
    expect(page.get_by_role("alert").last).to_contain_text("No connection")


def test_calibrations_of_lamps_are_offered_however_old_they_are(
    page: Page, done: dict[str, Any]
) -> None:
    asked: list[str] = []
    made_with = {"make": "NIKON", "model": "D5100", "upright": True}
    lamps = {**done, "id": "lamps", "options": {"kind": "lamps"}, "created": "2030-01-01T12:00:00Z"}
    lamps["taken_with"] = made_with
    lying = {**lamps, "taken_with": {**made_with, "upright": False}}
    nameless = {**lamps, "taken_with": {"make": "", "model": "", "upright": None}}
    more = f"/jobs?limit=200&after=1764085200.5-{done['id']}"

    def jobs(route: Route) -> None:
        asked.append(route.request.url.partition("/jobs")[2])
        last = "after=" in route.request.url
        made = [lamps, lying, nameless, {**lamps, "state": "failed"}] if last else [done]
        route.fulfill(json={"jobs": made, "next": None if last else more})

    page.route(re.compile(r"/jobs\?"), jobs)
    page.route("**/rerun", lambda route: route.fulfill(status=202, json=done))
    open_mixer(page, done)
    page.get_by_text("Find the surface").click()
    choice = page.get_by_label("Where the lamps stand")
    expect(choice.get_by_role("option")).to_have_text(
        [
            "As set on the balls",
            re.compile(r"^Calibration of Jan 1, 2030.*, NIKON D5100, upright pictures$"),
            re.compile(r"^Calibration of Jan 1, 2030.*, NIKON D5100, pictures that lie$"),
            re.compile(r"^Calibration of Jan 1, 2030.*[AP]M, camera not known$"),
        ]
    )
    choice.select_option(index=1)
    with page.expect_request("**/rerun") as sent:
        page.get_by_role("button", name="Find normals").click()
    wanted = (sent.value.post_data_json or {})["options"]
    assert wanted["light_directions"] == {"calibration": "lamps"}
    assert asked == ["?limit=200", more.removeprefix("/jobs")]


def test_calibrations_of_lamps_that_did_not_come_are_asked_for_again(
    page: Page, done: dict[str, Any]
) -> None:
    """With the next look at the form."""
    lamps = {**done, "options": {"kind": "lamps"}, "created": "2030-01-01T12:00:00Z"}
    lamps["taken_with"] = {"make": "NIKON", "model": "D5100", "upright": True}
    page.route(re.compile(r"/jobs\?"), lambda route: route.abort())
    open_mixer(page, done)
    form = page.get_by_text("Find the surface")
    with page.expect_event("requestfailed", lambda one: "/jobs?" in one.url):
        form.click()
    page.unroute(re.compile(r"/jobs\?"))
    listed = {"jobs": [lamps], "next": None}
    page.route(re.compile(r"/jobs\?"), lambda route: route.fulfill(json=listed))
    form.click()
    form.click()
    expect(page.get_by_label("Where the lamps stand").get_by_role("option")).to_have_count(2)


def test_a_calibration_without_a_pair_is_run_again(page: Page, service: Any) -> None:
    wanted = {"capture": {"camera": "sim://studio?fault=store_full"}, "options": {"kind": "flash"}}
    made = service.http.post("/calibrations", json=wanted).raise_for_status().json()
    assert service.await_end(made)["state"] == "failed"
    page.goto(f"/#/jobs/{made['id']}")
    page.get_by_role("button", name="Run again").click()
    page.wait_for_url(lambda url: made["id"] not in url)
    again = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    assert (again["options"]["kind"], again["capture"]) == ("flash", made["capture"])
    expect(page).to_have_title(re.compile(f"^Failed: .* {again['id'][:8]}"))  # not the first one's
    expect(page.get_by_role("alert")).to_contain_text("memory card is full")


def test_lamps_are_given_directions_for_normals(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    open_mixer(page, done)
    page.get_by_text("Find the surface").click()
    page.get_by_label("Lamp 1 from the left to the right").fill("-0.6")
    page.get_by_label("Lamp 1 from below to above").fill("0")
    check_access(page, "directions")
    page.get_by_role("button", name="Find normals").click()
    page.wait_for_url(lambda url: done["id"] not in url)
    job = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    first, second = job["options"]["light_directions"]
    assert first["direction"] == pytest.approx([-0.6, 0, 0.8])
    assert second["direction"] == pytest.approx([0.5, 0.5, 0.5**0.5])
    manifest = service.http.get(f"/jobs/{done['id']}/results").json()
    # which lamp is meant, and no more: colours of all lights would count as measured
    assert (first["rgb"], second.get("rgb")) == (manifest["lamps"][0]["rgb"], None)
    assert "normals.png" in job["options"]["outputs"]
    assert job["options"]["lights"] == 2
    service.http.post(f"/jobs/{job['id']}/cancel").raise_for_status()  # unless it has ended


def test_another_number_and_another_ratio_are_asked_for_where_warnings_say_so(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    manifest = service.http.get(f"/jobs/{done['id']}/results").json()
    codes = ["number_uncertain", "exposure_mismatch", "rendered_srgb"]
    warnings = [{"code": code, "message": f"Told: {code}.", "figures": {}} for code in codes]
    warnings[1]["figures"] = {"ratio": 1.0, "ratio_shown": 0.998}
    path = f"**/jobs/{done['id']}/results"
    page.route(path, lambda route: route.fulfill(json={**manifest, "warnings": warnings}))
    open_mixer(page, done)
    lamps = page.get_by_role("combobox", name="Lamps")
    ratio = page.get_by_role("spinbutton", name="Exposure ratio")
    expect(lamps).to_be_hidden()
    page.get_by_role("button", name="Change the number: Told: number_uncertain.").click()
    expect(lamps).to_be_focused()
    expect(lamps).to_have_value("2")  # as the job was asked for
    lamps.select_option("1")
    page.get_by_role("button", name="Change the ratio: Told: exposure_mismatch.").click()
    expect(ratio).to_be_focused()
    expect(ratio).to_have_value("0.998")  # which fits, as the warning says
    expect(page.get_by_role("button", name="Change the")).to_have_count(2)
    check_access(page, "otherwise")
    page.get_by_role("button", name="Separate with these").click()
    page.wait_for_url(lambda url: done["id"] not in url)
    job = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    service.http.post(f"/jobs/{job['id']}/cancel").raise_for_status()
    assert job["options"] == {**done["options"], "lights": 1, "exposure_ratio": 0.998}
    assert job["inputs"] == done["inputs"]


def test_a_separation_that_failed_is_asked_for_otherwise(page: Page, done: dict[str, Any]) -> None:
    """What was asked for may be taken back; what is refused is told there."""
    error = {"type": "urn:lightlayers:problem:invalid-option", "title": "No", "status": 422}
    error |= {"detail": "The ratio is wrong.", "retryable": False, "trace_id": ""}
    options = {"lights": 3, "exposure_ratio": 4.5, "quality": "fast"}
    failed = {**done, "state": "failed", "error": error, "files": [], "options": options}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=failed))
    page.route("**/rerun", lambda route: route.fulfill(status=422, json=error))
    page.goto(f"/#/jobs/{done['id']}")
    page.get_by_text("Number of lamps, exposure ratio").click()
    expect(page.get_by_role("combobox", name="Lamps")).to_have_value("3")
    ratio = page.get_by_role("spinbutton", name="Exposure ratio")
    expect(ratio).to_have_value("4.5")
    ratio.fill("-1")  # which the form itself refuses
    page.get_by_role("button", name="Separate with these").click()
    assert ratio.evaluate("(field) => field.validity.rangeUnderflow")
    page.get_by_role("combobox", name="Lamps").select_option("Find out")
    ratio.fill("")
    with page.expect_request("**/rerun") as sent:
        page.get_by_role("button", name="Separate with these").click()
    assert sent.value.post_data_json == {"options": {"quality": "fast"}}
    expect(page.get_by_role("alert").last).to_contain_text("The ratio is wrong.")


@pytest.mark.parametrize(
    "changed", [{"options": {"kind": "flash"}}, {"inputs": None}, {"state": "expired"}]
)
def test_what_is_no_pair_to_be_separated_is_not_asked_for_otherwise(
    page: Page, done: dict[str, Any], changed: dict[str, Any]
) -> None:
    failed = {**done, "state": "failed", "files": [], **changed}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=failed))
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.get_by_role("button", name="Delete")).to_be_visible()
    expect(page.get_by_text("Number of lamps, exposure ratio")).to_have_count(0)


@pytest.mark.parametrize("has_inputs", [True, False])
def test_photographs_that_cannot_be_read_are_not_run_again(
    page: Page, done: dict[str, Any], has_inputs: bool
) -> None:
    """A camera that took none takes others."""
    error = {"type": "urn:lightlayers:problem:unreadable-image", "title": "No", "status": 422}
    error |= {"detail": "It is damaged: send it again.", "retryable": False, "trace_id": ""}
    failed = {**done, "state": "failed", "error": error, "files": []}
    failed |= {} if has_inputs else {"inputs": None, "capture": {"camera": "sim://studio"}}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=failed))
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.get_by_role("alert")).to_contain_text("It is damaged")
    expect(page.get_by_role("link", name="Add two photographs")).to_be_visible()
    expect(page.get_by_role("button", name="Run again")).to_have_count(0 if has_inputs else 1)
    expect(page.get_by_text("Number of lamps, exposure ratio")).to_have_count(0)
