from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.colour.temperature import cct_duv
from pipeline.encode.jpeg import to_srgb8
from pipeline.estimate import Estimate
from pipeline.images.frames import Exposure, Frame
from pipeline.light.model import Model
from pipeline.mixes.mix import mix_basis
from pipeline.options import DirectedLight, Options
from pipeline.pair.align import Alignment
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.reduced import reduce_pair
from pipeline.pair.tone_curve import ToneCurve
from pipeline.photometric_stereo.facing import Facing
from pipeline.results.manifest import Written, lamp_entries, make_manifest
from pipeline.run_warnings import Code, RunWarning
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light
from pipeline.spectra.observer import cie_1931
from pipeline.spectra.wavelengths import WAVELENGTHS_NM


@pytest.fixture
def manifest_of(
    frame: Callable[..., Frame],
    model: Model,
    exact: Callable[..., tuple[Any, Floats64]],
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
) -> Callable[..., dict[str, Any]]:
    """Build a manifest of a pair with two lamps; every argument can be replaced."""

    def build(**more: Any) -> dict[str, Any]:
        pair, _ = exact(warm_to_cool[[0, 2]])
        lamps = lamps_of(
            warm_to_cool[[0, 2]],
            requested="auto",
            confidence=0.98765,
            lamp_confidence=[0.9, 0.51239],
        )
        before, after = (
            frame(
                np.zeros((40, 60, 3)),
                sha256=digest,
                exposure=Exposure(0.02, 400, 2.8),
                encoding="raw",
            )
            for digest in ("aa", "bb")
        )
        given: dict[str, Any] = {
            "frames": (before, after),
            "options": Options(),
            "pair": pair,
            "estimate": Estimate(reduce_pair(pair), model, lamps, more.get("facing")),
            "written": Written(
                lamp_entries(lamps, model, np.array([1.0, 0.25])),
                filled=0.123456,
                files=[{"name": "layers.exr", "sha256": "cc"}],
                mix=mix_basis(pair.no_flash, pair.clipping, lamps, model),
            ),
            "calibrations": [{"kind": "flash", "name": "a"}],
            "warnings": [RunWarning(Code.FLICKER, "Something is odd.", {"height": 0.123456})],
        }
        given.update({key: value for key, value in more.items() if key in given})
        given["pair"] = replace(given["pair"], **more.get("pair_with", {}))
        return make_manifest(**given)

    return build


def test_the_manifest_says_what_is_needed(manifest_of: Callable[..., dict[str, Any]]) -> None:
    found = manifest_of()

    assert found["lights"] == {"requested": "auto", "found": 2, "confidence": 0.988}
    assert [lamp["name"] for lamp in found["lamps"]] == ["lamp1", "lamp2"]
    assert [lamp["separated_share"] for lamp in found["lamps"]] == [1.0, 0.25]
    assert found["camera"] == {"name": "Nikon D5100", "source": "measured"}
    assert found["flash"] == {"name": "xenon", "source": "named", "flash_only": False}
    assert found["exposure_ratio"] == 1.0
    assert found["exposure_source"] == "option"
    assert found["tone_curve"] is None
    assert found["local_tone_mapping"] is None
    assert found["balance_change"] is None
    assert found["moved"] == 0.0
    assert found["alignment"] == {
        "applied": False,
        "matrix": np.eye(3).tolist(),
        "correlation": None,
        "parallax": 0.0,
    }
    assert found["normals"] is None
    assert found["filled"] == 0.1235
    assert found["files"] == [{"name": "layers.exr", "sha256": "cc"}]
    assert found["calibrations"] == [{"kind": "flash", "name": "a"}]
    assert found["warnings"] == [
        {"code": "flicker", "message": "Something is odd.", "figures": {"height": 0.1235}}
    ]
    assert found["versions"]["lightlayers"] == version("lightlayers")
    assert found["versions"]["numpy"] == np.__version__


def test_inputs_are_told_apart_by_their_digests_not_by_their_names(
    manifest_of: Callable[..., dict[str, Any]],
) -> None:
    assert manifest_of()["inputs"] == {
        name: {
            "sha256": digest,
            "width": 60,
            "height": 40,
            "encoding": "raw",
            "exposure_time_s": 0.02,
            "iso": 400,
            "f_number": 2.8,
        }
        for name, digest in (("no_flash", "aa"), ("flash", "bb"))
    }


def test_what_the_camera_did_not_write_is_null(
    manifest_of: Callable[..., dict[str, Any]], frame: Callable[..., Frame]
) -> None:
    bare = frame(np.zeros((40, 60, 3)), sha256="aa")

    found = manifest_of(frames=(bare, bare))["inputs"]["flash"]

    assert found["exposure_time_s"] is None
    assert found["iso"] is None
    assert found["f_number"] is None


