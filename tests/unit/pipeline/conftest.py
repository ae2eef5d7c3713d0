"""Scenes that the model describes exactly, with every layer known."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.images.frames import Exposure, Frame, Image
from pipeline.images.noise import Noise
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model, build_model
from pipeline.matrixfit.deviations import no_deviations
from pipeline.matrixfit.evidence import gather_evidence
from pipeline.matrixfit.fit import FitInput
from pipeline.matrixfit.known import Known, nothing_known
from pipeline.pair.align import NOT_ATTEMPTED
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import reduce_pair
from pipeline.spectra.cameras import Camera, find_camera
from pipeline.spectra.lights import find_light, reflectance_spectra
from tests.ball import make_ball
from tests.unit.pipeline.separating import Files, tiff

HEIGHT, WIDTH, PATCH = 64, 96, 4


@pytest.fixture(scope="session")
def frame() -> Callable[..., Frame]:
    """Build a photograph from its pixels."""

    def build(pixels: Image, **more: Any) -> Frame:
        values = np.asarray(pixels, dtype=np.float32)
        given: dict[str, Any] = {
            "saturated": np.zeros(values.shape[:2], dtype=bool),
            "encoding": "linear",
            "sha256": str(float(values.sum(dtype=np.float64))),
        }
        return Frame(pixels=values, **{**given, **more})

    return build


@pytest.fixture(scope="session")
def camera(frame: Callable[..., Frame]) -> Camera:
    """A measured camera."""
    return find_camera("Nikon D5100", frame(np.zeros((2, 2, 3))))


@pytest.fixture(scope="session")
def model(camera: Camera) -> Model:
    """The model of that camera under a xenon flash, daylight as neutral light."""
    return build_model(camera, find_light("xenon"), find_light("D65"), "wpca")


@pytest.fixture(scope="session")
def surfaces(camera: Camera) -> Floats64:
    """Camera RGB (m, 3) of measured surfaces under the flash, a white card having green 1."""
    flash = find_light("xenon")
    seen = reflectance_spectra() @ (camera.sensitivities * flash).T
    return np.asarray(seen / (camera.sensitivities @ flash)[1])


@pytest.fixture(scope="session")
def warm_to_cool(camera: Camera) -> Floats64:
    """Coefficients (3, 3) of a bulb, of a green lamp and of blue sky, unit vectors."""
    seen = [camera.sensitivities @ find_light(name) for name in ("A", "D150")]
    rows = np.array([seen[0], [0.35, 0.9, 0.3], seen[1]])
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


@pytest.fixture(scope="session")
def lamps_of(model: Model) -> Callable[..., Lamps]:
    """Build Lamps from coefficients (N, 3), as if they had been found."""

    def build(coefficients: Floats64, **more: Any) -> Lamps:
        vectors = np.atleast_2d(coefficients).astype(np.float64)
        given: dict[str, Any] = {
            "coefficients": vectors,
            "matrices": model.lamp_matrix(vectors),
            "deviations": no_deviations(len(vectors)),
            "channel_weights": np.ones(3),
            "requested": len(vectors),
            "confidence": 1.0,
            "lamp_confidence": np.ones(len(vectors)),
            "pinned": np.full(len(vectors), -1),
            "invariants": np.repeat(vectors, 100, axis=0),
            "four_or_more": False,
            "left_over": 0.0,
            "alone": np.full(len(vectors), 0.01),
            "contradictions": (),
        }
        return Lamps(**{**given, **more})

    return build


@pytest.fixture(scope="session")
def pair_of() -> Callable[..., Pair]:
    """Build a pair without noise from the no-flash photograph and the flash part."""

    def build(no_flash: Image, part: Image, **more: Any) -> Pair:
        quiet = Noise(np.full(3, 1e-8), np.full(3, 1e-11))
        given: dict[str, Any] = {
            "unusable": np.zeros(no_flash.shape[:2], dtype=bool),
            "flash_only": False,
            "exposure_ratio": 1.0,
            "exposure_source": "option",
            "rendered": False,
            "tone_curve": None,
            "local_tone_mapping": None,
            "balance_change": None,
            "no_flash_noise": quiet,
            "flash_noise": quiet,
            "alignment": NOT_ATTEMPTED,
            "registration_px": 0.0,
            "parallax": 0.0,
            "moved": 0.0,
            "clipped": 0.0,
            "clipping": 1.0,
            "warnings": (),
        }
        before = np.asarray(no_flash, dtype=np.float32)
        given.update({"photograph": before, **more})
        added = np.asarray(part, dtype=np.float32)
        flash = added if given["flash_only"] else before + added
        return Pair(no_flash=before, flash=flash, **given)

    return build


@pytest.fixture(scope="session")
def flash_part(surfaces: Floats64) -> Image:
    """What the flash adds (64, 96, 3): patches of measured surfaces, brighter in the middle."""
    rng = np.random.default_rng(3)
    rows, columns = HEIGHT // PATCH, WIDTH // PATCH
    chosen = surfaces[rng.integers(0, len(surfaces), rows * columns)]
    patches = chosen.reshape(rows, columns, 3).repeat(PATCH, axis=0).repeat(PATCH, axis=1)
    v, u = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]
    shading = 0.7 - 0.6 * ((u - 0.5) ** 2 + (v - 0.5) ** 2)
    return np.asarray(patches * shading[..., None], dtype=np.float32)


@pytest.fixture(scope="session")
def shares_of() -> Callable[[int], Floats64]:
    """Light of 1 to 3 lamps relative to the flash, (N, 64, 96): places of one lamp, and mixed."""

    def build(count: int) -> Floats64:
        v, u = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]
        if count == 1:
            return np.asarray((0.3 + 0.5 * u)[None])
        third = np.clip(2 * v - 0.7, 0, 1) if count == 3 else np.zeros_like(u)
        ramps = [np.clip(1.2 - 1.7 * u, 0, 1), np.clip(1.7 * u - 0.5, 0, 1)]
        falloff = 0.9 - 0.6 * u  # so that the lamps together are not the flash over again
        stacked = np.stack([*(ramp * (1 - third) for ramp in ramps), third][:count])
        return np.asarray(falloff * stacked)

    return build


@pytest.fixture(scope="session")
def exact(
    model: Model,
    flash_part: Image,
    shares_of: Callable[[int], Floats64],
    pair_of: Callable[..., Pair],
) -> Callable[..., tuple[Pair, Floats64]]:
    """Make a pair that the model describes exactly, and its layers (N, 64, 96, 3)."""

    def build(coefficients: Floats64, **more: Any) -> tuple[Pair, Floats64]:
        matrices = model.lamp_matrix(np.atleast_2d(coefficients))
        z = shares_of(len(matrices))
        lit = np.einsum("nkl,hwl->nhwk", matrices, flash_part.astype(np.float64))
        layers = z[..., None] * lit
        return pair_of(layers.sum(axis=0), flash_part, **more), layers

    return build


@pytest.fixture(scope="session")
def shadowed(
    model: Model, flash_part: Image, pair_of: Callable[..., Pair]
) -> Callable[[Floats64], Pair]:
    """Make a pair that the model describes exactly, in which 1 to 4 lamps cast hard shadows."""

    def build(coefficients: Floats64) -> Pair:
        matrices = model.lamp_matrix(np.atleast_2d(coefficients))
        v, u = np.mgrid[:HEIGHT, :WIDTH] / np.array([HEIGHT, WIDTH])[:, None, None]
        falloff = np.array([0.9 - 0.5 * u, 0.4 + 0.5 * u, 0.4 + 0.4 * v, 0.8 - 0.4 * v])
        lit = np.ones_like(falloff)
        for j, one in enumerate(lit):
            one[(np.hypot(u - 0.3 - 0.11 * j, v - 0.5) < 0.22) | (u + (j - 1) * v < 0.15)] = 0.0
        z = (falloff * lit)[: len(matrices)]
        light = np.einsum("nhw,nkl,hwl->hwk", z, matrices, flash_part.astype(np.float64))
        return pair_of(light, flash_part)

    return build


@pytest.fixture(scope="session")
def fit_input(model: Model) -> Callable[..., FitInput]:
    """Gather what the lamps of a pair are fitted to."""

    def build(pair: Any, known: Known | None = None) -> FitInput:
        reduced = reduce_pair(pair)
        known = known or nothing_known(model.flash_white)
        return FitInput(reduced, gather_evidence(reduced), model, known)

    return build


@pytest.fixture(scope="module")
def light() -> tuple[Floats64, Floats64]:
    """What lamps and flash give (96, 128, 3): patches, lamps from the left, flash in the middle."""
    rng = np.random.default_rng(7)
    albedo = cv2.GaussianBlur(
        rng.uniform(0.05, 0.9, (12, 16, 3)).repeat(8, 0).repeat(8, 1), (0, 0), 0.6
    )
    v, u = np.mgrid[:96, :128] / np.array([96, 128])[:, None, None]
    lamps = albedo * (0.1 + 0.5 * (1 - u)[..., None]) * np.array([0.9, 0.7, 0.4])
    flash = albedo * (0.6 - 0.8 * ((u - 0.5) ** 2 + (v - 0.5) ** 2))[..., None]
    return lamps, flash


@pytest.fixture
def frames(
    light: tuple[Floats64, Floats64], frame: Callable[..., Frame]
) -> Callable[..., tuple[Frame, Frame]]:
    """Photographs without and with the flash; scaled, with noise, and with what else is given."""

    def build(scale: float = 1.0, **more: Any) -> tuple[Frame, Frame]:
        lamps, flash = light
        rng = np.random.default_rng(1)
        grain = rng.normal(0, 0.002, (2, *lamps.shape))
        given = {"exposure": Exposure(time_s=1 / 60, iso=200, f_number=4), **more}
        with_flash = scale * (lamps + flash) + grain[1]
        return frame(lamps + grain[0], **given), frame(with_flash, **given)

    return build


@pytest.fixture
def files(
    exact: Callable[..., tuple[Any, Floats64]], warm_to_cool: Floats64
) -> Callable[..., Files]:
    """The files of a pair with one to three lamps that the model describes exactly."""

    def build(count: int = 2, write: Callable[..., bytes] = tiff) -> Files:
        pair, _ = exact(warm_to_cool if count == 3 else warm_to_cool[[0, 2]][:count])
        return write(pair.no_flash), write(pair.flash)

    return build


@pytest.fixture
def shaped(camera: Camera) -> tuple[Files, dict[str, Any]]:
    """The files of a ball in three colours under three lamps, and options that name the lamps."""
    ball = make_ball(camera.sensitivities, size=40, materials=3)
    given = {
        "lights": 3,
        "light_directions": ball.lights("strength", "rgb"),
        "focal_px": ball.focal_px,
    }
    return (tiff(0.3 * ball.light), tiff(0.3 * (ball.light + ball.flash))), given
