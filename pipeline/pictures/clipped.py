"""What pictures show of clipped light, whose colour is not told: that of its lamp; compiled.

A channel that is clipped was brighter than its value. Gains of a sensor's channels make a blown-out
window pink, and the layers' own proportions leave it so.
"""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Floats32
from pipeline.compiling import compiled, inlined
from pipeline.images.frames import Colour, Matrix, Numbers, channels_first, numbers_of

_CLIPPING = (0.9, 0.99)  # of white, between which a channel comes to count as clipped
_COLOURED = (0.5, 0.8)  # of what is clipped, below which the third channel tells a colour


def shown_layers(layers: Floats32, whites: Matrix, clipping: float) -> Floats32:
    """Layers (N, h, W, 3) as they are shown: clipped light has the colour of its lamp.

    It is as bright as the channel says that is the brightest under that lamp, since none was less.
    What a third channel, unclipped, tells to be coloured stays so; one channel that alone is
    clipped becomes no less than the next one. The result is the layers themselves where no pixel
    is clipped, else a copy by planes.

    layers: linear camera RGB, their sum the photograph. whites: (N, 3), each lamp's light on a
    white card, no channel 0. clipping: the value at which the photograph is clipped, infinite where
    it is not (Pair.clipping).
    """
    if not np.isfinite(clipping) or layers.sum(axis=0).max(initial=0.0) < _CLIPPING[0] * clipping:
        return layers
    shown = channels_first(layers).copy()
    _show(shown, tuple(numbers_of(white) for white in whites), 1.0 / clipping)
    return np.moveaxis(shown, 1, -1)


@compiled
def _show(layers: Floats32, whites: tuple[Numbers, ...], of_clipping: float) -> None:
    """Write over layers (N, 3, h, W) what shown_layers makes of them."""
    zero, one = np.float32(0.0), np.float32(1.0)
    lamps, _, rows, width = layers.shape
    least = np.float32(_CLIPPING[0])
    for y in range(rows):
        for x in range(width):
            red = green = blue = zero
            for j in range(lamps):
                red += layers[j, 0, y, x]
                green += layers[j, 1, y, x]
                blue += layers[j, 2, y, x]
            scale = np.float32(of_clipping)
            light = red * scale, green * scale, blue * scale
            if max(light[0], max(light[1], light[2])) <= least:
                continue
            for j in range(lamps):
                w = whites[j]
                w0, w1, w2 = np.float32(w[0]), np.float32(w[1]), np.float32(w[2])
                p0, p1, p2 = (
                    layers[j, 0, y, x] / w0,
                    layers[j, 1, y, x] / w1,
                    layers[j, 2, y, x] / w2,
                )
                p0, p1, p2 = no_rim(light, (p0, p1, p2))
                share = whitening(light, (p0, p1, p2))
                white = share * max(p0, max(p1, p2))
                layers[j, 0, y, x] = w0 * ((one - share) * p0 + white)
                layers[j, 1, y, x] = w1 * ((one - share) * p1 + white)
                layers[j, 2, y, x] = w2 * ((one - share) * p2 + white)


@inlined
def no_rim(light: Colour, seen: Colour) -> Colour:
    """A colour in which a channel that is clipped is no less than the next one.

    light: of the photograph, 1 = clipped. seen: of the light in question, a white card's all equal.
    """
    zero = np.float32(0.0)
    red, green, blue = light
    p0, p1, p2 = seen
    return (
        p0 + clipped(red) * max(min(p1, p2) - p0, zero),
        p1 + clipped(green) * max(min(p0, p2) - p1, zero),
        p2 + clipped(blue) * max(min(p0, p1) - p2, zero),
    )


@inlined
def whitening(light: Colour, seen: Colour) -> np.float32:
    """How far light has lost its colour, 0…1: two channels are clipped, and the third tells none.

    It tells a colour where it is far below the two, both as it is, since the lamp may be another
    one's, and of what the lamp's white has. light, seen: as of no_rim.
    """
    zero = np.float32(0.0)
    red, green, blue = light
    p0, p1, p2 = seen
    third = min(red, min(green, blue))
    second = max(min(red, green), min(max(red, green), blue))
    own, others = p2, min(p0, p1)
    if green == third:
        own, others = p1, min(p0, p2)
    if red == third:
        own, others = p0, min(p1, p2)
    share = own / others if others > zero else zero
    return clipped(second) * max(_colourless(third), _colourless(share))


@inlined
def clipped(light: np.float32) -> np.float32:
    """How far a channel counts as clipped, 0…1; light: 1 = clipped."""
    return _between(light, _CLIPPING[0], _CLIPPING[1])


@inlined
def _colourless(light: np.float32) -> np.float32:
    return _between(light, _COLOURED[0], _COLOURED[1])


@inlined
def _between(value: np.float32, low: float, high: float) -> np.float32:
    """0 up to low, 1 from high on."""
    scale = np.float32(1.0 / (high - low))
    return min(max((value - np.float32(low)) * scale, np.float32(0.0)), np.float32(1.0))
