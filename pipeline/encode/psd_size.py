"""What a Photoshop file holds; apart from its writer, whose libraries few runs need."""

from __future__ import annotations

from pipeline.errors import OptionError

_MOST_SIDE = 30_000
_LARGEST_BYTES = 2**31 - 2**20  # what readers take, less some room for the head
_PIXEL_BYTES = 6


def psd_excess(size: tuple[int, int], lamps: int) -> str | None:
    """Why layers.psd cannot hold so many layers of (width, height); None where it can."""
    width, height = size
    # the photograph itself comes beside the layers
    if max(size) <= _MOST_SIDE and width * height * _PIXEL_BYTES * (lamps + 1) <= _LARGEST_BYTES:
        return None
    layers = "a layer" if lamps == 1 else f"{lamps} layers"
    return (
        f"layers.psd cannot hold {layers} of {width} × {height} pixels, as the format ends at "
        "30,000 pixels a side and 2 GB"
    )


def check_psd_size(size: tuple[int, int], lamps: int) -> None:
    """Raise OptionError for more layers of (width, height) than the format holds."""
    excess = psd_excess(size, lamps)
    if excess is not None:
        raise OptionError(f"{excess}; leave it out of the outputs.")