def test_the_manifest_is_json_and_the_same_every_time(
    manifest_of: Callable[..., dict[str, Any]],
) -> None:
    texts = [json.dumps(manifest_of(), allow_nan=False) for _ in range(2)]

    assert texts[0] == texts[1]
    assert json.loads(texts[0]) == manifest_of()


def test_all_options_are_repeated(manifest_of: Callable[..., dict[str, Any]]) -> None:
    options = Options(lights=2, method="paper", exposure_ratio=0.5, outputs=["gamma.png"])

    found = manifest_of(options=options)

    assert Options.model_validate(found["options"]) == options


def test_a_flash_table_is_called_a_table(manifest_of: Callable[..., dict[str, Any]]) -> None:
    table: Any = {"wavelength_nm": [400, 700], "power": [1, 1]}

    found = manifest_of(options=Options(flash_spectrum=table))

    assert found["flash"]["name"] == "table"
    assert found["flash"]["source"] == "file"


def test_a_contrast_that_was_taken_off_is_told(manifest_of: Callable[..., dict[str, Any]]) -> None:
    found = manifest_of(pair_with={"tone_curve": ToneCurve(np.linspace(-1.0, 0.0, 11))})

    assert found["tone_curve"]["codes"] == [round(0.1 * one, 1) for one in range(11)]
    assert found["tone_curve"]["light"][5] == round(0.2140411 * np.exp(-0.5), 5)
    json.dumps(found["tone_curve"])  # plain numbers


def test_a_balance_that_was_taken_off_is_written(
    manifest_of: Callable[..., dict[str, Any]],
) -> None:
    found = manifest_of(pair_with={"balance_change": BalanceChange(1.25, 0.8)})

    assert found["balance_change"] == {"red": 1.25, "blue": 0.8}


def test_a_local_tone_mapping_that_was_taken_off_is_written(
    manifest_of: Callable[..., dict[str, Any]],
) -> None:
    mapping = LocalToneMapping(np.log([[0.75, 1.5]]), 8, 0.25)

    found = manifest_of(pair_with={"local_tone_mapping": mapping})

    assert found["local_tone_mapping"] == {"power": 0.25, "least": 0.75, "most": 1.5}


def test_alignment_is_told_with_its_matrix(manifest_of: Callable[..., dict[str, Any]]) -> None:
    matrix = np.array([[1, 0, 2.3456789012345], [0, 1, -1], [1e-7, 0, 1]])

    found = manifest_of(pair_with={"alignment": Alignment(True, matrix, 0.87654321)})

    assert found["alignment"]["applied"] is True
    assert found["alignment"]["matrix"][0][2] == 2.345678901
    assert found["alignment"]["matrix"][2][0] == 1e-7
    assert found["alignment"]["correlation"] == 0.8765


def test_a_photograph_that_only_parallax_moved_was_moved(
    manifest_of: Callable[..., dict[str, Any]],
) -> None:
    found = manifest_of(pair_with={"parallax": 0.15})

    assert found["alignment"]["applied"] is True
    assert found["alignment"]["matrix"] == np.eye(3).tolist()


def test_normals_are_told_with_their_strengths(
    manifest_of: Callable[..., dict[str, Any]],
) -> None:
    facing = Facing(lambda strip: strip.flash, np.array([1, 0.56789, 0.25]), None)
    options = Options(light_directions=[DirectedLight(direction=(0, 0, 1))] * 3)

    found = manifest_of(facing=facing, options=options)["normals"]

    assert found["strengths"] == [1.0, 0.5679, 0.25]
    assert found["convention"] == "x right, y up, z to the viewer (OpenGL)"
    turned = manifest_of(facing=facing, options=options.model_copy(update={"normals": "dx"}))
    assert turned["normals"]["convention"] == "x right, y down, z to the viewer (DirectX)"


# lamps


def test_lamps_are_told_by_colour_and_temperature(
    model: Model, camera: Camera, lamps_of: Callable[..., Any]
) -> None:
    """Measured lights, seen through the model, are called nearly by their temperature."""
    lights = {"A": 2856, "D50": 5003, "D65": 6504}
    whites = np.array([camera.sensitivities @ find_light(name) for name in lights])
    coefficients = whites / np.linalg.norm(whites, axis=1, keepdims=True)

    entries = lamp_entries(lamps_of(coefficients), model, np.ones(3))

    for entry, kelvin, vector in zip(entries, lights.values(), coefficients, strict=True):
        assert entry["cct_k"] == pytest.approx(kelvin, rel=0.1)
        assert isinstance(entry["cct_k"], int)
        assert abs(entry["duv"]) < 0.01
        found = cct_duv(model.lamp_white(model.lamp_matrix(vector)))
        assert found is not None
        assert entry["duv"] == round(found[1], 4) != 0
        assert max(entry["rgb"]) == 1
        np.testing.assert_allclose(entry["coefficients"], vector, atol=1e-6)
        rgb = np.array(entry["rgb"]) / np.linalg.norm(entry["rgb"])
        np.testing.assert_allclose(rgb, vector, atol=0.03)


