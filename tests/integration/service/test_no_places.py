"""Nothing that leaves tells where a photograph was taken, or whose camera took it."""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn, Protocol

import httpx
import numpy as np
import pillow_heif
import pytest
import tifffile
from PIL import Image

import drivers
from service.cli import run

OWNER, SERIAL = "Anna Beispiel", "SN47110815"
_SECRETS = re.compile("gps|owner|serial|artist|byline|copyright|creator$|rights|location|makernote")
_WRITTEN = (
    "-EXIF:GPSLatitude=48.1371",
    "-EXIF:GPSLatitudeRef=N",
    "-EXIF:GPSLongitude=11.5754",
    "-EXIF:GPSLongitudeRef=E",
    "-XMP-exif:GPSLatitude=48.1371",
    "-XMP-exif:GPSLongitude=11.5754",
    f"-EXIF:Artist={OWNER}",
    f"-EXIF:OwnerName={OWNER}",
    f"-EXIF:SerialNumber={SERIAL}",
    f"-EXIF:LensSerialNumber={SERIAL}",
    f"-EXIF:UserComment={OWNER}",
    f"-XMP-dc:Creator={OWNER}",
    f"-XMP-aux:SerialNumber={SERIAL}",
)


class _Service(Protocol):
    http: httpx.Client

    def await_end(self, job: dict[str, object]) -> dict[str, object]: ...


@pytest.fixture(scope="module")
def exiftool(lacking: Callable[[str], NoReturn]) -> str:
    return shutil.which("exiftool") or lacking("exiftool")


def _found(exiftool: str, paths: list[Path]) -> set[str]:
    """Names of what an independent reader finds of places and people, also in previews."""
    told = subprocess.run(
        [exiftool, "-j", "-a", "-U", "-ee3", "-G4:1", *map(str, paths)],
        capture_output=True,
        check=True,
    )
    names = {name for file in json.loads(told.stdout) for name in file if name != "SourceFile"}
    # A colour profile names who made the profile, which is us.
    told_of = {name for name in names if not name.startswith(("ICC-header:", "ICC_Profile:"))}
    return {name for name in told_of if _SECRETS.search(name.rpartition(":")[2].lower())}


def _jpeg(image: Image.Image, path: Path) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x927C] = b"Maker\0" + f"{OWNER} {SERIAL}".encode()
    image.save(path, quality=95, exif=exif)


def _heic(image: Image.Image, path: Path) -> None:
    pillow_heif.from_pillow(image).save(path, quality=95)


def _tiff(image: Image.Image, path: Path) -> None:
    tifffile.imwrite(path, np.asarray(image), photometric="rgb")


_WRITERS = {"jpg": _jpeg, "heic": _heic, "tif": _tiff}


@pytest.fixture(scope="module")
def shots() -> dict[str, dict[str, bytes]]:
    with drivers.open_camera("sim://studio?width=64&height=64&format=both") as camera:
        pair = drivers.capture_pair(camera)
    return {
        frame: {str(kind): data for kind, data in shot.files.items()}
        for frame, shot in (("no_flash", pair.no_flash), ("flash", pair.flash))
    }


@pytest.fixture
def told(
    exiftool: str, shots: dict[str, dict[str, bytes]], tmp_path: Path
) -> Callable[[str], list[Path]]:
    """Write the pair in a format, with places and people wherever exiftool can write them."""

    def write(kind: str) -> list[Path]:
        paths = []
        for frame, files in shots.items():
            path = tmp_path / f"{frame}.{kind}"
            if kind == "dng":
                path.write_bytes(files["dng"])
            else:
                _WRITERS[kind](Image.open(io.BytesIO(files["jpeg"])).convert("RGB"), path)
            paths.append(path)
        preview = tmp_path / "preview.jpg"
        Image.new("RGB", (16, 16)).save(preview)
        quietly = [exiftool, "-q", "-overwrite_original"]
        subprocess.run([*quietly, *_WRITTEN, str(preview)], check=True)
        inside = [f"-ThumbnailImage<={preview}"] if kind in ("jpg", "tif") else []
        subprocess.run([*quietly, *_WRITTEN, *inside, *map(str, paths)], check=True)
        preview.unlink()
        assert len(_found(exiftool, paths)) >= 8
        assert all(SERIAL.encode() in path.read_bytes() for path in paths)
        return paths

    return write


def _check(exiftool: str, folder: Path) -> None:
    files = sorted(folder.iterdir())
    assert len(files) > 8
    assert _found(exiftool, files) == set()
    for path in files:
        data = path.read_bytes()
        for secret in (OWNER, SERIAL, "48.137", "11.575", "no_flash.", "flash.jpg"):
            assert secret.encode() not in data, path.name
            assert secret.encode("utf-16-le") not in data, path.name


@pytest.mark.parametrize("kind", ["jpg", "heic", "tif", "dng"])
def test_no_result_tells_the_place_or_the_owner(
    kind: str, exiftool: str, told: Callable[[str], list[Path]], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    pair = map(str, told(kind))
    more = ["--outputs", "all", "--response", "Nikon D5100", "--quality", "fast"]
    assert run(["separate", *pair, "-o", str(out), *more]) == 0
    assert run(["report", str(out)]) == 0
    for ending in ("jpg", "tif", "exr"):
        mix = ["mix", str(out), "-o", str(out / f"mix.{ending}"), "--lamp", "1:ev=-1"]
        assert run(mix) == 0
    _check(exiftool, out)


def test_nothing_that_the_service_answers_tells_them(
    exiftool: str, told: Callable[[str], list[Path]], service: _Service, tmp_path: Path
) -> None:
    no_flash, flash = told("jpg")
    files = {
        "no_flash": (f"{OWNER}.jpg", no_flash.read_bytes()),
        "flash": (f"{OWNER}.jpg", flash.read_bytes()),
    }
    made = service.http.post("/jobs", files=files)
    assert made.status_code == 202
    ended = service.await_end(made.json())
    assert ended["state"] == "succeeded"
    here = f"/jobs/{ended['id']}"
    for path in (here, f"{here}/results", "/jobs"):
        assert OWNER not in service.http.get(path).text
        assert SERIAL not in service.http.get(path).text
    whole = service.http.get(f"{here}/results.zip").content
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        archive.extractall(tmp_path / "results")
    _check(exiftool, tmp_path / "results")
