"""Rendered pairs with known light through the command line: how near the results come.

The errors stated here are those of the whole way from the sensor's noise and mosaic to the files,
with a margin of about 2 dB, a third of an angle, below what the renderings give.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image as PillowImage

from drivers.truth import SimulatedTruth
from pipeline.colour.curves import linear_to_srgb

NIKON = ("--camera", "Nikon D5100")
ALL = ("--outputs", "all")
NORMALS = ("--no-align", "--lights", 3, "--outputs", "normals.exr,normals.png")
RAW = [(1, 34.0, 0.8, 0.8), (2, 26.5, 0.9, 0.8), (3, 21.5, 1.0, 0.25)]
"""Lamps, mean SNR of the layers in dB, white balance error in degrees, confidence in the number:
at least, at most, at least. Three lamps on so small a picture are taken for four, perhaps."""


@pytest.mark.parametrize(("lights", "snr_db", "white_balance", "confidence"), RAW)
def test_raw_pairs(
    scene: Callable[..., Any],
    separated: Callable[..., Any],
    lights: int,
    snr_db: float,
    white_balance: float,
    confidence: float,
) -> None:
    """Nothing is told: camera, exposure and the number of lamps are found."""
    found = scene(lights)

    results = separated(found.dng, *ALL)

    assert results.manifest["lights"]["requested"] == "auto"
    assert results.manifest["lights"]["found"] == lights
    assert results.manifest["lights"]["confidence"] > confidence
    assert results.manifest["camera"] == {"name": "Nikon D5100", "source": "measured"}
    assert results.manifest["exposure_ratio"] == 1
    doubts = ["four_or_more", "number_uncertain"] if lights == 3 else []
    assert results.warnings() == doubts
    assert np.mean(results.layer_snr_db(found.truth)) > snr_db
    assert results.white_balance_error(found.truth) < white_balance


def test_a_larger_raw_pair(scene: Callable[..., Any], separated: Callable[..., Any]) -> None:
    """Lamps are estimated on means of blocks with little noise, which filtering would only bend."""
    found = scene(2, size=(1200, 800))

    results = separated(found.dng, "--no-align", "--lights", 2, "--outputs", "layers.exr")

    assert np.mean(results.layer_snr_db(found.truth)) > 29.2


@pytest.mark.parametrize(("lights", "snr_db", "white_balance"), [(2, 27.0, 0.3), (3, 16.0, 0.3)])
def test_exact_pairs(
    scene: Callable[..., Any],
    separated: Callable[..., Any],
    lights: int,
    snr_db: float,
    white_balance: float,
) -> None:
    """Without noise the model of reflectances and lamps alone sets the limit."""
    found = scene(lights)

    flags = (*NIKON, "--no-align", "--lights", lights)
    results = separated(found.exact, *flags, "--outputs", "layers.exr,white_balanced.exr")

    assert np.mean(results.layer_snr_db(found.truth)) > snr_db
    assert results.white_balance_error(found.truth) < white_balance


@pytest.mark.parametrize("lights", [1, 2, 3])
def test_layers_add_up_to_the_photograph(
    scene: Callable[..., Any], separated: Callable[..., Any], lights: int
) -> None:
    found = scene(lights)
    results = separated(found.dng, *ALL)
    light = found.truth.layers.sum(0)

    total = results.exr("layers.exr")

    np.testing.assert_allclose(results.layers().sum(0), total, rtol=2**-10, atol=1e-6)
    assert 10 * np.log10(np.square(light).sum() / np.square(total - light).sum()) > 33


def test_the_lamps_are_described(scene: Callable[..., Any], separated: Callable[..., Any]) -> None:
    found = scene(2)
    lamps = separated(found.dng, *ALL).manifest["lamps"]

    assert [lamp["name"] for lamp in lamps] == ["lamp1", "lamp2"]
    warm, cold = sorted(lamps, key=lambda lamp: float(lamp["cct_k"]))
    assert warm["cct_k"] == pytest.approx(2856, rel=0.1)  # incandescent
    assert 6000 < cold["cct_k"] < 9500  # white LED
    for lamp, true in ((warm, found.truth.rgb[0]), (cold, found.truth.rgb[1])):
        rgb = np.array(lamp["rgb"])
        cosine = rgb @ true / np.linalg.norm(rgb) / np.linalg.norm(true)
        assert np.degrees(np.arccos(cosine)) < 3
        assert lamp["confidence"] > 0.8


def in_colours_of(results: Any, truth: SimulatedTruth) -> SimulatedTruth:
    """The truth in a JPEG's own colours, by the matrix that its layers' sum tells."""
    total = results.exr("layers.exr").reshape(-1, 3)
    light = truth.layers.sum(0).reshape(-1, 3)
    inside = (total > 0.003).all(1) & (total < 0.8).all(1)
    to_jpeg = np.linalg.lstsq(light[inside], total[inside], rcond=None)[0]
    return replace(truth, layers=truth.layers @ to_jpeg)


def test_a_jpeg_pair_is_separated_with_a_warning(
    scene: Callable[..., Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """Compared in the JPEG's own colours; and where it was taken stays out of the results."""
    found = scene(2)
    pair = []
    for path in found.jpeg:
        with PillowImage.open(path) as image:
            exif = image.getexif()
            exif.get_ifd(0x8825).update({1: "N", 2: (48.0, 12.0, 33.0), 29: "2024:02:29"})
            image.save(tmp_path / path.name, quality=95, subsampling=0, exif=exif)
        pair.append(tmp_path / path.name)

    results = separated(tuple(pair), "--no-align", "--lights", 2)

    assert np.mean(results.layer_snr_db(in_colours_of(results, found.truth))) > 16
    assert results.manifest["camera"]["source"] == "stand-in"
    assert "rendered_srgb" in results.warnings()
    for name in results.files:
        content = (results.folder / name).read_bytes()
        assert b"2024:02:29" not in content
        assert b"Exif" not in content


