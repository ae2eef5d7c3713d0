"""Cameras and lights are looked up when a job is asked for, not only when it runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from pipeline.calibration.options import CALIBRATION_OPTIONS
from pipeline.errors import OptionError
from pipeline.mixes.mix_options import LampMix, MixRequest
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from service.api.context import Context
from service.mixing import MixOptions
from service.settings import Settings
from service.spectra import check_spectra
from tests.unit.service.asking import problem_of, rows_of, stored_job
from tests.unit.service.studio import PATH, SIM, take, with_cameras

Png = Callable[..., bytes]

CIRCLE = {"x": 20, "y": 20, "radius": 5}
FLAT = {"wavelength_nm": [380, 780], "power": [1, 1]}
ENDLESS = {"wavelength_nm": [380, 780], "power": [1e308, 1e308]}
SENSOR = {"wavelength_nm": [380, 780], "r": [0, 1], "g": [1, 1], "b": [1, 0]}
FLASH, CAMERA = {"kind": "flash", "card": CIRCLE}, {"kind": "camera"}

MISTYPED = {"neutral": "D655"}
TOLD = (
    422,
    "invalid-option",
    "neutral: No neutral light spectrum is called 'D655': near names are D65, D55, ID65, D75.",
)


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return with_cameras(settings)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The operator's folder of spectra, which is made when something is put there."""
    monkeypatch.delenv("LIGHTLAYERS_SPECTRA", raising=False)
    return tmp_path / "spectra"


def put_torch(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder.mkdir()
    (folder / "my_torch.csv").write_text("wavelength_nm,power\n400,1\n700,3\n")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(folder))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"camera": "nikon d5100", "response": "Sigma SD1 Merrill"},
        {"camera": SENSOR, "response": SENSOR},
        {"flash_spectrum": "led", "neutral": "D41"},
        {"flash_spectrum": FLAT, "neutral": FLAT},
        {"pinned_lamps": [CIRCLE, "A", FLAT], "forbidden_lamps": ["fl2", {**CIRCLE, "x": 1e9}]},
    ],
)
def test_what_can_be_found_is_taken(options: dict[str, Any]) -> None:
    check_spectra(Options.model_validate(options))


@pytest.mark.parametrize(
    "options",
    [
        FLASH,
        {**FLASH, "camera": "Nikon D5100"},
        CAMERA,
        {**CAMERA, "flash_spectrum": "xenon"},
        {"kind": "lamps"},
    ],
)
def test_what_calibrations_find_is_taken(options: dict[str, Any]) -> None:
    check_spectra(CALIBRATION_OPTIONS.validate_python(options))


def test_a_mix_names_none() -> None:
    check_spectra(MixOptions(kind="mix", of="1", mix=MixRequest(lamps=[LampMix()])))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"camera": "Nikon D5101"},
            "camera: No camera is called 'Nikon D5101': near names are Nikon D5100.",
        ),
        ({"camera": ""}, "camera: No camera is called '': send its table instead."),
        (
            {"response": "sigma sd1"},
            "response: No camera is called 'sigma sd1': near names are Sigma SD1 Merrill.",
        ),
        (
            {"flash_spectrum": "xenonn"},
            "flash_spectrum: No flash spectrum is called 'xenonn': near names are xenon.",
        ),
        (
            {"flash_spectrum": ENDLESS},
            "flash_spectrum: The flash spectrum is too large to be added up: give its power "
            "relative to its largest.",
        ),
        (MISTYPED, TOLD[2]),
        (
            {"pinned_lamps": ["A", CIRCLE, "zzzz"]},
            "pinned lamp 3: No pinned lamp 3 spectrum is called 'zzzz': send its table instead.",
        ),
        (
            {"forbidden_lamps": ["xenonn"]},
            "forbidden lamp 1: No forbidden lamp 1 spectrum is called 'xenonn': near names are "
            "xenon.",
        ),
    ],
)
def test_what_cannot_be_found_is_told_with_its_place(options: dict[str, Any], said: str) -> None:
    with pytest.raises(OptionError) as refused:
        check_spectra(Options.model_validate(options))
    assert str(refused.value) == said


@pytest.mark.parametrize(
    "options",
    [{"camera": "x"}, {"response": "D65"}, {"flash_spectrum": "Nikon D5100"}, {"neutral": "D39"}],
)
def test_the_words_are_those_of_the_job(options: dict[str, str], png: Png, tmp_path: Path) -> None:
    wanted = Options.model_validate(options)
    (place,) = options
    with pytest.raises(OptionError) as at_once:
        check_spectra(wanted)
    with pytest.raises(OptionError) as later:
        separate_files(png(64, 48), png(64, 48, True), wanted, tmp_path / "results", Progress())
    assert str(at_once.value) == f"{place}: {later.value}"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {**FLASH, "camera": "Nikon D5101"},
            "camera: No camera is called 'Nikon D5101': near names are Nikon D5100.",
        ),
        (
            {**CAMERA, "flash_spectrum": "xenonn"},
            "flash_spectrum: No flash spectrum is called 'xenonn': near names are xenon.",
        ),
    ],
)
def test_what_calibrations_cannot_find_is_told(options: dict[str, Any], said: str) -> None:
    with pytest.raises(OptionError) as refused:
        check_spectra(CALIBRATION_OPTIONS.validate_python(options))
    assert str(refused.value) == said


