"""What makes the layers of a pair doubtful, told from the pair and its lamps."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from pipeline.arrays import Floats64
from pipeline.hui2018.separation import published_layers
from pipeline.images.frames import Mask
from pipeline.lamps.lamps import LEAST_CONTRAST, Lamps
from pipeline.lamps.light_in_shadows import light_in_shadows
from pipeline.light.model import Model
from pipeline.matrixfit.fit import MOST_LAMPS
from pipeline.options import Method
from pipeline.pair.flash_reach import flash_reach
from pipeline.pair.pair import Pair
from pipeline.pair.reduced import ReducedPair
from pipeline.pictures.residual_map import MARKED, relative_residual
from pipeline.result_names import lamp_name
from pipeline.run_warnings import Code, RunWarning
from pipeline.separation.possible import off_possible
from pipeline.separation.pure_light import without_pure_light

# Chosen on development scenes (docs/trials/warnings.md)
_UNSURE = 0.6  # confidence in the number of lamps
_RIVAL_DEGREES = 5.0
_MUCH_WEAK = 0.1  # share of what the lamps light
_MUCH_CLIPPED = 0.05  # share of the picture
_MUCH_MARKED = 0.015  # the same
_MUCH_IN_SHADOWS = 3.0  # times what lamps are mixed up by
_SHARP = 250  # blocks along the longer side; in smaller pairs neighbours lie in a shadow's rim
_MUCH_IMPOSSIBLE = 0.1  # of the light, root mean square: such layers have less than 20 dB
_BLUE = 0.4  # red over blue of the flash's light in a rendering; in balanced ones .5 to 1.4
_LAYERS_WITHOUT_LIGHT: dict[Method, str] = {
    "best": "are filled in from their surroundings",
    "paper": "are as published and cannot be relied on",
}
_LEAST_ERROR, _ERROR_OF_LAMPS, _NOISE_COUNTS, _WORST_DB = 0.045, 0.01, 0.5, 4.0  # expected_snr_db


def doubts(
    pair: Pair, reduced: ReducedPair, lamps: Lamps, method: Method, wanted: frozenset[str]
) -> list[RunWarning]:
    """Warnings of the flash, the lamps and the light; none where layers can be relied on.

    method: which found the lamps; only fitted ones tell where one is alone, and only their layers
    are filled in. wanted: names of outputs (pipeline.output_names), whose files sentences name.
    """
    hidden, in_shadows = [], np.zeros(len(lamps))
    if method == "best":
        hidden = without_pure_light(reduced, lamps)
        # one lamp passes for no other, and a rendering's curve bends the light of shadows most
        sharp = max(reduced.usable.shape) >= _SHARP
        if len(lamps) > 1 and sharp and not reduced.rendered:
            in_shadows = light_in_shadows(reduced, lamps)
    where = "residual.png shows where"
    if "residual.png" not in wanted:
        where = "the output residual.png, which was not asked for, shows where"
    return [
        *_of_photographs(pair, reduced, method),
        *_of_lamps(reduced, lamps, hidden, in_shadows, where),
    ]


def doubts_of_published(reduced: ReducedPair, lamps: Lamps, model: Model) -> list[RunWarning]:
    """Warn of layers of the method "paper" that no lamps can have made.

    Layers of equation 3 may be negative and need not add up to the photograph. The true ones are
    not so: how far those are from all that are ≥ 0 and add up is the least that they can be wrong.
    """
    use = reduced.usable
    light, flash = reduced.no_flash[use][None], reduced.flash[use][None]
    layers = published_layers(light, flash, lamps.coefficients, model.tensor, model.published)
    off, whole = off_possible(light, layers), np.linalg.norm(light, axis=-1)
    every = float(np.linalg.norm(off) / np.linalg.norm(whole))
    if every <= _MUCH_IMPOSSIBLE:
        return []
    share = float(np.mean(off > MARKED * whole))
    message = (
        f"The layers as published cannot be right: in {share:.1%} of the picture they are negative "
        f"or do not add up to the photograph, and all in all miss it by {every:.0%} of its light, "
        "root mean square. The method best has no such layers."
    )
    return [RunWarning(Code.LAYERS_IMPOSSIBLE, message, {"share": share, "off": every})]


def expected_snr_db(angle_deg: float, noise: float) -> float:
    """Joint SNR in dB that layers of two lamps reach at an angle between their colours.

    noise: relative, as relative_noise. The lamps' own errors and noise both grow with 1/sin of the
    angle; what the model misses does not. Lamps that cannot be told apart at all still share out
    the photograph. Fitted on development scenes.
    """
    squared = _mixed_up(angle_deg, noise) ** 2 + _LEAST_ERROR**2
    return max(float(-10.0 * np.log10(squared)), _WORST_DB)


def _mixed_up(angle_deg: float, noise: float) -> float:
    """How much of a lamp's light is likely to be taken for the other's."""
    contrast = max(float(np.sin(np.radians(angle_deg))), LEAST_CONTRAST)
    return float(np.hypot(_ERROR_OF_LAMPS, _NOISE_COUNTS * noise) / contrast)


def relative_noise(reduced: ReducedPair) -> float:
    """Noise of flash part and no-flash light against themselves, both together, median."""
    use = reduced.usable
    squared = [
        variance[use].sum(axis=1) / np.square(light[use].sum(axis=1))
        for light, variance in (
            (reduced.no_flash, reduced.no_flash_variance),
            (reduced.flash, reduced.flash_variance),
        )
    ]
    return float(np.sqrt(np.median(squared[0] + squared[1])))


def _of_photographs(pair: Pair, reduced: ReducedPair, method: Method) -> Iterator[RunWarning]:
    reach = flash_reach(pair, reduced)
    layers = _LAYERS_WITHOUT_LIGHT[method]
    if reach.weak > _MUCH_WEAK:
        message = (
            f"The flash is too weak in {reach.weak:.0%} of what the lamps light, where the layers "
            f"{layers}; {1 - reach.weak:.0%} can be separated. Make the flash at "
            f"least {reach.stops:.1f} stops stronger: raise its power or bring it nearer; a wider "
            "aperture with a shorter exposure helps, too."
        )
        figures = {"share": reach.weak, "usable_share": 1 - reach.weak, "stops": reach.stops}
        yield RunWarning(Code.FLASH_TOO_WEAK, message, figures)
    if pair.clipped > _MUCH_CLIPPED:
        message = (
            f"A photograph is clipped in {pair.clipped:.0%} of the picture, where the layers "
            f"{layers}: expose both shorter."
        )
        yield RunWarning(Code.CLIPPED, message, {"share": pair.clipped})
    if reduced.rendered:
        yield from _of_balance(reduced)


def _of_balance(reduced: ReducedPair) -> Iterator[RunWarning]:
    """Warn of a rendering balanced for warm lamps, in which the flash is blue and its red lost."""
    red, _, blue = np.maximum(reduced.flash[reduced.usable], 0.0).mean(axis=0, dtype=np.float64)
    if red >= _BLUE * blue:
        return
    message = (
        f"The flash's light is blue in the photographs, with {red / blue:.2f} times as much red as "
        "blue: their white balance is for warm lamps, unless nearly all that the flash lights is "
        "blue. White-balanced pictures keep that cast, and layers are the worse the less red there "
        "is. Set the white balance of both to flash or daylight, or send RAW files."
    )
    yield RunWarning(Code.FLASH_BLUE, message, {"red_over_blue": red / blue})


def _of_lamps(
    reduced: ReducedPair,
    lamps: Lamps,
    hidden: list[int],
    in_shadows: Floats64,
    where: str,
) -> Iterator[RunWarning]:
    """where: says what shows the places that the lamps do not explain."""
    if lamps.four_or_more:
        message = (
            "Three lamps do not explain the light at all shadow edges: there may be four or more, "
            "which three colour channels cannot tell apart. Switch some off, or photograph them "
            "in groups."
        )
        yield RunWarning(Code.FOUR_OR_MORE, message)
    elif lamps.unexplained:
        number = "One lamp does" if len(lamps) == 1 else f"{len(lamps)} lamps do"
        advice = "Ask for more lamps, or check" if len(lamps) < MOST_LAMPS else "Check"
        message = (
            f"{number} not explain the photograph: {lamps.left_over:.0%} of the light is left over "
            f"in a tenth of it. {advice} camera and flash spectrum; {where}."
        )
        yield RunWarning(Code.UNEXPLAINED, message, {"left_over": lamps.left_over})
    else:
        yield from _of_reflections(reduced, lamps, in_shadows, where)
    yield from lamps.contradictions
    yield from _of_likeness(reduced, lamps)
    yield from _of_rivals(lamps)
    yield from _of_hidden(hidden)
    yield from _of_number(lamps)


def _of_rivals(lamps: Lamps) -> Iterator[RunWarning]:
    if lamps.rival_deg <= _RIVAL_DEGREES:
        return
    message = (
        f"Another search came to lamps that are up to {lamps.rival_deg:.0f}° in colour from "
        "those found, so the layers may be wrong. Check camera, encoding and flash spectrum; "
        "if they are right, pin a lamp by a place that it lights alone."
    )
    yield RunWarning(Code.LAMPS_AMBIGUOUS, message, {"angle_deg": lamps.rival_deg})


def _of_hidden(hidden: list[int]) -> Iterator[RunWarning]:
    if not hidden:
        return
    by = " alone or by ".join(lamp_name(index) for index in hidden)
    message = (
        f"No place in the picture is lit by {by} alone, and neither the edge of a shadow nor a "
        "round thing that turns away from it tells such a lamp's colour, so how bright its "
        "layer is, is a guess. Show some place that the other lamps do not reach, such as the "
        "shadow of a thing put into the picture."
    )
    yield RunWarning(Code.NO_PURE_LIGHT, message, {"lamps": len(hidden)})


def _of_number(lamps: Lamps) -> Iterator[RunWarning]:
    if lamps.confidence >= _UNSURE:
        return
    message = (
        f"It is not certain that the number of lamps is {len(lamps)}; if you know it, ask for "
        "it. A stronger flash and a hard shadow of each lamp make it plainer."
    )
    yield RunWarning(Code.NUMBER_UNCERTAIN, message, {"confidence": lamps.confidence})


def _of_reflections(
    reduced: ReducedPair, lamps: Lamps, in_shadows: Floats64, where: str
) -> Iterator[RunWarning]:
    marked = relative_residual(reduced, lamps) > MARKED
    share = float(np.mean(_spots(marked)[reduced.usable]))
    if share > _MUCH_MARKED:
        message = (
            f"In {share:.1%} of the picture the lamps leave more than {MARKED:.0%} of the light "
            "unexplained: shiny things mirror it, or it has met another surface before. Layers are "
            f"approximate there; {where}. Turn shiny things away from the lamps, and check camera "
            "and flash spectrum if it is all over the picture."
        )
        if lamps.requested == "auto" and len(lamps) < MOST_LAMPS:
            message += f" A weak lamp more looks alike: ask for {len(lamps) + 1} lamps to see."
        yield RunWarning(Code.REFLECTIONS, message, {"share": share})
        return
    lamp = int(in_shadows.argmax())
    mixed_up = _mixed_up(lamps.least_angle_deg, relative_noise(reduced))
    if in_shadows[lamp] > _MUCH_IN_SHADOWS * mixed_up:
        message = (
            f"In the shadows of {lamp_name(lamp)} there is {in_shadows[lamp]:.0%} of its light: it "
            "comes by way of walls and things, in their colours, and passes for light of other "
            "lamps; or the lamp is so large that its shadows are hardly anywhere whole. Layers are "
            "approximate where it falls. Keep lamps away from walls and large coloured things, or "
            "hang something dark before these."
        )
        figures = {"in_shadows": float(in_shadows[lamp])}
        yield RunWarning(Code.REFLECTIONS, message, figures)


def _spots(marked: Mask) -> Mask:
    """Marked blocks (h, w) in squares of 2 × 2 of them: lines are the demosaicing's."""
    square, outside = np.ones((2, 2), np.uint8), cv2.BORDER_CONSTANT
    whole = cv2.erode(marked.astype(np.uint8), square, borderType=outside, borderValue=0)
    return np.asarray(cv2.dilate(whole, square, anchor=(0, 0)) > 0)  # as erosion's anchor is last


def _of_likeness(reduced: ReducedPair, lamps: Lamps) -> Iterator[RunWarning]:
    if not lamps.alike:
        return
    snr = expected_snr_db(lamps.least_angle_deg, relative_noise(reduced))
    message = (
        f"Two lamps are only {lamps.least_angle_deg:.1f}° apart in colour, so their layers hold "
        f"each other's light: expect a signal-to-noise ratio of about {snr:.0f} dB. If they are "
        f"one lamp, ask for {len(lamps) - 1}; if not, a coloured filter on one of them helps."
    )
    yield RunWarning(
        Code.LAMPS_ALIKE, message, {"angle_deg": lamps.least_angle_deg, "expected_snr_db": snr}
    )
