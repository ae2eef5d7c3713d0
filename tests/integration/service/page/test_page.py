"""The page in a real browser, on a real service."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import FilePayload, Page, expect

import drivers
from pipeline.decode.exr import read_exr
from pipeline.encode.jpeg import to_srgb8
from pipeline.mixes.mix import mix_matrices
from pipeline.mixes.mix_options import LampMix, Mix, MixBasis
from tests.integration.service.page.looking import (
    PATIENT,
    TWO_FRAMES,
    check_access,
    drawn,
    give_key,
    open_mixer,
    open_normals,
    result,
    shown,
    strip,
    tab_to,
)


def test_a_pair_is_added_watched_mixed_saved_and_rendered(
    page: Page, service: Any, pair: drivers.CapturedPair, tmp_path: Path
) -> None:
    page.goto("/")
    check_access(page, "add")
    for label, shot in (("Without the flash", pair.no_flash), ("With the flash", pair.flash)):
        file: FilePayload = {
            "name": f"{label}.dng",
            "mimeType": "image/x-adobe-dng",
            "buffer": shot.best,
        }
        page.get_by_label(f"Choose a file: {label}").set_input_files(file)
    page.get_by_role("button", name="Separate the light").click()
    expect(page.locator(".steps").get_by_text("Find the lamps")).to_be_visible()
    drawn(page)
    job = service.look({"links": {"self": f"/jobs/{page.url.rpartition('/')[2]}"}})
    assert job["options"] == {}

    photograph = read_exr(result(service, job, "layers.exr")).values
    size = photograph.shape[1], photograph.shape[0]
    manifest = json.loads(result(service, job, "manifest.json"))
    neutral = Mix(lamps=[LampMix(), LampMix()])
    to_srgb = mix_matrices(MixBasis.model_validate(manifest["mix"]), neutral)[0]
    untouched = shown(page, size)
    # half floats of layers round otherwise than those of their sum: a code or two, and four where
    # the darkest channel of a colour that the screen cannot show is moved into its range
    off = np.abs(untouched - to_srgb8(photograph, to_srgb))
    assert off.max() <= 4 and np.count_nonzero(off > 2) <= 5

    warm, cool = strip(page, 1), strip(page, 2)
    warm.get_by_role("slider", name="Exposure").fill("-1.5")
    warm.get_by_label("Neutral").check(force=True)
    cool.get_by_label("Kelvin").check(force=True)
    cool.get_by_role("slider", name="Temperature").fill(str(-1e6 / 3200))
    cool.get_by_role("slider", name="Tint").fill("12")
    page.get_by_label("Format").select_option("exr")
    page.get_by_role("button", name="Render full size").click()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Download mix.exr").click()
    saved.value.save_as(tmp_path / "mix.exr")
    rendered = to_srgb8(read_exr((tmp_path / "mix.exr").read_bytes()).values)
    mixed = shown(page, size)
    off = np.abs(mixed - rendered)
    assert off.max() <= 4 and np.count_nonzero(off > 2) <= 5
    assert np.abs(mixed - untouched).mean() > 10

    with page.expect_download() as saved:
        page.get_by_role("button", name="Save preset").click()
    preset = json.loads(Path(saved.value.path()).read_text())
    assert preset["lamps"][0] == {**LampMix().model_dump(mode="json"), "ev": -1.5, "neutral": True}
    assert preset["lamps"][1]["tint"] == 12
    page.get_by_role("button", name="Reset", exact=True).click()
    # without a graphics card the lamp that changed last is added last: sums differ by rounding
    assert np.abs(shown(page, size) - untouched).max() <= 1
    page.get_by_label("Load preset").set_input_files(saved.value.path())
    expect(strip(page, 2).get_by_role("slider", name="Tint")).to_have_value("12")
    assert np.abs(shown(page, size) - mixed).max() <= 1


def test_a_job_is_watched_by_everyone(page: Page, done: dict[str, Any]) -> None:
    running = {**done, "state": "running", "stage": "lamps", "fraction": 0.5}
    page.route(f"**/jobs/{done['id']}", lambda route: route.fulfill(json=running))
    page.route("**/events", lambda route: route.abort())
    page.goto(f"/#/jobs/{done['id']}")
    expect(page.locator(".steps").get_by_text("Find the lamps")).to_be_visible()
    check_access(page, "watch")


def test_a_mix_is_heard_and_seen_by_everyone(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done)
    strip(page, 1).get_by_label("Gel").check(force=True)
    strip(page, 2).get_by_label("Kelvin").check(force=True)
    page.get_by_text("Files", exact=True).click()
    drawn(page)
    check_access(page, "mixer")
    page.emulate_media(color_scheme="light")
    page.evaluate(TWO_FRAMES)  # before which it is not drawn anew
    drawn(page)
    check_access(page, "mixer_light")
    page.goto("/#/jobs")
    expect(page.locator(".jobs img").first).to_be_visible()
    check_access(page, "jobs")


def test_one_lamp_alone_is_its_layer(page: Page, done: dict[str, Any], service: Any) -> None:
    open_mixer(page, done)
    layers = read_exr(result(service, done, "layers.exr")).values
    size = layers.shape[1], layers.shape[0]
    page.get_by_role("button", name="Solo Lamp 2").click()
    soloed = shown(page, size)
    page.get_by_role("button", name="Solo Lamp 2").click()
    page.get_by_role("button", name="Lamp 1 on").click()
    assert np.abs(shown(page, size) - soloed).max() <= 1
    page.get_by_role("radio", name="Lamp 1", exact=True).check(force=True)
    other = shown(page, size)
    assert np.abs(other - soloed).mean() > 10
    page.get_by_role("radio", name="Mix").check(force=True)
    page.get_by_label("Before").fill("100")
    before = shown(page, size)
    assert before[:, 2:-2].mean() > max(soloed.mean(), other.mean())


def test_every_picture_can_be_looked_at(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done)
    for name in ("Why these lamps", "Unexplained"):
        page.get_by_role("radio", name=name).check(force=True)
        expect(page.get_by_role("img", name=name)).to_be_visible()
        expect(page.locator(".picture img")).not_to_have_js_property("naturalWidth", 0)
    check_access(page, "unexplained")


def test_normals_are_lit_from_where_the_pointer_is(
    page: Page, done: dict[str, Any], tmp_path: Path
) -> None:
    """Those of a ball: a job that finds normals takes too long here."""
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 240), np.linspace(0.8, -0.8, 160))
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    ball = np.where((z > 0)[..., None], np.stack([x, y, z], -1), np.nan).astype(np.float32)
    canvas = open_normals(page, done, ball, tmp_path)
    box = canvas.bounding_box()
    assert box is not None

    def lit_from(part: float) -> tuple[float, float]:
        """Mean brightness of the left and the right half, the light at this part of the width."""
        canvas.hover(position={"x": box["width"] * part, "y": box["height"] / 2})
        page.evaluate(TWO_FRAMES)
        grey = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("L")).astype(float)
        middle = grey.shape[1] // 2
        return float(grey[:, :middle].mean()), float(grey[:, middle:].mean())

    left, right = lit_from(0.05), lit_from(0.95)
    assert left[0] > 1.5 * left[1]
    assert right[1] > 1.5 * right[0]
    assert left == pytest.approx(right[::-1], abs=2)
    check_access(page, "normals")


def test_keys_do_all_that_pointers_do(page: Page, done: dict[str, Any]) -> None:
    page.on("filechooser", lambda _: None)  # so that choosers are taken from here on
    open_mixer(page, done)
    before = page.locator("#mix").screenshot()

    exposure = strip(page, 1).get_by_role("slider", name="Exposure")
    tab_to(page, exposure)
    for _ in range(10):
        page.keyboard.press("ArrowLeft")
    expect(exposure).to_have_attribute("aria-valuetext", "−0.50 EV")
    tab_to(page, strip(page, 1).get_by_role("radio", name="As shot"))
    page.keyboard.press("ArrowRight")
    expect(strip(page, 1).get_by_role("radio", name="Neutral")).to_be_checked()
    solo = page.get_by_role("button", name="Solo Lamp 2")
    tab_to(page, solo)
    page.keyboard.press("Space")
    expect(solo).to_have_attribute("aria-pressed", "true")
    drawn(page)
    assert page.locator("#mix").screenshot() != before
    page.keyboard.press("Space")
    page.goto("/#/")
    tab_to(page, page.get_by_label("Choose a file: Without the flash"))
    with page.expect_file_chooser():
        page.keyboard.press("Enter")


def test_the_picture_is_enlarged_and_moved_by_keys(page: Page, done: dict[str, Any]) -> None:
    canvas = open_mixer(page, done)
    canvas.focus()
    whole = canvas.screenshot()
    seen = [whole]
    for key in ("+", "+", "+", "+", "ArrowRight"):
        page.keyboard.press(key)
    drawn(page)
    seen.append(canvas.screenshot())
    page.keyboard.press("ArrowDown")
    drawn(page)
    seen.append(canvas.screenshot())
    assert len(set(seen)) == 3
    page.keyboard.press("0")
    drawn(page)
    assert canvas.screenshot() == whole


def test_a_phone_has_picture_and_lamps_at_once(phone: Page, done: dict[str, Any]) -> None:
    phone.goto("/")
    expect(phone.get_by_text("Use the camera").first).to_be_visible()
    assert phone.locator("input[capture=environment]").count() == 2
    check_access(phone, "phone_add")
    canvas = open_mixer(phone, done)
    strip(phone, 2).get_by_role("slider", name="Exposure").fill("1")
    strip(phone, 2).get_by_role("slider", name="Exposure").scroll_into_view_if_needed()
    drawn(phone)
    expect(canvas).to_be_in_viewport(ratio=0.9)
    check_access(phone, "phone")
    assert phone.evaluate("document.documentElement.scrollWidth") == 390


def test_a_phone_held_across_has_the_picture_beside_the_lamps(
    phone: Page, done: dict[str, Any]
) -> None:
    phone.set_viewport_size({"width": 844, "height": 390})
    canvas = open_mixer(phone, done)
    expect(strip(phone, 1)).to_be_in_viewport(ratio=0.9)
    picture, lamp = canvas.bounding_box(), strip(phone, 1).bounding_box()
    assert picture is not None
    assert lamp is not None
    assert picture["height"] > 390 / 2
    assert picture["x"] + picture["width"] <= lamp["x"]
    check_access(phone, "phone_across")


def test_a_bad_preset_is_told_in_words(page: Page, done: dict[str, Any]) -> None:
    open_mixer(page, done)
    for text, words in (
        ("{", "not JSON"),
        ("null", "no list of lamps"),
        ('{"lamps": [{}]}', "one for 1 lamp, and"),
        ('{"lamps": [{"ev": 99}, {}]}', "out of its range"),
        ('{"lamps": [null, {}]}', "out of its range"),
        ('{"lamps": [{}, {"tint": 5}]}', "a tint without a temperature"),
        ('{"lamps": [{}, {}], "gamma": 2}', 'has "gamma" beside its lamps, which is not known'),
    ):
        file: FilePayload = {
            "name": "mix.json",
            "mimeType": "application/json",
            "buffer": text.encode(),
        }
        page.get_by_label("Load preset").set_input_files(file)
        expect(page.get_by_role("alert")).to_contain_text(words)


def test_a_mix_that_cannot_be_fetched_is_told_in_words(page: Page, done: dict[str, Any]) -> None:
    file = {"name": "mix.jpg", "size": 1000, "href": "/jobs/mixed/results/mix.jpg"}
    mixed = {**done, "id": "mixed", "files": [file]}
    problem = {"type": "x", "title": "No storage", "detail": "It does not answer.", "status": 503}
    page.route("**/mix", lambda route: route.fulfill(status=202, json=mixed))
    page.route("**/jobs/mixed", lambda route: route.fulfill(json=mixed))
    page.route("**/mix.jpg", lambda route: route.fulfill(status=503, json=problem))
    open_mixer(page, done)
    page.get_by_role("button", name="Render full size").click()
    fetch = page.get_by_role("button", name="Download mix.jpg")
    fetch.wait_for()
    for _ in range(2):
        fetch.click()
        expect(page.get_by_role("alert")).to_have_count(1)
        expect(page.get_by_role("alert")).to_contain_text("It does not answer.")


def test_a_rendering_is_watched_no_longer_than_its_mixer(
    page: Page, done: dict[str, Any], unending: dict[str, Any]
) -> None:
    """As one that takes long: another job that is under way."""
    page.add_init_script(PATIENT)
    page.route("**/mix", lambda route: route.fulfill(status=202, json=unending))
    open_mixer(page, done)
    with page.expect_response("**/events"):
        page.get_by_role("button", name="Render full size").click()
    with page.expect_event("requestfailed", lambda request: request.url.endswith("/events")):
        page.goto("/#/jobs")


def test_a_picture_that_cannot_be_fetched_is_told_in_words_and_tried_again(
    page: Page, done: dict[str, Any]
) -> None:
    problem = {"type": "x", "title": "No storage", "detail": "It does not answer.", "status": 503}
    page.route("**/gamma.png", lambda route: route.fulfill(status=503, json=problem))
    open_mixer(page, done)
    look = page.get_by_role("radio", name="Why these lamps")
    look.check(force=True)
    expect(page.get_by_role("alert")).to_contain_text("It does not answer.")
    page.unroute("**/gamma.png")
    page.get_by_role("radio", name="Mix").check(force=True)
    expect(page.get_by_role("alert")).to_have_count(0)
    look.check(force=True)
    picture = page.get_by_role("img", name="Why these lamps")
    expect(picture).not_to_have_js_property("naturalWidth", 0)
    expect(page.get_by_role("alert")).to_have_count(0)


def test_layers_that_cannot_be_fetched_leave_all_else(
    page: Page, done: dict[str, Any], service: Any
) -> None:
    manifest = json.loads(result(service, done, "manifest.json"))
    manifest["warnings"] = [{"code": "clipped", "message": "Expose less.", "figures": {}}]
    problem = {"type": "x", "title": "No storage", "detail": "It does not answer.", "status": 503}
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    page.route("**/preview.exr", lambda route: route.fulfill(status=503, json=problem))
    page.goto(f"/#/jobs/{done['id']}")
    alert = page.locator(".picture").get_by_role("alert")
    expect(alert).to_contain_text("It does not answer.")
    expect(page.get_by_text("Expose less.")).to_be_visible()
    page.get_by_text("Files", exact=True).click()
    expect(page.get_by_role("button", name="layers.exr")).to_be_visible()
    expect(page.get_by_role("button", name="Run again")).to_be_visible()
    check_access(page, "no_layers")
    page.get_by_role("radio", name="Why these lamps").check(force=True)
    expect(page.get_by_role("img", name="Why these lamps")).to_be_visible()
    page.get_by_role("radio", name="Mix").check(force=True)
    expect(alert).to_be_visible()


def test_a_thumbnail_that_cannot_be_fetched_is_done_without(
    page: Page, done: dict[str, Any]
) -> None:
    """With a key, with which the page fetches it itself."""

    give_key(page)
    page.route("**/thumbnail.jpg", lambda route: route.abort())
    with page.expect_event("requestfailed", lambda one: one.url.endswith("/thumbnail.jpg")):
        open_mixer(page, done)
    expect(page.get_by_role("alert")).to_have_count(0)
    expect(page.get_by_role("button", name="Run again")).to_be_visible()


def test_a_warning_shows_where(page: Page, done: dict[str, Any], service: Any) -> None:
    """One that this pair does not give is added to what the service answers."""
    manifest = json.loads(result(service, done, "manifest.json"))
    message = "12 % of the picture is clipped: expose less."
    manifest["warnings"] = [{"code": "clipped", "message": message, "figures": {"share": 0.12}}]
    page.route("**/results", lambda route: route.fulfill(json=manifest))
    canvas = open_mixer(page, done)
    expect(page.get_by_text(message)).to_be_visible()
    expect(page.get_by_text("clipped · share 0.12")).to_be_visible()
    plain = canvas.screenshot()
    page.get_by_role("button", name="Show where").click()
    drawn(page)
    assert canvas.screenshot() != plain


def test_a_key_is_asked_for_and_forgotten_with_the_tab(page: Page) -> None:
    def guard(route: Any) -> None:
        headers = route.request.headers
        if headers.pop("authorization", None) == "Bearer open sesame":
            route.continue_(headers=headers)  # without the key, which the service itself refuses
        else:
            problem = {"type": "x", "title": "No key", "detail": "Send a key.", "status": 401}
            route.fulfill(status=401, json=problem)

    page.route(re.compile(r":\d+/jobs[/?]"), guard)  # of thumbnails, too
    page.goto("/#/jobs")
    key = page.get_by_role("textbox", name="Key")
    expect(key).to_be_visible()
    expect(page.get_by_text("did not take that key")).to_be_hidden()
    check_access(page, "key")
    for wrong in ("open please", "open …"):  # no header can carry the second
        key.fill(wrong)
        page.keyboard.press("Enter")
        expect(key).to_have_value("")
        expect(page.get_by_text("did not take that key")).to_be_visible()
    key.fill("open sesame")
    with page.expect_response(lambda answer: "/jobs?" in answer.url and answer.ok):
        page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Jobs")).to_be_visible()
    expect(page.locator("#key")).to_be_hidden()
    assert page.evaluate("Object.values(sessionStorage)") == ["open sesame"]
    assert page.evaluate("localStorage.length + document.cookie.length") == 0


def test_a_key_that_came_meanwhile_is_tried_before_another_is_asked_for(page: Page) -> None:
    held: list[Any] = []
    problem = {"type": "x", "title": "No key", "detail": "Send a key.", "status": 401}

    def guard(route: Any) -> None:
        headers = route.request.headers
        keyed = headers.pop("authorization", None) == "Bearer open sesame"
        if "/jobs?" not in route.request.url:
            route.continue_(headers=headers)  # without the key, which the service itself refuses
        elif keyed:
            route.fulfill(json={"jobs": [], "next": None})
        elif "limit=2" in route.request.url:
            held.append(route)
        else:
            route.fulfill(status=401, json=problem)

    page.route(re.compile(r":\d+/(?!page/)"), guard)
    page.goto("/")
    page.evaluate(
        """async () => {
            const { get } = await import("/page/api.js");
            window.answers = Promise.all([get("/jobs?limit=2"), get("/jobs?limit=1")]);
        }"""
    )
    page.get_by_role("textbox", name="Key").fill("open sesame")
    with page.expect_response(lambda answer: "limit=1" in answer.url and answer.ok):
        page.keyboard.press("Enter")
    held[0].fulfill(status=401, json=problem)
    assert page.evaluate("window.answers") == [{"jobs": [], "next": None}] * 2
    expect(page.locator("#key")).to_be_hidden()


def test_a_key_that_is_not_for_this_is_changed(page: Page) -> None:
    def guard(route: Any) -> None:
        headers = route.request.headers
        key = headers.pop("authorization", None)
        problem = {"type": "urn:lightlayers:problem:forbidden", "title": "Not for this"}
        if key == "Bearer open sesame":
            route.continue_(headers=headers)  # without the key, which the service itself refuses
        else:
            route.fulfill(status=403, json={**problem, "detail": "No read.", "status": 403})

    page.route(re.compile(r":\d+/jobs[/?]"), guard)
    page.add_init_script("sessionStorage.setItem('lightlayers-key', 'other')")
    page.goto("/#/jobs")
    change = page.get_by_role("alert").get_by_role("button", name="Use another key")
    key = page.get_by_role("textbox", name="Key")
    change.click()
    expect(page.get_by_text("did not take that key")).to_be_hidden()
    page.keyboard.press("Escape")  # nothing has changed
    assert page.evaluate("sessionStorage.getItem('lightlayers-key')") == "other"
    change.click()
    key.fill("open sesame")
    with page.expect_response(lambda answer: "/jobs?" in answer.url and answer.ok):
        page.keyboard.press("Enter")
    expect(page.get_by_role("alert")).to_have_count(0)
    assert page.evaluate("Object.values(sessionStorage)") == ["open sesame"]


def test_the_page_and_the_service_compute_the_same(page: Page) -> None:
    """Matrices of 101 mixes, those of lamps of one colour and of whites that no light has, too."""
    rng = np.random.default_rng(5)
    basis = {
        "to_xyz": rng.normal(0, 1, (3, 3)).tolist(),
        "neutral": [0.95, 1.0, 1.09],
        "lamps": [
            {"white": white, "own_white": own, "neutral_to_xyz": rng.normal(0, 1, (3, 3)).tolist()}
            for white, own in (
                ([1.1, 1.0, 0.35], [1.0, 1.0, 0.6]),
                ([2.0, 1.0, -0.1], None),
                ([-4.6, 1.0, -36.6], None),
            )
        ],
    }
    mixes = [[_settings(rng) for _ in range(3)] for _ in range(100)]
    mixes.append([_settings(rng) | {"on": True, "temperature_k": 2500, "tint": -150}] * 3)
    page.goto("/")
    found = page.evaluate(
        """async ([basis, mixes]) => {
          const { lampMatrix } = await import("/page/mix.js");
          return mixes.map((mix) => mix.map((one, lamp) => lampMatrix(basis, lamp, one)));
        }""",
        [basis, mixes],
    )
    checked = MixBasis.model_validate(basis)
    for mix, matrices in zip(mixes, found, strict=True):
        wanted = mix_matrices(checked, Mix.model_validate({"lamps": mix}))
        np.testing.assert_allclose(np.reshape(matrices, (3, 3, 3)), wanted, rtol=1e-9, atol=1e-9)


def _settings(rng: np.random.Generator) -> dict[str, Any]:
    temperature_k = rng.uniform(1000, 15000) if rng.random() < 0.7 else None
    return {
        "on": bool(rng.random() < 0.9),
        "ev": rng.uniform(-5, 5),
        "neutral": bool(rng.random() < 0.5),
        "temperature_k": temperature_k,
        "tint": 0.0 if temperature_k is None else rng.uniform(-150, 150),
        "rgb": rng.uniform(0, 1, 3).tolist(),
    }
