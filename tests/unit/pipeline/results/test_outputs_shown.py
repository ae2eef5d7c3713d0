"""How bright and in what colours outputs show the pictures of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import tifffile
import trimesh
from numpy.typing import NDArray
from PIL import Image as PillowImage
from psd_tools import PSDImage

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_REC2020, XYZ_TO_SRGB
from pipeline.encode.jpeg import to_srgb8
from pipeline.light.model import Model, build_model
from pipeline.pictures.shown import shown_gain
from pipeline.pictures.white_balance import whites_of
from pipeline.results.pictures import Pictures
from pipeline.spectra.cameras import Camera, measured_cameras
from pipeline.spectra.lights import find_light
from pipeline.spectra.observer import cie_1931

SIZE = (40, 64)


def shown(path: Path) -> NDArray[np.uint8]:
    """Code values of a picture."""
    with PillowImage.open(path) as picture:
        return np.asarray(picture)


def test_a_neutral_picture_is_grey_in_16_bits(
    written: Callable[..., list[dict[str, Any]]],
    pictures: Pictures,
    model: Model,
    tmp_path: Path,
) -> None:
    """A white card under daylight, which is the white of Rec. 2020."""
    white = 0.5 * model.flash_to_neutral @ model.flash_white
    card = np.broadcast_to(white, (40, 64, 3)).astype(np.float32)
    neutral = replace(pictures, white_balanced_1=card, white_balanced_2=0.5 * card)

    written("white_balanced_1.tif", "white_balanced_2.tif", given=neutral)

    first, second = (tifffile.imread(tmp_path / f"white_balanced_{i}.tif") for i in (1, 2))
    assert first.dtype == np.uint16
    assert first.max() < 1.01 * first.min()
    np.testing.assert_allclose(second, first / 2, atol=1)


def test_lamps_are_written_in_rec_2020_on_one_scale(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, model: Model, tmp_path: Path
) -> None:
    """One factor for all layers, so that they still add up, and none for what already fits."""
    written("lamps.tif")

    for i in (0, 1):
        codes = tifffile.imread(tmp_path / f"lamp{i + 1}.tif").astype(np.float64) / 65535
        true = pictures.layers[i] @ (XYZ_TO_REC2020 @ model.camera_to_xyz).T
        fits = (true > 0.05).all(axis=2)
        assert fits.sum() > 100
        ratio = codes[fits] / true[fits]
        assert np.ptp(ratio) < 0.01
        assert ratio.max() < 1.01
        assert ratio.min() > 0.2


@pytest.mark.parametrize("lamp", ["A", "HP1", "D65"])
def test_a_white_card_that_the_sensor_holds_is_not_cut_off(
    written: Callable[..., list[dict[str, Any]]],
    pictures: Pictures,
    model: Model,
    tmp_path: Path,
    lamp: str,
) -> None:
    """Under a warm lamp red alone is full, and becomes 1.05 times what the sensor's white does."""
    card = model.camera.sensitivities @ find_light(lamp)
    ramp = np.linspace(0.9, 1.0, SIZE[1])[None, :, None] * card / card.max()
    layer = np.broadcast_to(ramp, (*SIZE, 3)).astype(np.float32)

    written("lamps.tif", given=replace(pictures, layers=np.stack([layer, 0 * layer])))

    red = tifffile.imread(tmp_path / "lamp1.tif")[0, :, 0].astype(np.float64)
    np.testing.assert_allclose(red / red[-1], np.linspace(0.9, 1.0, SIZE[1]), atol=1e-4)


@pytest.mark.parametrize("name", ["Nikon D5100", "Sigma SD1 Merrill"])
def test_what_fills_the_whole_sensor_is_not_cut_off(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path, name: str
) -> None:
    """Of which red or blue is more than the screen's white, of one camera more than of any lamp."""
    cameras = {one.name: one for one in measured_cameras()}
    ramp = np.broadcast_to(np.linspace(0.9, 1.0, SIZE[1])[:, None], (*SIZE, 3)).astype(np.float32)
    layers = np.stack([ramp, 0 * ramp])
    given = replace(pictures, layers=layers, shown_layers=layers, white_balanced_1=ramp)
    model = build_model(cameras[name], find_light("xenon"), find_light("D65"), "wpca")

    written("lamps.tif", "white_balanced_1.tif", by=model, given=given)

    for file in ("lamp1.tif", "white_balanced_1.tif"):
        codes = tifffile.imread(tmp_path / file)[0].max(axis=1).astype(np.float64)
        np.testing.assert_allclose(codes / codes[-1], ramp[0, :, 0], atol=1e-4)


