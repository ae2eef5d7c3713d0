"""How much light of each lamp reaches each pixel, wavelength by wavelength."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats32, Floats64
from pipeline.images.frames import Image
from pipeline.spectra.wavelengths import WAVELENGTHS_NM

BANDS_NM: Floats64 = np.linspace(390.0, 730.0, 18)
"""Centres of the bands of BandTransport; between them transport is taken as linear."""


@dataclass(frozen=True)
class DirectTransport:
    """Direct light, exact at every wavelength, whatever the palette.

    On surfaces lit by lamps alone the light seen is diffuse·reflectance + gloss. All arrays are
    of sub-pixels, `factor` per side of a pixel. diffuse, gloss: float32 (L, h, w) of the L lamps,
    gloss None where all is matte. first, second, share: (h, w), the mixture of two reflectances of
    the palette, as in Texels.
    """

    diffuse: Floats32
    gloss: Floats32 | None
    first: NDArray[np.int16]
    second: NDArray[np.int16]
    share: Floats32
    factor: int

    def picture(self, lamp: int, response: Floats64, palette: Floats64) -> Image:
        """Light of one lamp, float32 (H, W, C).

        response: (W, C), sensitivities × the lamp's spectrum. palette: (m, W) reflectances.
        """
        colours = (palette @ response).astype(np.float32)
        share = self.share[..., None]
        light: Image = (1 - share) * colours[self.first] + share * colours[self.second]
        light *= self.diffuse[lamp][..., None]
        if self.gloss is not None:
            light += self.gloss[lamp][..., None] * response.sum(0).astype(np.float32)
        height, width = self.first.shape
        blocks = light.reshape(height // self.factor, self.factor, width // self.factor, -1)
        wide = blocks.sum(axis=1).reshape(*blocks.shape[::2], self.factor, response.shape[1])
        return np.asarray(wide.mean(axis=2) / self.factor, np.float32)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a file needs to hold. Half floats err by 0.03 %, the same at each wavelength."""
        out: dict[str, NDArray[Any]] = {
            "diffuse": self.diffuse.astype(np.float16),
            "first": self.first,
            "second": self.second,
            "share": self.share.astype(np.float16),
            "factor": np.array(self.factor),
        }
        if self.gloss is not None:
            out["gloss"] = self.gloss.astype(np.float16)
        return out


@dataclass(frozen=True)
class BandTransport:
    """Light by any number of bounces, for the palette it was rendered with.

    bands: float32 (L, B, H, W), what a lamp of unit power at each of BANDS_NM gives.
    """

    bands: Floats32

    def picture(self, lamp: int, response: Floats64, palette: Floats64) -> Image:  # noqa: ARG002
        """Light of one lamp, float32 (H, W, 3). response: (W, 3), sensitivities × spectrum."""
        to_bands = np.array([np.interp(WAVELENGTHS_NM, BANDS_NM, e) for e in np.eye(len(BANDS_NM))])
        weights = (to_bands @ response).astype(np.float32)
        return np.ascontiguousarray(np.einsum("bhw,bk->hwk", self.bands[lamp], weights))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What a file needs to hold."""
        return {"bands": self.bands.astype(np.float16)}


Transport = DirectTransport | BandTransport


def from_arrays(arrays: dict[str, NDArray[Any]]) -> Transport:
    """Build the transport again from its arrays()."""
    if "bands" in arrays:
        return BandTransport(arrays["bands"].astype(np.float32))
    return DirectTransport(
        diffuse=arrays["diffuse"].astype(np.float32),
        gloss=arrays["gloss"].astype(np.float32) if "gloss" in arrays else None,
        first=arrays["first"],
        second=arrays["second"],
        share=arrays["share"].astype(np.float32),
        factor=int(arrays["factor"]),
    )
