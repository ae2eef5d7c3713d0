"""A scene as a photographer would send it, with what only its rendering knows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from pipeline.arrays import Floats32, Floats64
from pipeline.decode import decode
from pipeline.images.frames import Image, Mask
from pipeline.images.sigma_filter import sigma_filter
from pipeline.options import Options
from pipeline.pair.pair import Pair, make_pair
from pipeline.pair.reduced import ReducedPair, reduce_pair
from pipeline.progress import Progress


@dataclass(frozen=True)
class Shot:
    """Files, what to say of them, and the truth.

    files: without the flash and with it. options: what the photographer knows, for Options.
    lights: the number of lamps to ask for. truth: (N, H, W, 3), each lamp's light on the scale of
    the file without the flash, 1.0 = its white. flash_part: (H, W, 3), the flash's light alone on
    the same scale, without noise and motion. valid: (H, W), the pixels that count.
    lamp_spectra (N, W), flash_spectrum (W,), sensitivities (3, W): those of the rendering.
    axes: (3, 3) camera RGB of a white card under a lamp → coordinates in which angles are stated.
    coefficients: (N, 3) of the lamps in them, None where the files hold other colours than the
    camera's.
    """

    files: tuple[bytes, bytes]
    options: dict[str, Any]
    lights: Literal["auto", 1, 2, 3]
    truth: Floats32
    flash_part: Image
    valid: Mask
    lamp_spectra: Floats64
    flash_spectrum: Floats64
    sensitivities: Floats64
    axes: Floats64
    coefficients: Floats64 | None

    @property
    def count(self) -> int:
        """The number of lamps that there are."""
        return len(self.truth)

    @cached_property
    def pair(self) -> Pair:
        """The pair as the pipeline lays it together."""
        options = Options(**self.options)
        before, after = (decode(file, options.encoding, "photograph") for file in self.files)
        return make_pair(before, after, options, Progress())

    @cached_property
    def reduced(self) -> ReducedPair:
        """The pair at the size at which lamps are estimated."""
        return reduce_pair(self.pair)

    @property
    def photograph(self) -> Image:
        """The photograph without the flash, (H, W, 3)."""
        return self.pair.no_flash[:]

    @property
    def usable(self) -> Mask:
        """Pixels that have a counterpart and are not clipped, as far as the pipeline knows."""
        return ~self.pair.unusable

    @cached_property
    def filtered(self) -> tuple[Image, Image]:
        """The photograph without the flash, and the flash part, with their noise filtered."""
        pair = self.pair
        no_flash, flash, _ = sigma_filter(
            (pair.no_flash[:], pair.flash[:]), (pair.no_flash_noise, pair.flash_noise)
        )
        return no_flash, flash if pair.flash_only else flash - no_flash
