from __future__ import annotations

import io

import numpy as np
import pytest
import tifffile

from tests.evaluation.objects import OBJECTS, ObjectShot, photograph
from tests.evaluation.spectra import Split


def values(shot: ObjectShot) -> list[np.ndarray]:
    return [tifffile.imread(io.BytesIO(file)) for file in shot.files]


@pytest.fixture(scope="module")
def ball() -> ObjectShot:
    return photograph(OBJECTS["development"][0], "development")


def test_a_ball_has_the_normals_and_the_depth_of_one(ball: ObjectShot) -> None:
    """Radius 0.42 at a distance of 2, the camera on its axis."""
    known = np.isfinite(ball.normals).all(axis=2)
    y, x = np.mgrid[:192, :192] - 95.5
    focal = ball.options["focal_px"]
    across = ball.depth * x / focal

    assert known.mean() == pytest.approx(0.5, abs=0.02)
    np.testing.assert_allclose(ball.normals[known][:, 0], across[known] / 0.42, atol=0.03)
    np.testing.assert_allclose(ball.normals[known][:, 2], (2 - ball.depth[known]) / 0.42, atol=0.03)
    assert ball.depth[known].min() == pytest.approx(1.58, abs=0.001)
    assert y[known].max() > 70


def test_light_is_lambert_s_and_the_flash_falls_off(ball: ObjectShot) -> None:
    no_flash, both = values(ball)
    lit = ball.lit
    directions = np.array([light["direction"] for light in ball.lights])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosine = ball.normals[lit] @ directions.T

    residual = np.linalg.lstsq(cosine, no_flash[lit], rcond=None)[1]

    assert (residual / np.square(no_flash[lit]).sum(axis=0) < 1e-5).all()
    y, x = np.mgrid[:192, :192] - 95.5
    focal = ball.options["focal_px"]
    place = np.stack([x, -y, np.full_like(x, -focal)], axis=2)[lit] / focal
    place *= ball.depth[lit][:, None]
    distance = np.linalg.norm(place, axis=1)
    shading = -(ball.normals[lit] * place).sum(axis=1) / distance**3
    ratio = (both - no_flash)[lit][:, 1] / shading
    assert np.std(ratio) / np.mean(ratio) < 0.005


def test_no_channel_is_clipped_and_the_picture_is_the_same_each_time(ball: ObjectShot) -> None:
    again = photograph(OBJECTS["development"][0], "development")

    assert again.files == ball.files
    assert 0.85 < values(ball)[1].max() < 1


def test_a_lamp_that_is_off_leaves_the_others_as_they_are(ball: ObjectShot) -> None:
    thing = OBJECTS["development"][0]
    alone = [values(photograph(thing, "development", on=(j,))) for j in range(3)]
    flash = [both - no_flash for no_flash, both in alone]
    scaled = [no_flash / part.max() for (no_flash, _), part in zip(alone, flash, strict=True)]
    no_flash, both = values(ball)

    np.testing.assert_allclose(
        np.sum(scaled, axis=0), no_flash / (both - no_flash).max(), atol=1e-5
    )


def test_noise_is_that_of_a_sensor() -> None:
    thing = OBJECTS["development"][0]
    clean, noisy = (photograph(thing, "development", noise=noise) for noise in (False, True))
    light, codes = values(clean)[0], values(noisy)[0] / 65535

    bright = light > 0.1
    deviation = (codes - light)[bright] / np.sqrt(light[bright] / 20_000 + (5 / 20_000) ** 2)
    assert np.std(deviation) == pytest.approx(1, abs=0.02)
    assert abs(np.mean(deviation)) < 0.02


def test_the_halves_share_no_object() -> None:
    both = [{one.name for one in things} for things in OBJECTS.values()]

    assert not both[0] & both[1]
    for split in OBJECTS:
        counts = [one.materials for one in OBJECTS[split]]
        assert counts.count(1) >= 2
        assert sum(count > 1 for count in counts) >= 4


@pytest.mark.parametrize("number", [0, 5])
def test_of_one_object_before_another_both_are_seen_and_depth_jumps(number: int) -> None:
    thing = OBJECTS["development"][8 + number]
    shot = photograph(thing, "development")

    known = np.isfinite(shot.depth) & np.isfinite(shot.normals).all(axis=2)
    depth = np.where(known, shot.depth, np.nan)
    jumps = [np.nansum(np.abs(np.diff(depth, axis=axis)) > 0.05) for axis in (0, 1)]

    assert thing.name == f"one before another {number}"
    assert sum(jumps) > 10
    assert 0.1 < np.mean(shot.depth[known] < 1.77) < 0.5


@pytest.mark.parametrize("kind", ["peaked", "filtered"])
def test_lamps_of_a_kind_differ_from_others(kind: str) -> None:
    split: Split = "development"
    thing = OBJECTS[split][0]

    rgb = [
        np.array([light["rgb"] for light in photograph(thing, split, each).lights])  # type: ignore[arg-type]
        for each in ("measured", kind)
    ]

    assert np.abs(rgb[0] - rgb[1]).max() > 0.05
    unit = rgb[1] / np.linalg.norm(rgb[1], axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.sort((unit @ unit.T).ravel())[-4])) > 8
