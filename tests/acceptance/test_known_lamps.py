"""Pinned and forbidden lamps, by command line and HTTP, in a room without shadows.

A bulb fades to the right, where the window's light comes in; no place is lit by the window alone,
so that the photographs do not tell its colour.
"""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import tifffile

from pipeline.arrays import Floats32, Floats64
from pipeline.spectra.colour_science import colour_science, without_warnings
from pipeline.spectra.lights import find_light, reflectance_spectra
from pipeline.spectra.wavelengths import on_grid

FLAGS = ("--camera", "Nikon D5100", "--no-align", "--lights", 2, "--outputs", "layers.exr")
OPTIONS = {"camera": "Nikon D5100", "align": False, "lights": 2, "outputs": ["layers.exr"]}
WIDTH, HEIGHT, PATCH = 180, 120, 6
BULB, MIXED = "8,60,7", "172,60,7"
FAR_AWAY = "180,60,7"


@dataclass(frozen=True)
class Room:
    """files: no-flash and flash photograph. layers: (2, H, W, 3), the bulb's and the window's."""

    files: tuple[Path, Path]
    layers: Floats32


def sensitivities() -> Floats64:
    """(3, W) of the camera."""
    with without_warnings():
        table = colour_science().MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
    return on_grid(table.wavelengths, table.values, "zero").T


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Room:
    s = sensitivities()
    surfaces = reflectance_spectra()
    picked = np.random.default_rng(3).integers(0, len(surfaces), (HEIGHT // PATCH, WIDTH // PATCH))
    rho = surfaces[picked].repeat(PATCH, axis=0).repeat(PATCH, axis=1)

    def lit(name: str) -> Any:
        light = find_light(name)
        return rho @ (s * light).T / (s[1] @ light)

    v, u = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]
    window = np.clip(0.45 * (u - 0.12), 0, None) * (0.6 + 0.4 * v)
    layers = np.stack([(0.5 - 0.35 * u)[..., None] * lit("A"), window[..., None] * lit("D65")])
    flash = (0.6 - 0.3 * (v - 0.5) ** 2)[..., None] * lit("xenon")
    scale = 0.45 / max(layers.sum(axis=0).max(), flash.max())
    folder = tmp_path_factory.mktemp("room")
    files = folder / "no_flash.tif", folder / "flash.tif"
    light = layers.sum(axis=0)
    for file, picture in zip(files, (light, light + flash), strict=True):
        pixels = (scale * picture).astype(np.float32)
        tifffile.imwrite(file, pixels, photometric="rgb", metadata=None)
    return Room(files, (scale * layers).astype(np.float32))


def joint_snr_db(room: Room, layers: Floats32) -> float:
    """Of both layers together, in the better order."""
    errors = [
        np.square(layers[list(order)] - room.layers).sum()
        for order in itertools.permutations((0, 1))
    ]
    return float(10 * np.log10(np.square(room.layers).sum() / min(errors)))


def angle(rgb: list[float], other: list[float]) -> float:
    a, b = np.array(rgb), np.array(other)
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


@pytest.fixture(scope="module")
def plain(room: Room, separated: Callable[..., Any]) -> Any:
    """What the photographs give by themselves."""
    return separated(room.files, *FLAGS)


def test_pins_tell_what_the_photographs_do_not(
    room: Room, plain: Any, separated: Callable[..., Any]
) -> None:
    window = separated(room.files, *FLAGS, "--pin-lamp", "D65")
    both = separated(room.files, *FLAGS, "--pin-lamp", "D65", "--pin-lamp", "A")

    assert [lamp["pinned"] for lamp in plain.manifest["lamps"]] == [None, None]
    assert [lamp["pinned"] for lamp in window.manifest["lamps"]] == [None, 0]
    assert [lamp["pinned"] for lamp in both.manifest["lamps"]] == [1, 0]
    found = [joint_snr_db(room, run.layers()) for run in (plain, window, both)]
    assert found[0] < 10
    assert found[1] > 15
    assert found[2] > 27
    assert window.manifest["lamps"][1]["cct_k"] == pytest.approx(6504, rel=0.03)
    assert not {"pin_not_pure", "pin_contradicted"} & set(window.warnings())


def test_an_area_pins_a_lamp(room: Room, plain: Any, separated: Callable[..., Any]) -> None:
    """The bulb alone lights the left edge: its temperature there is told, and its layer better."""
    bulb = separated(room.files, *FLAGS, "--pin-lamp", BULB)

    assert bulb.manifest["lamps"][0]["pinned"] == 0
    assert bulb.manifest["lamps"][0]["cct_k"] == pytest.approx(2856, rel=0.03)
    assert joint_snr_db(room, bulb.layers()) > joint_snr_db(room, plain.layers()) + 1


def test_a_forbidden_lamp_is_not_among_those_found(
    room: Room, plain: Any, separated: Callable[..., Any]
) -> None:
    freed = separated(room.files, *FLAGS, "--forbid-lamp", "D47")

    white = list(sensitivities() @ find_light("D47"))
    assert min(angle(lamp["rgb"], white) for lamp in plain.manifest["lamps"]) < 2
    assert min(angle(lamp["rgb"], white) for lamp in freed.manifest["lamps"]) > 2.9


def test_what_was_taken_for_a_lamp_can_be_forbidden(
    room: Room, plain: Any, separated: Callable[..., Any]
) -> None:
    """The right edge, where the lights mix: the window's own light lies beyond."""
    freed = separated(room.files, *FLAGS, "--forbid-lamp", MIXED)

    assert joint_snr_db(room, freed.layers()) > joint_snr_db(room, plain.layers()) + 1
    assert freed.manifest["lamps"][1]["cct_k"] > plain.manifest["lamps"][1]["cct_k"] + 200


def test_a_lamp_that_is_not_there_is_doubted(room: Room, separated: Callable[..., Any]) -> None:
    wrong = separated(room.files, *FLAGS, "--pin-lamp", "FL11")
    assert "pin_contradicted" in wrong.warnings()


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (("--pin-lamp", FAR_AWAY), "outside of the photograph's 180 × 120 pixels"),
        (("--forbid-lamp", "20,20,0"), "forbidden lamp 1, radius: "),
        (("--pin-lamp", "20,20,1"), "too small to tell a light"),
        (("--pin-lamp", "FL77"), "near names are FL7"),
        (("--pin-lamp", "A", "--pin-lamp", "A"), "the same lamp is pinned twice"),
        (("--pin-lamp", "A", "--forbid-lamp", "A"), "pinned and forbidden at once"),
        (("--pin-lamp", "A", "--forbid-lamp", "SA"), "from a forbidden one"),
        (("--pin-lamp", "A", "--method", "paper"), "no room for pinned or forbidden"),
        (("--pin-lamp", "A", "--pin-lamp", "D65", "--pin-lamp", "FL2"), "only 2 asked for"),
    ],
)
def test_what_cannot_be_is_refused(
    room: Room, command: Callable[..., Any], flags: tuple[str, ...], words: str
) -> None:
    run = command(room.files, *FLAGS, *flags)

    assert run.code == 2, run.stderr
    assert words.lower() in run.stderr.lower()
    assert run.stderr.count("\n") == 1
    assert not run.results.folder.exists()


