"""Names of the results that others are made from, and of what is in them."""

LAYERS = "layers.exr"
MANIFEST = "manifest.json"
"""Written last, so that only a finished run has one."""


def lamp_name(lamp: int) -> str:
    """What a lamp, counted from 0, is called in names of files and channels, and in messages."""
    return f"lamp{lamp + 1}"


def layer_channels(count: int) -> list[str]:
    """Names of the channels of so many lamps in LAYERS, three of each lamp."""
    return [f"{lamp_name(lamp)}.{letter}" for lamp in range(count) for letter in "RGB"]
