"""The files of a separation in programs that others wrote."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

import drivers
from pipeline.encode.exr import write_exr
from pipeline.encode.glb import write_glb
from pipeline.encode.mesh import make_mesh
from pipeline.encode.png import NormalsPng
from pipeline.encode.texture import Texture
from pipeline.mixes.mix_files import mix_files
from pipeline.mixes.mix_options import LampMix, Mix
from pipeline.options import Options
from pipeline.process import separate_files
from pipeline.progress import Progress
from tests.strips import write_by_strips

SIZE = (192, 128)
_LAYERS = [f"lamp{lamp}.{colour}" for lamp in (1, 2) for colour in "RGB"]


@pytest.fixture(scope="module")
def run(lacking: Callable[[str], NoReturn]) -> Callable[..., str]:
    """Run a program; what it says."""

    def call(program: str, *arguments: str | Path) -> str:
        if shutil.which(program) is None:
            lacking(program)
        done = subprocess.run([program, *arguments], capture_output=True, text=True, check=True)
        return done.stdout + done.stderr

    return call


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, run: Callable[..., str]) -> Path:
    """All outputs of a pair of the simulated camera, held upright; with mixes of them.

    What tells of a surface is that of a ball.
    """
    folder = tmp_path_factory.mktemp("results")
    width, height = SIZE
    with drivers.open_camera(f"sim://studio?lights=2&width={height}&height={width}") as camera:
        pair = drivers.capture_pair(camera)
    options = Options(outputs="all", lights=2, quality="fast", response="Sigma SD1 Merrill")
    before, after = (
        _turned(shot.best, tmp_path_factory.mktemp("pair"), run)
        for shot in (pair.no_flash, pair.flash)
    )
    separate_files(before, after, options, folder, Progress())
    _write_ball(folder)
    for kind in ("jpg", "tif", "exr"):
        mix = Mix(lamps=[LampMix(ev=-1), LampMix(neutral=True)])
        mix_files(folder, mix, folder / f"mix.{kind}", Progress())
    return folder


def _turned(photograph: bytes, folder: Path, run: Callable[..., str]) -> bytes:
    """The photograph as of a camera turned by 90°, and with the place where it was taken."""
    path = folder / "turned.dng"
    path.write_bytes(photograph)
    place = ("-GPSLatitude=48.1", "-GPSLatitudeRef=N", "-GPSLongitude=11.5", "-GPSLongitudeRef=E")
    run("exiftool", "-q", "-overwrite_original", "-n", "-Orientation=6", *place, path)
    return path.read_bytes()


def _write_ball(folder: Path) -> None:
    y, x = np.mgrid[1 : -1 : SIZE[1] * 1j, -1 : 1 : SIZE[0] * 1j].astype(np.float32)
    hidden = x**2 + y**2 > 0.9
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    normals = np.where(hidden[..., None], np.nan, np.stack([x, y, z], axis=-1)).astype(np.float32)
    depth = np.where(hidden, np.nan, 2 - z).astype(np.float32)
    write_exr(folder / "depth.exr", {"Z": depth})
    write_exr(folder / "normals.exr", {"RGB": normals})
    write_by_strips(NormalsPng(folder / "normals.png", SIZE), normals)
    texture = Texture(SIZE, np.eye(3))
    texture.write(np.full((*depth.shape, 3), 0.4, np.float32))
    write_glb(folder / "surface.glb", make_mesh(depth, normals, 200.0), texture.close())


def _lamp(results: Path, lamp: int) -> NDArray[np.uint16]:
    with tifffile.TiffFile(results / f"lamp{lamp}.tif") as file:
        return np.asarray(file.pages.first.asarray())


def test_imagemagick_opens_layers_as_layers(
    run: Callable[..., str], results: Path, tmp_path: Path
) -> None:
    told = run("identify", "-format", "%s %w %h %z [%l] %[compose];", results / "layers.psd")
    assert told.split(";")[1:3] == [
        "1 192 128 16 [lamp1] Over",
        "2 192 128 16 [lamp2] LinearDodge",
    ]
    for lamp in (1, 2):
        raw = tmp_path / f"{lamp}.rgb"
        run("convert", f"{results / 'layers.psd'}[{lamp}]", "-depth", "16", "-endian", "LSB", raw)
        shown = np.fromfile(raw, "<u2").reshape(SIZE[1], SIZE[0], 3)
        np.testing.assert_allclose(shown.astype(int), _lamp(results, lamp), atol=1)
    run("convert", f"{results / 'layers.psd'}[0]", f"icc:{tmp_path / 'profile.icc'}")
    with tifffile.TiffFile(results / "lamp1.tif") as file:
        assert (tmp_path / "profile.icc").read_bytes() == file.pages.first.iccprofile


_GIMP = """
(let* ((image (car (gimp-file-load RUN-NONINTERACTIVE "{path}" "layers.psd")))
       (precision (car (gimp-image-get-precision image)))
       (layers (cadr (gimp-image-get-layers image))))
  (gimp-message (string-append "precision=" (number->string precision)))
  (let next ((i 0))
    (if (< i (vector-length layers))
      (let ((layer (vector-ref layers i)))
        (gimp-message (string-append "layer=" (car (gimp-item-get-name layer)) ","
          (number->string (car (gimp-drawable-width layer))) ","
          (number->string (car (gimp-layer-get-mode layer)))))
        (next (+ i 1))))))
