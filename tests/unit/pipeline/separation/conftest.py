"""Scenes with highlights, and their layers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.images.noise import Noise
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import Options
from pipeline.pair.pair import Pair
from pipeline.progress import Progress
from pipeline.separation import separation
from pipeline.separation.separation import separate
from tests.unit.pipeline.separation.glossy import (
    RADIUS,
    SIZE,
    Scene,
    balanced,
    discs,
    noisy,
)


@pytest.fixture
def paints(surfaces: Floats64, model: Model) -> Floats64:
    """Measured surfaces (m, 3) under the flash, those of the most saturated colours first."""
    white = model.flash_white / model.flash_white.sum()
    off = surfaces / surfaces.sum(axis=1, keepdims=True) - white
    return surfaces[np.argsort(-np.linalg.norm(off, axis=1))]


@pytest.fixture
def scene(
    model: Model,
    paints: Floats64,
    pair_of: Callable[..., Pair],
    lamps_of: Callable[..., Lamps],
    warm_to_cool: Floats64,
) -> Callable[..., Scene]:
    """Make red paint in even light, with patches that mirror one lamp, the other, and the flash.

    Below the middle the paint is paler, but for the last patch, which looks as pale under the flash
    since it mirrors that. gloss, of_flash: how much is mirrored of lamps, and of the flash. radius:
    of the patches.
    """

    def build(
        gloss: float = 0.1,
        of_flash: float = 0.03,
        size: tuple[int, int] = SIZE,
        noise: Noise | None = None,
        paint: Floats64 = paints[0],
        radius: float = RADIUS,
        **more: Any,
    ) -> Scene:
        chosen, mirrors = warm_to_cool[[0, 2]], discs(size, radius)
        matrices, white = model.lamp_matrix(chosen), model.flash_white
        v, u = np.mgrid[: size[0], : size[1]] / np.array(size)[:, None, None]
        shading = (0.8 - 0.6 * ((u - 0.5) ** 2 + (v - 0.5) ** 2))[..., None]
        pale = paint + of_flash * white * (v > 0.5)[..., None]
        flash = shading * pale
        matt = shading * np.where(mirrors[2][..., None], paint, pale)
        z = np.stack([0.6 - 0.4 * u, 0.2 + 0.4 * u])
        layers = np.einsum("nhw,nkl,hwl->nhwk", z, matrices, matt)
        layers += gloss * mirrors[:2, ..., None] * (matrices @ white)[:, None, None]
        light = layers.sum(axis=0)
        pair = noisy(light, flash, noise, pair_of, **more)
        return Scene(pair, lamps_of(chosen, **balanced(light)), layers, mirrors)

    return build


@pytest.fixture
def layers_by(model: Model, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Floats32]:
    """Layers that separate gives of a scene, in strips; without highlights by matt light alone."""

    def run(scene: Scene, rows: int = 1000, highlights: bool = True) -> Floats32:
        with monkeypatch.context() as patch:
            if not highlights:
                patch.setattr(separation, "find_highlights", lambda *_: None)
            strips = separate(
                scene.pair, scene.reduced, scene.lamps, model, Options(), Progress(), rows
            )
            return np.concatenate([strip.layers for strip in strips], axis=1)

    return run