def test_a_cameras_contrast_is_taken_off_a_jpeg_pair(
    scene: Callable[..., Any], separated: Callable[..., Any], tmp_path: Path
) -> None:
    """Lamps' shadows tell it. With it in the values layers are 6 dB worse."""
    found = scene(2, size=(1200, 800))
    codes = np.linspace(0, 1, 256)
    contrast = np.round(255 * (codes - 0.05 * np.sin(2 * np.pi * codes))).astype(np.uint8)
    pair = []
    for path in found.jpeg:
        with PillowImage.open(path) as image:
            shown = PillowImage.fromarray(contrast[np.asarray(image)])
        shown.save(tmp_path / path.name, quality=95, subsampling=0)
        pair.append(tmp_path / path.name)

    results = separated(tuple(pair), "--no-align", "--lights", 2)

    curve = results.manifest["tone_curve"]
    plain = linear_to_srgb(np.array(curve["light"]))
    seen = np.array(curve["codes"])
    np.testing.assert_allclose(plain - 0.05 * np.sin(2 * np.pi * plain), seen, atol=0.04)
    (told,) = (w for w in results.manifest["warnings"] if w["code"] == "rendered_srgb")
    assert told["message"].endswith("so that layers and pictures are flatter than the files.")
    assert np.mean(results.layer_snr_db(in_colours_of(results, found.truth))) > 19.5


@pytest.mark.parametrize("kind", ["EXR", "16-bit TIFF"])
def test_other_linear_files_give_the_same_layers(
    scene: Callable[..., Any], separated: Callable[..., Any], tmp_path: Path, kind: str
) -> None:
    found = scene(2, size=(180, 120))
    light = found.truth.layers.sum(0)
    pair = (tmp_path / "a.jpg", tmp_path / "b.jpg")  # names say nothing
    for path, values in zip(pair, (light, light + found.truth.flash), strict=True):
        if kind == "EXR":
            channels = {name: values[..., i].copy() for i, name in enumerate("RGB")}
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            OpenEXR.File(header, channels).write(str(path))
        else:
            codes = np.round(values * 65535).astype(np.uint16)
            file = io.BytesIO()
            tifffile.imwrite(file, codes, photometric="rgb", metadata=None)
            path.write_bytes(file.getvalue())
    flags = (*NIKON, "--no-align", "--lights", 2, "--outputs", "layers.exr")

    results, float_tiff = separated(pair, *flags), separated(found.exact, *flags)

    if kind == "EXR":
        np.testing.assert_array_equal(results.layers(), float_tiff.layers())
    else:
        np.testing.assert_allclose(results.layers(), float_tiff.layers(), atol=1e-2)


def test_the_same_pair_gives_the_same_bytes(
    scene: Callable[..., Any],
    separated: Callable[..., Any],
    command: Callable[..., Any],
    process: Callable[..., Any],
) -> None:
    """In a fork and in a process of its own."""
    pair = scene(3).dng
    first = separated(pair, *ALL)

    second = command(pair, *ALL, run=process).results

    assert second.files == first.files
    for name in first.files:
        assert (second.folder / name).read_bytes() == (first.folder / name).read_bytes(), name


def test_the_manifest_lists_every_file(
    scene: Callable[..., Any], separated: Callable[..., Any]
) -> None:
    results = separated(scene(2).dng, *ALL)

    listed = {file["name"]: file for file in results.manifest["files"]}
    assert set(listed) | {"manifest.json"} == results.files
    for name, file in listed.items():
        content = (results.folder / name).read_bytes()
        assert file["sha256"] == hashlib.sha256(content).hexdigest()
        assert file["encoding"]
        assert file["colour_space"]
        if name not in ("gamma.png", "residual.png"):
            assert (file["width"], file["height"]) == (360, 240)


