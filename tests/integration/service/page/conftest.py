"""Debian's Chromium, and a job to look at."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

import drivers
from tests.chromium import find_chromium
from tests.integration.service.page.looking import PATIENCE_MS, SHOTS


@pytest.fixture(scope="package")  # its event loop would be in the way of other tests
def browser(lacking: Callable[[str], NoReturn]) -> Iterator[Browser]:
    program = find_chromium()
    if program is None:
        lacking("chromium")
    SHOTS.mkdir(parents=True, exist_ok=True)
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--force-color-profile=srgb"]
        )
        yield browser
        browser.close()


@pytest.fixture
def page(browser: Browser, service: Any) -> Iterator[Page]:
    yield from _page(browser, service, viewport={"width": 1280, "height": 800}, color_scheme="dark")


@pytest.fixture
def phone(browser: Browser, service: Any) -> Iterator[Page]:
    yield from _page(
        browser,
        service,
        viewport={"width": 390, "height": 844},
        color_scheme="light",
        has_touch=True,
        is_mobile=True,
    )


def _page(browser: Browser, service: Any, **more: Any) -> Iterator[Page]:
    # no colour is on its way to another while its contrast is measured
    context = browser.new_context(base_url=service.url, reduced_motion="reduce", **more)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    yield page
    context.close()
    assert errors == []


@pytest.fixture
def unending(service: Any) -> Iterator[dict[str, Any]]:
    """A job that waits five minutes for somebody to switch the flash."""
    job: dict[str, Any] = service.capture("sim://studio", flash="operator")
    yield job
    service.http.post(f"/jobs/{job['id']}/cancel").raise_for_status()  # else it kept the camera


@pytest.fixture(scope="package")
def done(service: Any, pair: drivers.CapturedPair) -> dict[str, Any]:
    """A job whose preview is as large as its photograph."""
    files = {"no_flash": pair.no_flash.best, "flash": pair.flash.best}
    outputs = ["layers.exr", "preview.exr", "thumbnail.jpg", "gamma.png", "residual.png"]
    options = {"outputs": outputs, "quality": "fast", "lights": 2}
    answer = service.http.post("/jobs", files=files, data={"options": json.dumps(options)})
    job: dict[str, Any] = service.await_end(answer.json())
    assert job["state"] == "succeeded", job
    return job
