"""The table of docs/decisions/0002-light-coordinates.md."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.hui2018.invariant import flash_tensor, light_coefficients
from pipeline.images.frames import Frame
from pipeline.spectra.bases import learn_basis
from pipeline.spectra.cameras import find_camera
from pipeline.spectra.lights import find_light, lamp_spectra, reflectance_spectra


def scatter_deg(s: Floats64, flash: Floats64, model: Floats64) -> list[float]:
    """Scatter in degrees of one lamp's invariant: median and 90 % quantile, medians over lamps."""
    rho, of_one = reflectance_spectra(), []
    under_flash = rho @ (s * flash).T
    for lamp in lamp_spectra():
        beta = light_coefficients(rho @ (s * lamp).T, under_flash, model)
        gamma = beta / np.linalg.norm(beta, axis=1, keepdims=True)
        middle = np.median(gamma, axis=0)
        angle = np.degrees(np.arccos(np.clip(gamma @ middle / np.linalg.norm(middle), -1, 1)))
        of_one.append((np.median(angle), np.quantile(angle, 0.9)))
    return [float(value) for value in np.median(of_one, axis=0)]


@pytest.mark.parametrize(
    ("kind", "projected", "fitted", "white_card"),
    [
        ("wpca", (2.14, 8.4), (2.15, 8.5), (1.41, 4.9)),
        ("pca", (22, 88), (35, 115), (6.4, 28)),
        ("joint", (6.0, 31), (5.9, 32), (1.40, 7.1)),
    ],
)
def test_white_card_coordinates_scatter_least(
    kind: str,
    projected: tuple[float, float],
    fitted: tuple[float, float],
    white_card: tuple[float, float],
) -> None:
    nothing = np.zeros((2, 2, 3), np.float32)
    frame = Frame(nothing, saturated=nothing[..., 0] > 0, encoding="linear", sha256="")
    s, flash = find_camera("Nikon D5100", frame).sensitivities, find_light("xenon")
    basis = learn_basis(kind, s, reflectance_spectra(), lamp_spectra())
    orthonormal = np.linalg.inv(basis.published).T @ basis.lights
    published = np.einsum("iw,kw,jw->kij", basis.reflectances, s, orthonormal)
    coefficients = basis.to_coefficients @ flash

    for tensor, lamp, expected in (
        (published, orthonormal @ flash, projected),
        (published, basis.published @ coefficients, fitted),
        (basis.tensor(s), coefficients, white_card),
    ):
        assert scatter_deg(s, flash, flash_tensor(tensor, lamp)) == pytest.approx(
            expected, rel=0.02
        )
