"""A reduced pair at the sizes at which a surface is fitted to it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.arrays import Floats, Floats64
from pipeline.images.frames import Mask
from pipeline.pair.reduced import ReducedPair
from pipeline.photometric_stereo.grid import make_grid
from pipeline.photometric_stereo.materials import Materials, find_materials
from pipeline.photometric_stereo.responses import ResponsePrior
from pipeline.photometric_stereo.scene import Scene

_MIN_OPEN = 0.5  # share of a block's pixels that must be usable
_MOST_GAIN = 5.0  # times the flash part that the lamps give
_RADIUS, _RADIUS_BY_NOISE = 0.008, 0.5  # of a material in chromaticity


@dataclass(frozen=True)
class View:
    """Means over step × step pixels of a reduced pair. All pictures (h, w, …)."""

    step: int
    focal: float
    centre: tuple[float, float]
    mask: Mask
    flash: Floats64
    light: Floats64
    flash_variance: Floats64
    light_variance: Floats64
    covariance: Floats64

    def scene(
        self, directions: Floats64, priors: tuple[ResponsePrior, ...], materials: Materials
    ) -> Scene:
        """The scene of its pixels. directions: (J, 3) unit, to the lamps; priors: of each."""
        grid = make_grid(self.mask, self.focal, self.centre)
        flash, light = self.flash[self.mask], self.light[self.mask]
        # light − gain · flash: an error of the flash part counts by the lamps' brightness beside it
        gain = np.clip(light / flash, 0, _MOST_GAIN)
        variance = self.light_variance[self.mask] + gain**2 * self.flash_variance[self.mask]
        variance -= 2 * gain * self.covariance[self.mask]
        return Scene(grid, directions, flash, light, variance, priors, materials)

    def materials(self) -> Materials:
        """The materials of its pixels."""
        flash = self.flash[self.mask]
        total = flash.sum(axis=1)
        noise = np.sqrt(self.flash_variance[self.mask].sum(axis=1)) / total
        radius = _RADIUS + _RADIUS_BY_NOISE * float(np.median(noise))
        return find_materials(flash[:, :2] / total[:, None], radius)


def make_view(reduced: ReducedPair, focal_px: float, most: int) -> View:
    """Average so that at most so many usable pixels are left."""
    step = int(np.ceil(np.sqrt(reduced.usable.sum() / most)))
    height, width = (side // step for side in reduced.usable.shape)
    crop = np.s_[: height * step, : width * step]
    usable = reduced.usable[crop].astype(np.float64)

    def means(picture: Floats) -> Floats64:
        return np.asarray(
            cv2.resize(picture.astype(np.float64), (width, height), interpolation=cv2.INTER_AREA)
        )

    share = means(usable)
    weight = np.maximum(share, 1e-9)[..., None]

    def of_usable(picture: Floats) -> Floats64:
        return means(picture[crop] * usable[..., None]) / weight

    x, y = reduced.middle
    return View(
        step=step,
        focal=focal_px / (reduced.block * step),
        centre=((x + 0.5) / step - 0.5, (y + 0.5) / step - 0.5),
        mask=share >= _MIN_OPEN,
        flash=of_usable(reduced.flash),
        light=of_usable(reduced.no_flash),
        # noise that was filtered hangs together
        flash_variance=of_usable(reduced.flash_variance) / step,
        light_variance=of_usable(reduced.no_flash_variance) / step,
        covariance=of_usable(reduced.covariance) / step,
    )