def test_pictures_carry_their_colour_space(
    scene: Callable[..., Any], separated: Callable[..., Any]
) -> None:
    results = separated(scene(2).dng, *ALL)

    for name in ("lamp1.jpg", "lamp2.jpg", "white_balanced_1.jpg", "white_balanced_2.jpg"):
        with PillowImage.open(results.folder / name) as image:
            assert b"sRGB" in image.info["icc_profile"]
    for name in ("lamp1.tif", "lamp2.tif"):
        with tifffile.TiffFile(results.folder / name) as file:
            assert file.pages.first.dtype == np.uint16
            assert b"Rec. 2020" in (file.pages.first.iccprofile or b"")


@pytest.fixture(scope="module")
def lights_file(
    scene: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Path]:
    """The directions of the three lamps of the scene of one material, and what else is asked."""
    truth = scene(3, "objects").truth

    @cache
    def write(*also: str) -> Path:
        values = {"direction": truth.directions, "strength": truth.strengths, "rgb": truth.rgb}
        lights = [
            {name: values[name][i].tolist() for name in ("direction", *also)} for i in range(3)
        ]
        path = tmp_path_factory.mktemp("lights") / "lights.json"
        path.write_text(json.dumps({"lights": lights}))
        return path

    return write


def facing_error(truth: Any) -> float:
    """Mean angle in degrees of a guess that every surface faces the camera."""
    known = truth.normals[np.isfinite(truth.normals).all(2)]
    return float(np.degrees(np.arccos(np.clip(known[:, 2], -1, 1))).mean())


def likeness(results: Any, truth: Any) -> list[float]:
    """Correlation of the three components of the normals with the true ones."""
    found = results.exr("normals.exr")
    known = np.isfinite(truth.normals).all(2) & np.isfinite(found).all(2)
    assert known.mean() > 0.85 * np.isfinite(truth.normals).all(2).mean()
    pairs = zip(found[known].T, truth.normals[known].T, strict=True)
    return [float(np.corrcoef(one, other)[0, 1]) for one, other in pairs]


def test_normals_of_an_exact_pair(
    scene: Callable[..., Any], separated: Callable[..., Any], lights_file: Callable[..., Path]
) -> None:
    """Directions alone are given: strengths, and which lamp is which, are found."""
    found = scene(3, "objects", (180, 120))
    flags = (*NIKON, *NORMALS, "--light-directions", lights_file())

    results = separated(found.exact, *flags, "--focal-px", found.truth.focal_px)

    assert facing_error(found.truth) > 35
    assert results.normal_error(found.truth) < 0.7
    assert min(likeness(results, found.truth)) > 0.99
    assert not {"focal_length_assumed", "normals_doubtful"} & set(results.warnings())


def test_normals_of_a_raw_pair(
    scene: Callable[..., Any], separated: Callable[..., Any], lights_file: Callable[..., Path]
) -> None:
    found = scene(3, "objects", (180, 120))

    results = separated(found.dng, *NORMALS, "--light-directions", lights_file())

    assert results.normal_error(found.truth) < 2.5
    assert min(likeness(results, found.truth)) > 0.98


def test_normal_maps_agree(
    scene: Callable[..., Any], separated: Callable[..., Any], lights_file: Callable[..., Path]
) -> None:
    """The PNG holds (n + 1)/2 of the EXR's unit vectors, and 0 where nothing is known."""
    found = scene(3, "objects", (180, 120))

    results = separated(found.dng, *NORMALS, "--light-directions", lights_file())

    normals = results.exr("normals.exr")
    codes = imagecodecs.png_decode((results.folder / "normals.png").read_bytes())

    known = np.isfinite(normals).all(2)
    assert codes.dtype == np.uint16
    np.testing.assert_allclose(np.linalg.norm(normals[known], axis=1), 1, atol=1e-4)
    np.testing.assert_allclose(codes[known], (normals[known] + 1) / 2 * 65535, atol=1.1)
    assert (codes[~known] == 0).all()


def test_normals_need_the_focal_length_or_warn(
    scene: Callable[..., Any], separated: Callable[..., Any], lights_file: Callable[..., Path]
) -> None:
    """By sixteen degrees, which a small picture shows as well: a wrong guess takes long to fit.

    test_normals_of_an_exact_pair holds what comes of the right one.
    """
    found = scene(3, "objects", (120, 80))
    flags = (*NIKON, *NORMALS, "--light-directions", lights_file("strength", "rgb"))

    guessed = separated(found.exact, *flags)

    assert "focal_length_assumed" in guessed.warnings()
    assert guessed.normal_error(found.truth) > 8