def test_the_folder_of_the_operator_is_looked_at(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_torch(folder, monkeypatch)
    check_spectra(Options(flash_spectrum="My Torch"))
    with pytest.raises(OptionError, match=r"^neutral: .*'my torc': near names are my torch"):
        check_spectra(Options(neutral="my torc"))
    with pytest.raises(OptionError, match=r"^camera: The file my_torch.csv .* it needs wavele"):
        check_spectra(Options(camera="my torch"))


def test_where_only_workers_have_the_folder_the_job_tells(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(folder))
    check_spectra(Options(camera="my own", flash_spectrum="my torch"))
    folder.mkdir()
    with pytest.raises(OptionError, match=r"^camera: No camera is called 'my own'"):
        check_spectra(Options(camera="my own", flash_spectrum="my torch"))


def test_the_api_loads_no_library_for_a_name(tmp_path: Path) -> None:
    """Once the tables are made, as a first job does; daylight has a table for each name."""
    program = (
        "import sys, service.serve;"
        "from pipeline.options import Options;"
        "from service.spectra import check_spectra;"
        "check_spectra(Options(camera='Nikon D5100', neutral=sys.argv[1], pinned_lamps=['FL2']));"
        "print(*sys.modules)"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    for name in ("D41", "D42"):
        run = [sys.executable, "-c", program, name]
        done = subprocess.run(run, capture_output=True, text=True, check=True, env=environment)
    assert "service.api" in done.stdout.split()
    assert {"colour", "scipy", "numba"}.isdisjoint(done.stdout.split())


@pytest.fixture
def post(http: httpx.Client, png: Png) -> Callable[[str, dict[str, Any]], httpx.Response]:
    """Send a pair with options to a path."""
    files = {"no_flash": png(64, 48), "flash": png(64, 48, True)}
    return lambda path, options: http.post(path, files=files, data={"options": json.dumps(options)})


@pytest.mark.usefixtures("cameras_in_process")
class TestEntrances:
    def test_a_pair(self, post: Any, context: Context) -> None:
        assert problem_of(post("/jobs", MISTYPED)) == TOLD
        assert rows_of(context) == [] and context.storage.list("") == []
        assert post("/jobs", {"neutral": "D55"}).status_code == 202

    def test_uploads_which_stay(self, http: httpx.Client, png: Png, context: Context) -> None:
        tus = {"tus-resumable": "1.0.0", "content-type": "application/offset+octet-stream"}
        ids = {}
        for frame, data in {"no_flash": png(64, 48), "flash": png(64, 48, True)}.items():
            made = http.post(
                "/uploads", headers={**tus, "upload-length": str(len(data))}, content=data
            )
            assert made.status_code == 201
            ids[frame] = made.headers["location"].rpartition("/")[2]
        wanted = {"uploads": ids, "options": MISTYPED}
        assert problem_of(http.post("/jobs", json=wanted)) == TOLD
        assert rows_of(context) == []
        assert http.post("/jobs", json={"uploads": ids}).status_code == 202

    @pytest.mark.parametrize(
        ("path", "body"),
        [
            ("/jobs", {"capture": {"camera": SIM}}),
            (f"{PATH}/captures", {"pairs": 3}),
        ],
    )
    def test_captures(
        self, path: str, body: dict[str, Any], http: httpx.Client, capture: Any, context: Context
    ) -> None:
        assert capture is not None
        assert problem_of(http.post(path, json={**body, "options": MISTYPED})) == TOLD
        assert rows_of(context) == []
        assert http.post(path, json={**body, "options": {"neutral": "D55"}}).status_code == 202

    def test_a_capture_like_one_whose_light_is_gone(
        self, capture: Any, context: Context, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        put_torch(folder, monkeypatch)
        (first,) = capture(options={"flash_spectrum": "my torch"}).json()["jobs"]
        take(context, first["id"], {})
        assert capture(like=first["id"]).status_code == 202
        (folder / "my_torch.csv").unlink()
        assert problem_of(capture(like=first["id"]))[2].startswith("flash_spectrum: No flash")
        assert capture(like=first["id"], options={}).status_code == 202

    @pytest.mark.parametrize("setup", [{}, {"setup": "table"}])
    def test_calibrations(
        self, setup: dict[str, str], http: httpx.Client, post: Any, context: Context
    ) -> None:
        options = {**CAMERA, **setup, "flash_spectrum": "xenonn"}
        told = "flash_spectrum: No flash spectrum is called 'xenonn': near names are xenon."
        wanted = {"capture": {"camera": SIM}, "options": options}
        for answer in (post("/calibrations", options), http.post("/calibrations", json=wanted)):
            assert problem_of(answer) == (422, "invalid-option", told)
        assert rows_of(context) == [] and context.storage.list("") == []

    def test_a_rerun(self, http: httpx.Client, context: Context) -> None:
        path = f"/jobs/{stored_job(context)}/rerun"
        kept = context.storage.list("")
        assert problem_of(http.post(path, json={"options": MISTYPED})) == TOLD
        assert len(rows_of(context)) == 1 and context.storage.list("") == kept
        assert http.post(path, json={"options": {"neutral": "D55"}}).status_code == 202

    def test_a_rerun_of_what_was_mistyped(self, http: httpx.Client, context: Context) -> None:
        path = f"/jobs/{stored_job(context, options=MISTYPED)}/rerun"
        assert problem_of(http.post(path)) == TOLD
        assert http.post(path, json={"options": {}}).status_code == 202

    def test_a_request_sent_again_gives_its_job_whatever_became_of_the_name(
        self, http: httpx.Client, capture: Any, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        assert capture is not None
        put_torch(folder, monkeypatch)
        wanted = {"capture": {"camera": SIM}, "options": {"neutral": "my torch"}}
        first = http.post("/jobs", json=wanted, headers={"idempotency-key": "1"})
        (folder / "my_torch.csv").unlink()
        again = http.post("/jobs", json=wanted, headers={"idempotency-key": "1"})
        assert first.status_code == again.status_code == 202
        assert first.json()["id"] == again.json()["id"]
        assert problem_of(http.post("/jobs", json=wanted))[:2] == (422, "invalid-option")
