"""Every flag of `lightlayers separate` changes what it says it changes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

NIKON = ("--camera", "Nikon D5100")
EXACT = (*NIKON, "--no-align", "--lights", 2)
"""For the exact pair, which has no EXIF and needs no alignment."""


def write_tiff(path: Path, values: Any) -> Path:
    tifffile.imwrite(path, values, photometric="rgb", metadata=None)
    return path


def linear_to_srgb(light: Any) -> Any:
    return np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055
    )


@pytest.fixture(scope="module")
def two(scene: Callable[..., Any]) -> Any:
    return scene(2, size=(180, 120))


@pytest.fixture(scope="module")
def plain(two: Any, separated: Callable[..., Any]) -> Any:
    """What the exact pair gives with its camera named and nothing else."""
    return separated(two.exact, *EXACT)


@pytest.fixture(scope="module")
def paper(two: Any, separated: Callable[..., Any]) -> Any:
    """The same by the published method."""
    return separated(two.exact, *EXACT, "--method", "paper")


@pytest.mark.parametrize("count", [1, 2, 3])
def test_lights_sets_the_number_of_lamps(
    two: Any, separated: Callable[..., Any], count: int
) -> None:
    results = separated(two.exact, *NIKON, "--no-align", "--lights", count)

    assert results.manifest["lights"]["requested"] == count
    assert len(results.manifest["lamps"]) == count
    assert {f"lamp{i + 1}.tif" for i in range(count)} <= results.files
    assert f"lamp{count + 1}.tif" not in results.files
    np.testing.assert_allclose(
        results.layers().sum(0), two.truth.layers.sum(0), atol=2e-3, err_msg="the sum is the light"
    )


def test_method_paper_gives_the_published_layers(two: Any, plain: Any, paper: Any) -> None:
    """Eq. 3 as it is deals out what the model says, not what the photograph holds."""
    light = two.truth.layers.sum(0)

    assert np.abs(plain.layers().sum(0) - light).max() < 2e-3
    assert np.abs(paper.layers().sum(0) - light).max() > 2e-3
    assert min(paper.layer_snr_db(two.truth)) > 10


def test_basis_changes_what_is_learnt(two: Any, paper: Any, separated: Callable[..., Any]) -> None:
    """Of the published method, which is bound to its basis; fitted matrices hardly are."""
    flags = (*EXACT, "--method", "paper", "--outputs", "layers.exr")
    found = {basis: separated(two.exact, *flags, "--basis", basis) for basis in ("pca", "joint")}
    found["wpca"] = paper

    colours = {
        basis: np.array([lamp["coefficients"] for lamp in results.manifest["lamps"]])
        for basis, results in found.items()
    }
    for basis, results in found.items():
        assert results.manifest["options"]["basis"] == basis
    for one, other in (("wpca", "pca"), ("wpca", "joint"), ("pca", "joint")):
        assert np.abs(colours[one] - colours[other]).max() > 1e-3


def test_camera_by_name_makes_the_layers_right(
    two: Any, plain: Any, separated: Callable[..., Any]
) -> None:
    flags = ("--camera", "Sigma SD1 Merrill", "--no-align", "--lights", 2)
    other = separated(two.exact, *flags, "--outputs", "layers.exr")

    assert plain.manifest["camera"] == {"name": "Nikon D5100", "source": "measured"}
    assert other.manifest["camera"] == {"name": "Sigma SD1 Merrill", "source": "measured"}
    assert np.mean(plain.layer_snr_db(two.truth)) > np.mean(other.layer_snr_db(two.truth)) + 1


def test_without_a_name_the_pair_tells_that_it_holds_values_of_a_sensor(
    two: Any, plain: Any, separated: Callable[..., Any]
) -> None:
    unnamed = separated(two.exact, "--no-align", "--lights", 2)

    assert unnamed.manifest["camera"] == {"name": "typical sensor", "source": "stand-in"}
    assert np.mean(unnamed.layer_snr_db(two.truth)) > np.mean(plain.layer_snr_db(two.truth)) - 0.1


def test_camera_by_file_is_as_good_as_by_name(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    from pipeline.spectra.cameras import find_camera
    from pipeline.spectra.wavelengths import WAVELENGTHS_NM

    sensitivities = find_camera("Nikon D5100", None).sensitivities  # type: ignore[arg-type]
    rows = np.column_stack([WAVELENGTHS_NM, sensitivities.T])
    table = tmp_path / "mine.csv"
    np.savetxt(table, rows, "%.9g", ",", header="wavelength_nm,R,G,B", comments="")

    results = separated(two.exact, "--camera", table, "--no-align", "--lights", 2)

    assert results.manifest["camera"]["source"] == "file"
    # the table is rounded, and the fit of the lamps enlarges that
    np.testing.assert_allclose(results.layers(), plain.layers(), atol=1e-2)


def test_cameras_and_lights_of_the_users_folder_go_by_their_names(
    two: Any, command: Callable[..., Any], tmp_path: Path
) -> None:
    rows = {
        str(nm): [float(np.exp(-(((nm - peak) / 40) ** 2))) for peak in (600, 540, 460)]
        for nm in range(380, 781, 5)
    }
    table = {"spectral_data": {"index": {"main": ["R", "G", "B"]}, "data": {"main": rows}}}
    (tmp_path / "Acme_One_380_780_5.json").write_text(json.dumps(table))
    (tmp_path / "my_torch.csv").write_text("wavelength_nm,power\n400,1\n700,3\n")
    flags = ("--camera", "Acme One", "--flash-spectrum", "my torch", "--outputs", "gamma.png")

    unknown = command(two.exact, *flags)
    known = command(two.exact, *flags, "--lights", 2, LIGHTLAYERS_SPECTRA=str(tmp_path))

    assert (unknown.code, known.code) == (2, 0)
    assert "No camera is called 'Acme One'" in unknown.stderr
    assert known.results.manifest["camera"] == {"name": "Acme One", "source": "measured"}
    assert known.results.manifest["flash"]["name"] == "my torch"


def test_flash_spectrum_by_name_and_file(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    from pipeline.spectra.lights import find_light
    from pipeline.spectra.wavelengths import WAVELENGTHS_NM

    table = tmp_path / "bulb.csv"
    rows = np.column_stack([WAVELENGTHS_NM, find_light("A")])
    np.savetxt(table, rows, "%.9g", ",", header="wavelength_nm,power", comments="")

    named = separated(two.exact, *EXACT, "--flash-spectrum", "A")
    filed = separated(two.exact, *EXACT, "--flash-spectrum", table)

    shift = [
        abs(a["cct_k"] - b["cct_k"])
        for a, b in zip(named.manifest["lamps"], plain.manifest["lamps"], strict=True)
        if a["cct_k"] and b["cct_k"]
    ]
    assert plain.manifest["flash"] != named.manifest["flash"]
    assert max(shift, default=1e9) > 300
    # the table's nine digits move where the search ends
    np.testing.assert_allclose(filed.layers(), named.layers(), atol=2.5e-3)


def test_encoding_says_how_values_become_light(
    two: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    light = two.truth.layers.sum(0)
    codes = [linear_to_srgb(values) for values in (light, light + two.truth.flash)]
    pair = tuple(
        write_tiff(tmp_path / f"{i}.tif", np.round(code * 65535).astype(np.uint16))
        for i, code in enumerate(codes)
    )
    flags = (*EXACT, "--outputs", "layers.exr")

    found = {
        encoding: separated(pair, *flags, "--encoding", encoding).layers().sum(0)
        for encoding in ("auto", "linear", "srgb")
    }

    np.testing.assert_allclose(found["srgb"], light, atol=1e-3)
    np.testing.assert_allclose(found["linear"], codes[0], atol=1e-3)
    np.testing.assert_array_equal(found["auto"], found["linear"])


def test_flash_only_takes_the_flash_part_as_it_is(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    part = write_tiff(tmp_path / "part.tif", two.truth.flash)

    results = separated((two.exact[0], part), *EXACT, "--flash-only")

    snr = [np.mean(r.layer_snr_db(two.truth)) for r in (results, plain)]
    assert snr[0] == pytest.approx(snr[1], abs=1.0)


def test_exposure_ratio_scales_the_flash_frame(
    two: Any, plain: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    longer = write_tiff(tmp_path / "longer.tif", 4 * (two.truth.layers.sum(0) + two.truth.flash))

    told = separated((two.exact[0], longer), *EXACT, "--exposure-ratio", 4)

    assert plain.manifest["exposure_ratio"] == 1
    assert told.manifest["exposure_ratio"] == 4
    np.testing.assert_allclose(told.layers(), plain.layers(), atol=1e-3)


def test_no_align_leaves_a_moved_frame_where_it_is(
    two: Any, separated: Callable[..., Any], tmp_path: Path
) -> None:
    light = two.truth.layers.sum(0)
    pair = (
        write_tiff(tmp_path / "still.tif", light[12:-12, 12:-12]),
        write_tiff(tmp_path / "moved.tif", (light + two.truth.flash)[16:-8, 5:-19]),
    )
    truth = replace(two.truth, layers=two.truth.layers[:, 12:-12, 12:-12])
    flags = (*NIKON, "--lights", 2)

    aligned = separated(pair, *flags)
    left = separated(pair, *flags, "--no-align")

    alignment = aligned.manifest["alignment"]
    assert alignment["applied"] is True
    assert alignment["correlation"] > 0.9
    np.testing.assert_allclose(
        np.array(alignment["matrix"]), [[1, 0, 7], [0, 1, -4], [0, 0, 1]], atol=0.1
    )
    assert left.manifest["alignment"]["applied"] is False
    better, worse = (np.mean(results.layer_snr_db(truth)) for results in (aligned, left))
    assert better > worse + 10


def test_a_pair_that_fits_is_left_as_it_is(
    two: Any, plain: Any, separated: Callable[..., Any]
) -> None:
    results = separated(two.exact, *NIKON, "--lights", 2)

    assert results.manifest["alignment"]["applied"] is False
    assert results.manifest["alignment"]["correlation"] > 0.9
    np.testing.assert_array_equal(results.layers(), plain.layers())


def test_neutral_sets_the_light_that_pictures_are_shown_under(
    two: Any, separated: Callable[..., Any]
) -> None:
    """Under a bulb, white-balanced pictures are warm: more red to blue than in daylight."""
    flags = (*EXACT, "--outputs", "white_balanced.exr")
    daylight = separated(two.exact, *flags, "--neutral", "D65").exr("white_balanced.exr")
    bulb = separated(two.exact, *flags, "--neutral", "A").exr("white_balanced.exr")

    def warmth(image: Any) -> float:
        return float(image[..., 0].sum() / image[..., 2].sum())

    assert warmth(bulb) > 2 * warmth(daylight)
    np.testing.assert_allclose(bulb[..., 1].mean(), daylight[..., 1].mean(), rtol=0.2)


def test_response_shows_the_picture_through_another_camera(
    two: Any, plain: Any, separated: Callable[..., Any]
) -> None:
    results = separated(two.exact, *EXACT, "--response", "Sigma SD1 Merrill")

    shown = {"response.jpg", "response_lamp1.jpg", "response_lamp2.jpg"}
    assert results.files - plain.files == shown
    assert shown <= {file["name"] for file in results.manifest["files"]}


@pytest.mark.parametrize("method", ["best", "paper"])
def test_layers_through_another_camera_add_up_to_the_photograph(
    scene: Callable[..., Any], separated: Callable[..., Any], method: str
) -> None:
    """Through the same camera they are the layers; through another one they are not."""
    flags = (*EXACT, "--method", method, "--outputs", "layers.exr,response.exr")
    same, other = (
        separated(scene(2).exact, *flags, "--response", name)
        for name in ("Nikon D5100", "Sigma SD1 Merrill")
    )

    plain = same.layers()
    light = plain.sum(0)
    np.testing.assert_allclose(same.exr("response.exr"), light, rtol=2**-10, atol=1e-4)
    seen = other.exr("response.exr")
    layers = [other.exr("response.exr", f"lamp{i}.") for i in (1, 2)]
    np.testing.assert_allclose(sum(layers), seen, rtol=2**-10, atol=1e-4)
    assert np.median(np.abs(seen - light)) > 0.03 * np.median(light)
    np.testing.assert_allclose(np.median(seen[..., 1]), np.median(light[..., 1]), rtol=0.16)


def test_outputs_names_the_files(two: Any, separated: Callable[..., Any]) -> None:
    names = "white_balanced.exr,lamps.jpg,gamma.png"

    results = separated(two.exact, *EXACT, "--outputs", names)

    files = {"white_balanced.exr", "lamp1.jpg", "lamp2.jpg", "gamma.png"}
    assert results.files == {"manifest.json", *files}
    assert {file["name"] for file in results.manifest["files"]} == files


def test_outputs_default_and_all(two: Any, plain: Any, separated: Callable[..., Any]) -> None:
    default = {
        "manifest.json",
        "layers.exr",
        *(f"lamp{i}.{suffix}" for i in (1, 2) for suffix in ("tif", "jpg")),
        "white_balanced_1.jpg",
        "white_balanced_2.jpg",
        "confidence.tif",
        "gamma.png",
        "residual.png",
        "preview.exr",
        "thumbnail.jpg",
    }

    everything = separated(two.exact, *EXACT, "--outputs", "all")

    assert plain.files == default
    on_request = {f"white_balanced{kind}" for kind in ("_1.tif", "_2.tif", ".exr")} | {"layers.psd"}
    assert everything.files == default | on_request


def test_json_prints_the_manifest(
    two: Any, command: Callable[..., Any], process: Callable[..., Any]
) -> None:
    run = command(two.exact, *EXACT, "--json", "--outputs", "gamma.png", run=process)

    assert run.code == 0
    assert json.loads(run.stdout) == run.results.manifest
