"""What is known of a ball before the camera."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from pipeline.photometric_stereo.materials import find_materials
from pipeline.photometric_stereo.objective import with_even_albedo
from pipeline.photometric_stereo.responses import LampBank
from pipeline.photometric_stereo.scene import Scene, State
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import find_light
from tests.ball import Ball, make_ball


@pytest.fixture(scope="session")
def ball(camera: Camera) -> Callable[..., Ball]:
    """Build a ball before that camera; see make_ball."""
    return partial(make_ball, camera.sensitivities)


@pytest.fixture(scope="session")
def bank(camera: Camera) -> LampBank:
    """Lamps as that camera sees them, under a xenon flash."""
    return LampBank(camera.sensitivities, find_light("xenon"))


@pytest.fixture(scope="session")
def scene_of(bank: LampBank) -> Callable[..., Scene]:
    """What is known of a ball. variance: of every light."""

    def build(ball: Ball, variance: float = 1e-10) -> Scene:
        mask = ball.inside
        flash, light = ball.flash[mask], ball.light[mask]
        chromaticity = flash[:, :2] / flash.sum(axis=1, keepdims=True)
        return Scene(
            ball.grid,
            ball.directions,
            flash,
            light,
            np.full_like(light, variance),
            tuple(bank.prior(colour) for colour in ball.colours),
            find_materials(chromaticity, 0.008),
        )

    return build


@pytest.fixture(scope="session")
def true_state() -> Callable[..., State]:
    """The surface as it is, lamps and materials as is usual."""

    def build(ball: Ball, scene: Scene) -> State:
        size = len(ball.depth)
        y, x = np.mgrid[: size + 1, : size + 1] - size / 2
        ray = np.stack([x, -y, np.full_like(x, -ball.focal_px)], axis=-1) / ball.focal_px
        a, b = (ray**2).sum(axis=2), 2.0
        h = ((b - np.sqrt(np.maximum(b**2 - a * (4 - 0.4**2), 0))) / a) ** 2
        lamps, modes = len(scene.directions), len(scene.priors[0].modes)
        own = np.zeros((len(scene.materials), lamps, 3))
        lit = ball.lamps.sum(axis=3)[:, ball.inside].T > 0
        state = State(
            scene.grid.at(h),
            np.zeros((lamps, modes)),
            own,
            np.zeros((scene.segment_count, 3)),
            np.zeros((lamps, 2)),
            lit,
        )
        return with_even_albedo(scene, state)

    return build