def test_layers_of_a_photoshop_file_are_those_of_the_tiff_files(
    written: Callable[..., list[dict[str, Any]]], tmp_path: Path
) -> None:
    written("layers.psd", "lamps.tif")

    for layer, number in zip(PSDImage.open(tmp_path / "layers.psd"), (1, 2), strict=True):
        codes = tifffile.imread(tmp_path / f"lamp{number}.tif")
        np.testing.assert_allclose(layer.numpy() * 65535, codes, atol=0.6)


@pytest.mark.parametrize("light", [1e-3, 1.0, 20.0])
def test_shown_pictures_are_neither_black_nor_white(
    written: Callable[..., list[dict[str, Any]]],
    pictures: Pictures,
    tmp_path: Path,
    light: float,
) -> None:
    """Dark ones are lifted by a factor of eight at most, bright ones lowered as far as it takes."""
    layers = pictures.layers * np.float32(light)
    written("lamps.jpg", given=replace(pictures, layers=layers, shown_layers=layers))

    mean = shown(tmp_path / "lamp1.jpg").mean()
    low, high = {1e-3: (1, 40), 1.0: (60, 200), 20.0: (60, 200)}[light]
    assert low < mean < high


def test_layers_are_shown_on_the_scale_of_the_photograph(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    """A faint layer stays fainter than a strong one."""
    faint = pictures.layers * np.array([0.05, 1], np.float32)[:, None, None, None]

    written(
        "lamps.jpg",
        given=replace(pictures, layers=faint, shown_layers=faint),
        photograph=pictures.layers.sum(axis=0),
    )

    means = [shown(tmp_path / f"lamp{i}.jpg").mean() for i in (1, 2)]
    assert means[0] < 0.6 * means[1]


@pytest.fixture(params=["D65", "A"])
def neutral(request: pytest.FixtureRequest, camera: Camera) -> tuple[Model, Floats64, Floats64]:
    """A model with this neutral light, a white card under it as the camera sees it, and its XYZ."""
    light = find_light(request.param)
    seen, xyz = camera.sensitivities @ light, cie_1931() @ light
    return build_model(camera, find_light("xenon"), light, "wpca"), seen / seen[1], xyz / xyz[1]


@pytest.mark.parametrize("number", [1, 2])
def test_neutral_pictures_are_shown_in_the_colour_of_their_light_and_as_bright_as_their_overview(
    written: Callable[..., list[dict[str, Any]]],
    pictures: Pictures,
    neutral: tuple[Model, Floats64, Floats64],
    tmp_path: Path,
    number: int,
) -> None:
    """A white card at the left, which fills the screen, and a grey one of a quarter of it."""
    model, card, xyz = neutral
    picture = np.broadcast_to(0.4 * number * card, (*SIZE, 3)).astype(np.float32)
    picture[:, 32:] /= 4
    name = f"white_balanced_{number}"
    balanced: dict[str, Any] = {name: picture}

    written(f"{name}.jpg", f"{name}.tif", by=model, given=replace(pictures, **balanced))

    rgb = np.array([[XYZ_TO_SRGB @ xyz]], np.float32)
    codes, linear = shown(tmp_path / f"{name}.jpg"), tifffile.imread(tmp_path / f"{name}.tif")
    for x, share in ((8, 1.0), (56, 0.25)):
        expected = to_srgb8(rgb / rgb.max() * np.float32(share))[0, 0]
        np.testing.assert_allclose(codes[20, x].astype(int), expected, atol=3)
    wide = XYZ_TO_REC2020 @ xyz
    np.testing.assert_allclose(linear[20, 8] / linear[20, 8].max(), wide / wide.max(), atol=2e-3)


def test_the_thumbnail_shows_the_photograph(
    written: Callable[..., list[dict[str, Any]]], model: Model, tmp_path: Path
) -> None:
    """A card of the sensor's own colours at the left, which fills the screen, and a darker one."""
    photograph = np.full((*SIZE, 3), (0.2, 0.3, 0.1), np.float32)
    photograph[:, 32:] /= 4
    to_srgb = XYZ_TO_SRGB @ model.camera_to_xyz
    to_srgb = to_srgb / (to_srgb @ photograph[0, 0]).max()

    written("thumbnail.jpg", photograph=photograph)

    codes = shown(tmp_path / "thumbnail.jpg").astype(int)
    assert codes.shape == (*SIZE, 3)
    for x in (8, 56):
        np.testing.assert_allclose(codes[20, x], to_srgb8(photograph, to_srgb)[20, x], atol=3)


def test_clipped_light_of_the_thumbnail_has_the_colour_of_all_lamps_together(
    written: Callable[..., list[dict[str, Any]]],
    pictures: Pictures,
    lamps_of: Callable[..., Any],
    warm_to_cool: Floats64,
    model: Model,
    tmp_path: Path,
) -> None:
    """At the right, where the first lamp has three times the other one's light."""
    photograph = np.full((*SIZE, 3), (0.2, 0.3, 0.1), np.float32)
    photograph[:, 32:] = 1.0
    layers = np.stack([0.75 * photograph, 0.25 * photograph])
    to_srgb = XYZ_TO_SRGB @ model.camera_to_xyz
    to_srgb = to_srgb * shown_gain(photograph, to_srgb)
    whites = whites_of(lamps_of(warm_to_cool[[0, 2]]), model)
    white = np.array([3.0, 1.0]) @ (whites / whites[:, 1:2])
    expected = np.stack([photograph[0, 0], white / white.min()])[None].astype(np.float32)

    written(
        "thumbnail.jpg",
        photograph=photograph,
        clipping=1.0,
        given=replace(pictures, layers=layers, shown_layers=layers),
    )

    codes = shown(tmp_path / "thumbnail.jpg")[20].astype(int)
    np.testing.assert_allclose(codes[[8, 56]], to_srgb8(expected, to_srgb)[0], atol=3)


def test_pictures_of_layers_are_of_those_to_be_shown(
    written: Callable[..., list[dict[str, Any]]], pictures: Pictures, tmp_path: Path
) -> None:
    """Files for other programs have the layers themselves."""
    names = "lamps.jpg", "preview.exr", "layers.exr", "lamps.tif"

    written(*names, given=replace(pictures, layers=0 * pictures.layers))

    means = [shown(tmp_path / f"lamp{i}.jpg").mean() for i in (1, 2)]
    assert min(means) > 60
    preview, layers = (
        OpenEXR.File(str(tmp_path / name), separate_channels=True).channels()
        for name in ("preview.exr", "layers.exr")
    )
    np.testing.assert_allclose(
        preview["lamp2.G"].pixels, pictures.shown_layers[1, ..., 1], rtol=2**-11, atol=1e-6
    )
    assert not layers["lamp2.G"].pixels.any()
    assert not tifffile.imread(tmp_path / "lamp2.tif").any()


def test_a_mesh_is_of_the_surface_and_shows_the_neutral_picture(
    written: Callable[..., list[dict[str, Any]]],
    pictures: Pictures,
    neutral: tuple[Model, Floats64, Floats64],
    tmp_path: Path,
) -> None:
    """A wall at depth 1.25 below the fifth row, seen with a focal length of 100 pixels."""
    model, card, xyz = neutral
    white = np.broadcast_to(card, (*SIZE, 3)).astype(np.float32)

    written("surface.glb", by=model, given=replace(pictures, white_balanced_1=white))

    (body,) = trimesh.load_scene(tmp_path / "surface.glb").geometry.values()
    low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
    np.testing.assert_allclose(low, [-31.5 * 0.0125, -19.5 * 0.0125, -1.25], atol=1e-6)
    np.testing.assert_allclose(high, [31.5 * 0.0125, 14.5 * 0.0125, -1.25], atol=1e-6)
    np.testing.assert_allclose(body.vertex_normals, np.tile([0, 0, 1], (35 * 64, 1)), atol=1e-4)
    rgb = np.array([[XYZ_TO_SRGB @ xyz]], np.float32)
    texture = np.asarray(body.visual.material.baseColorTexture).astype(int)
    np.testing.assert_allclose(texture[20, 20], to_srgb8(rgb / rgb.max())[0, 0], atol=3)