"""
_GIMP_16_BIT = ("200", "250")  # linear and with the sRGB curve
_GIMP_NORMAL, _GIMP_ADDITION = "28", "33"


def test_gimp_opens_layers_as_layers(run: Callable[..., str], results: Path) -> None:
    script = " ".join(_GIMP.format(path=results / "layers.psd").split())
    told = run("gimp-console", "-i", "-d", "-f", "-b", script, "-b", "(gimp-quit 0)")
    precision = re.search(r"precision=(\d+)", told)
    assert precision and precision[1] in _GIMP_16_BIT
    layers = re.findall(r"layer=(\w+),(\d+),(\d+)", told)
    assert layers == [("lamp2", "192", _GIMP_ADDITION), ("lamp1", "192", _GIMP_NORMAL)]


def test_openimageio_reads_every_channel_of_layers(
    run: Callable[..., str], results: Path, tmp_path: Path
) -> None:
    told = run("oiiotool", "--info", "-v", results / "layers.exr")
    assert "192 x  128, 9 channel, half openexr" in told
    listed = re.search(r"channel list: (.*)", told)
    assert listed
    assert sorted(listed[1].split(", ")) == sorted([*"RGB", *_LAYERS])
    target = tmp_path / "sum.exr"
    picked = [f"lamp{lamp}.R,lamp{lamp}.G,lamp{lamp}.B" for lamp in (1, 2)]
    layers = results / "layers.exr"
    run("oiiotool", layers, "--ch", picked[0], layers, "--ch", picked[1], "--add", layers, "--ch",
        "R,G,B", "--absdiff", "--printstats", "-o", target)  # fmt: skip
    most = re.search(r"Stats Max: ([\d.e-]+) ([\d.e-]+) ([\d.e-]+)", run(
        "oiiotool", "--stats", target))  # fmt: skip
    assert most and max(map(float, most.groups())) < 2**-10  # of light up to 1, as rounded


@pytest.mark.parametrize(
    ("name", "channels", "depth"),
    [
        ("depth.exr", ["Z"], "float"),
        ("normals.exr", [*"RGB"], "float"),
        ("white_balanced.exr", [*"RGB", "any.R", "any.G", "any.B"], "half"),
        ("response.exr", [*"RGB", *_LAYERS], "half"),
        ("preview.exr", ["Y", *_LAYERS], "half"),
        ("mix.exr", [*"RGB"], "half"),
    ],
)
def test_openimageio_reads_the_other_pictures(
    name: str, channels: list[str], depth: str, run: Callable[..., str], results: Path
) -> None:
    told = run("oiiotool", "--info", "-v", results / name)
    assert "192 x  128" in told and f"{depth} openexr" in told
    listed = re.search(r"channel list: (.*)", told)
    assert listed and sorted(listed[1].split(", ")) == sorted(channels)


_COLOURS = {
    "jpg": ("8", "sRGB"),
    "tif": ("16 16 16", "2020"),
    "png": ("8", None),
}
"""Bits of a sample and profile, by the kind of a file."""
_OTHERS = {
    "confidence.tif": ("16", None),
    "normals.png": ("16", None),
}
_DIAGRAMS = ("gamma.png", "residual.png")  # of sizes of their own


def test_exiftool_finds_profiles_depths_and_nobody(run: Callable[..., str], results: Path) -> None:
    paths = [path for path in results.iterdir() if path.suffix[1:] in _COLOURS]
    assert len(paths) == 18
    for entry in json.loads(run("exiftool", "-q", "-json", "-a", "-G", *paths)):
        name = Path(entry["SourceFile"]).name
        values = {key.rpartition(":")[2]: value for key, value in entry.items()}
        bits, profile = _OTHERS.get(name, _COLOURS[name.rpartition(".")[2]])
        assert str(values.get("BitsPerSample", values.get("BitDepth"))) == bits, name
        if name not in _DIAGRAMS:
            assert (values["ImageWidth"], values["ImageHeight"]) == SIZE, name
        assert (profile or "") in values.get("ProfileDescription", ""), name
        assert ("ProfileDescription" in values) == (profile is not None), name
        assert not [key for key in values if re.search("GPS|Owner|Serial|Artist", key)], name
        assert "Rotate" not in str(values.get("Orientation", "")), name


def test_the_gltf_validator_accepts_the_surface(
    run: Callable[..., str], results: Path, tmp_path: Path
) -> None:
    run(
        "npm",
        "install",
        "--prefix",
        tmp_path,
        "--no-audit",
        "--no-fund",
        "--fetch-retries=5",
        "gltf-validator@2.0.0-dev.3.10",
    )
    script = (
        "const v = require('gltf-validator'), fs = require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])))"
        ".then(report => console.log(JSON.stringify(report)));"
    )
    done = subprocess.run(
        ["node", "-e", script, results / "surface.glb"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    report: dict[str, Any] = json.loads(done.stdout)
    assert report["mimeType"] == "model/gltf-binary"
    issues = report["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    assert report["info"]["totalTriangleCount"] > 1000