def post(service: httpx.Client, room: Room, **options: object) -> httpx.Response:
    files = {
        name: (name, path.read_bytes())
        for name, path in zip(("no_flash", "flash"), room.files, strict=True)
    }
    return service.post("/jobs", files=files, data={"options": json.dumps({**OPTIONS, **options})})


def ended(service: httpx.Client, answer: httpx.Response) -> dict[str, Any]:
    assert answer.status_code == 202, answer.text
    deadline = time.monotonic() + 240
    while time.monotonic() < deadline:
        job: dict[str, Any] = service.get(answer.headers["location"]).json()
        if job["state"] in ("succeeded", "failed"):
            return job
        time.sleep(0.2)
    pytest.fail("the job did not end")


def test_pins_work_over_http(
    service: httpx.Client, room: Room, separated: Callable[..., Any]
) -> None:
    area = dict(zip(("x", "y", "radius"), map(float, BULB.split(",")), strict=True))

    job = ended(service, post(service, room, pinned_lamps=[area]))

    assert job["state"] == "succeeded"
    manifest = service.get(f"/jobs/{job['id']}/results").json()
    assert manifest["options"]["pinned_lamps"] == [area]
    assert manifest["lamps"] == separated(room.files, *FLAGS, "--pin-lamp", BULB).manifest["lamps"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"pinned_lamps": [{"x": 180, "y": 60, "radius": 7}]}, "outside of the photograph's"),
        ({"pinned_lamps": [{"x": 8, "y": 60, "radius": -7}]}, "radius"),
        ({"forbidden_lamps": ["FL77"]}, "near names are FL7"),
        ({"pinned_lamps": ["A", "A"]}, "the same lamp is pinned twice"),
    ],
)
def test_what_cannot_be_is_refused_over_http(
    service: httpx.Client, room: Room, options: dict[str, object], words: str
) -> None:
    answer = post(service, room, **options)

    problem = ended(service, answer)["error"] if answer.status_code == 202 else answer.json()

    assert problem["status"] == 422
    assert words.lower() in problem["detail"].lower()
