"""Glossy paint under two lamps through the command line: whose light its highlights are.

Light of whole spectra on measured paints: what matrices of lamps make of matt light is the limit.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.images.frames import Frame
from pipeline.spectra.cameras import find_camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from tests.acceptance.conftest import float_tiff, snr_db

HEIGHT, WIDTH = 240, 360
CAMERA = "Nikon D5100"


@dataclass(frozen=True)
class Glossy:
    """Files of a pair, its layers (2, H, W, 3), and where a lamp is mirrored, (2, H, W)."""

    pair: tuple[Path, Path]
    layers: Floats64
    mirrors: NDArray[np.bool_]


@pytest.fixture(scope="module")
def glossy(tmp_path_factory: pytest.TempPathFactory) -> Glossy:
    """Squares of many paints in the light of a bulb and of the sky, shadows of either lamp.

    Two glossy panels of red and of yellow paint mirror both.
    """
    black = np.zeros((2, 2, 3), np.float32)
    camera = find_camera(CAMERA, Frame(black, np.zeros((2, 2), bool), "linear", ""))
    lights = np.array([find_light(name) for name in ("xenon", "A", "D150")])
    seen = camera.sensitivities * lights[:, None]
    seen /= seen[:, 1].sum(axis=1)[:, None, None]
    paints = reflectance_spectra() @ seen.transpose(0, 2, 1)
    colour = paints[0] / paints[0].sum(axis=1, keepdims=True)
    reddest = np.argsort(-colour[:, 0])
    rng = np.random.default_rng(4)
    squares = rng.integers(0, paints.shape[1], (HEIGHT // 20, WIDTH // 20))
    squares[1:7, 1:8], squares[1:7, 10:17] = reddest[0], reddest[12]
    flash, *lit = paints[:, squares].repeat(20, axis=1).repeat(20, axis=2)
    v, u = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]
    shares = np.array([0.9 - 0.6 * u, 0.25 + 0.5 * u])
    for one, across in zip(shares, (0.3, 0.7), strict=True):
        one[np.hypot(u - across, v - 0.8) < 0.1] = 0
    white = seen.sum(axis=2)
    mirrors = np.zeros((2, HEIGHT, WIDTH), bool)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for one, places in zip(mirrors, ((60, 240), (120, 300)), strict=True):
        for middle in places:
            one |= np.hypot(y - 80, x - middle) < 11
    layers = 0.5 * shares[..., None] * np.array(lit)
    layers += 0.12 * mirrors[..., None] * white[1:, None, None]
    flash *= 0.6 * (1 - 0.6 * ((u - 0.5) ** 2 + (v - 0.5) ** 2))[..., None]
    folder, light = tmp_path_factory.mktemp("glossy"), layers.sum(axis=0)
    pair = folder / "no_flash.tif", folder / "flash.tif"
    for path, picture in zip(pair, (light, light + flash), strict=True):
        path.write_bytes(float_tiff(picture))
    return Glossy(pair, layers, mirrors)


def test_highlights_are_light_of_the_lamp_that_is_mirrored(
    glossy: Glossy, separated: Callable[..., Any]
) -> None:
    """In proportions of matt light alone layers come to 14.4 dB, highlights to −2.3 and 4.2 dB.

    33.7, 34.9 and 34.4 dB are reached.
    """
    results = separated(glossy.pair, "--camera", CAMERA, "--lights", 2, "--outputs", "layers.exr")

    found, true = results.layers(), glossy.layers
    found = max(
        (found[list(order)] for order in itertools.permutations(range(2))),
        key=lambda layers: snr_db(layers, true),
    )
    assert snr_db(found, true) > 32
    for mirror in glossy.mirrors:
        assert snr_db(found[:, mirror], true[:, mirror]) > 32
    matt = ~glossy.mirrors.any(axis=0)
    assert snr_db(found[:, matt], true[:, matt]) > 33