def test_lamps_are_named_by_their_family(
    model: Model, camera: Camera, lamps_of: Callable[..., Any]
) -> None:
    white = camera.sensitivities @ find_light("D150")

    (entry,) = lamp_entries(lamps_of(white / np.linalg.norm(white)), model, np.ones(1))

    family, confidence = model.families.nearest(model.lamp_matrix(white))
    assert entry["family"] == family == "daylight"
    assert entry["family_confidence"] == round(confidence, 3)
    assert confidence > 0.6


def test_pinned_lamps_are_told_by_their_place_in_the_option(
    lamps_of: Callable[..., Any], model: Model
) -> None:
    lamps = lamps_of(
        [[0.7, 0.6, 0.3], [0.4, 0.8, 0.4], [0.3, 0.6, 0.7]], pinned=np.array([1, -1, 0])
    )

    entries = lamp_entries(lamps, model, np.ones(3))

    assert [entry["pinned"] for entry in entries] == [1, None, 0]
    assert all(type(entry["pinned"]) is int for entry in entries[::2])


def test_a_lamp_of_the_colour_of_the_flash_has_its_grey_card(
    model: Model, lamps_of: Callable[..., Any]
) -> None:
    lamps = lamps_of(np.ones(3), matrices=np.eye(3)[None])

    (entry,) = lamp_entries(lamps, model, np.ones(1))

    expected = model.flash_white / model.flash_white.max()
    np.testing.assert_allclose(entry["rgb"], expected, atol=1e-4)


@pytest.mark.parametrize("colour", [(0.2, 1.0, 0.1), (0.9, 0.2, 1.0)], ids=["green", "purple"])
def test_coloured_light_has_no_temperature(
    model: Model, lamps_of: Callable[..., Any], colour: tuple[float, float, float]
) -> None:
    (entry,) = lamp_entries(lamps_of(np.array(colour) / np.linalg.norm(colour)), model, np.ones(1))

    assert entry["cct_k"] is None
    assert entry["duv"] is None


@pytest.mark.parametrize("peak_nm", [440, 450, 455, 460, 530, 620, 650])
def test_a_lamp_of_one_colour_has_it_on_a_screen(
    model: Model, camera: Camera, lamps_of: Callable[..., Any], peak_nm: int
) -> None:
    light = np.exp(-0.5 * ((WAVELENGTHS_NM - peak_nm) / 10) ** 2)
    white = camera.sensitivities @ light

    (entry,) = lamp_entries(lamps_of(white / np.linalg.norm(white)), model, np.ones(1))

    linear = XYZ_TO_SRGB @ cie_1931() @ light
    shown = to_srgb8((linear / linear.max()).astype(np.float32).reshape(1, 1, 3))[0, 0]
    found = np.array([*bytes.fromhex(entry["srgb"].removeprefix("#"))])
    assert np.abs(found - shown).max() < 50
    assert found.argmax() == shown.argmax() and np.median(found) < found.max() / 2


@pytest.mark.parametrize(("light", "warm"), [("A", True), ("D150", False)])
def test_a_lamp_has_a_colour_for_a_screen(
    model: Model, camera: Camera, lamps_of: Callable[..., Any], light: str, warm: bool
) -> None:
    white = camera.sensitivities @ find_light(light)

    (entry,) = lamp_entries(lamps_of(white / np.linalg.norm(white)), model, np.ones(1))

    red, green, blue = bytes.fromhex(entry["srgb"].removeprefix("#"))
    assert max(red, green, blue) > 250
    assert (red > green > blue) is warm
    assert (blue > green > red) is not warm


def test_light_that_no_camera_sees_is_told_without_negative_colours(
    model: Model, lamps_of: Callable[..., Any]
) -> None:
    (entry,) = lamp_entries(lamps_of(np.array([1.0, 0.1, -0.4])), model, np.ones(1))

    assert min(entry["rgb"]) >= 0
    assert max(entry["rgb"]) == 1


def test_light_that_points_the_other_way_is_told_by_its_colour(
    model: Model, lamps_of: Callable[..., Any]
) -> None:
    """As the published lights may under a wrong camera."""
    colour = np.array([0.7, 0.6, 0.3])

    (away,), (toward,) = (
        lamp_entries(lamps_of(sign * colour), model, np.ones(1)) for sign in (-1, 1)
    )

    assert away["rgb"] == toward["rgb"]
    assert away["cct_k"] == toward["cct_k"]


def test_confidence_is_rounded(model: Model, lamps_of: Callable[..., Any]) -> None:
    (entry,) = lamp_entries(
        lamps_of(np.array([0.7, 0.6, 0.3]), lamp_confidence=np.array([0.123456])),
        model,
        np.array([0.98765]),
    )

    assert entry["confidence"] == 0.123
    assert entry["separated_share"] == 0.988
    assert entry["name"] == "lamp1"
