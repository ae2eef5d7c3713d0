"""A hand that shakes while the light of the room is gathered."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import cv2
import numpy as np

from pipeline.arrays import Floats64
from tests.evaluation.scenes import RenderedScene

_STEPS = 40  # in a pixel along the path


def shaken(rendered: RenderedScene, length_px: float) -> RenderedScene:
    """The scene as a hand sees it that moves evenly along a line during the first photograph.

    length_px: of the line, whose direction is the scene's own. The truth, each lamp's light, is
    blurred with the photograph; the flash photograph, short as it is, stays sharp.
    """
    seed = int.from_bytes(hashlib.sha256(f"shake {rendered.scene.name}".encode()).digest()[:4])
    line = path(length_px, np.random.default_rng(seed).uniform(0, np.pi))
    lamps = [cv2.filter2D(lamp, -1, line, borderType=cv2.BORDER_REFLECT) for lamp in rendered.lamps]
    return replace(rendered, lamps=np.stack(lamps))


def path(length_px: float, direction: float) -> Floats64:
    """How long each pixel sees the light of the middle one: (n, n), together 1.

    direction: of the line, radians from the x axis towards y.
    """
    reach = int(np.ceil(length_px / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    places = np.linspace(-0.5, 0.5, max(round(length_px * _STEPS), 1)) * length_px
    for x, y in zip(places * np.cos(direction), places * np.sin(direction), strict=True):
        left, top = int(np.floor(x)), int(np.floor(y))
        right, low = x - left, y - top
        share = np.outer([1 - low, low], [1 - right, right])
        kernel[reach + top : reach + top + 2, reach + left : reach + left + 2] += share
    return kernel / len(places)
