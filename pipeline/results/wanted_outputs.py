"""Which outputs a run is to write, and refusals of those that it cannot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.encode.jpeg import check_jpeg_size
from pipeline.encode.psd_size import check_psd_size, psd_excess
from pipeline.errors import OptionError
from pipeline.hui2018.normals import inverse_directions
from pipeline.images.frames import Photograph
from pipeline.images.quantiles import quantile
from pipeline.matrixfit.fit import MOST_LAMPS
from pipeline.options import NO_SETUP, LampCount, Options
from pipeline.output_names import DEFAULT_OUTPUTS, FULL_SIZE_JPEGS, OUTPUT_NAMES, outputs_with
from pipeline.photometric_stereo.directions import unit_directions
from pipeline.result_names import LAYERS
from pipeline.run_warnings import Code, RunWarning

_PSD = "layers.psd"
_OF_INTEGERS = {"lamps.tif", "white_balanced_1.tif", "white_balanced_2.tif", _PSD}
"""Outputs on the photograph's scale that end at white."""
_NOTABLE, _BRIGHTEST = 0.01, 0.995  # share of the picture; quantile
_SAMPLES = 1000  # pixels looked at along the longer side, or twice as many


def wanted_outputs(options: Options) -> frozenset[str]:
    """Names out of OUTPUT_NAMES that the options ask for."""
    if options.outputs == "all":
        return frozenset(OUTPUT_NAMES)
    if options.outputs == "default":
        return DEFAULT_OUTPUTS
    return frozenset(options.outputs)


def check_directions(options: Options, left_out: Sequence[RunWarning] = ()) -> None:
    """Refuse light directions that fix no normals, where a wanted output needs them.

    And where none are known, an output that needs them and is asked for by name. left_out: why
    kept calibrations do not stand in, which the refusal repeats. Raises OptionError.
    """
    lights, facing = options.light_directions, wanted_outputs(options) & outputs_with("facing")
    if not facing:
        return
    if lights is not None:
        check = inverse_directions if options.method == "paper" else unit_directions
        check(lights)
    elif isinstance(options.outputs, list):
        setup = "a set-up" if options.setup == NO_SETUP else f"the set-up {options.setup!r}"
        raise OptionError(
            f"The output {min(facing)} needs the lamps' directions: give light directions, or "
            f"calibrate the lamps of this camera for {setup} with photographs of this kind and way "
            "up first." + "".join(f" {warning.message}" for warning in left_out)
        )


def check_outputs(wanted: frozenset[str], size: tuple[int, int], options: Options) -> None:
    """Refuse outputs that cannot hold a picture, (width, height) in pixels, before any work.

    wanted: names out of OUTPUT_NAMES, of these options. Of layers.psd as many layers count as
    lamps are asked for, and as there may be where their number is to be found. Raises OptionError.
    """
    if wanted & FULL_SIZE_JPEGS:
        check_jpeg_size(size)
    if _PSD in wanted and options.outputs != "all":
        _check_psd(size, options.number_of_lamps)


def held_outputs(
    wanted: frozenset[str], size: tuple[int, int], lamps: int, options: Options
) -> tuple[frozenset[str], list[RunWarning]]:
    """Leave layers.psd out where all outputs are wanted and it cannot hold so many layers.

    wanted, size: as in check_outputs, which has refused it where it was asked for by name. lamps:
    how many were found. Returns the outputs that are left, and a warning where one is not.
    """
    excess = psd_excess(size, lamps)
    if _PSD not in wanted or options.outputs != "all" or excess is None:
        return wanted, []
    message = f"{excess}, and was left out: the layers are in layers.exr and the TIFF files."
    return wanted - {_PSD}, [RunWarning(Code.OUTPUT_LEFT_OUT, message)]


def white_warnings(
    photograph: Photograph, clipping: float, wanted: frozenset[str]
) -> list[RunWarning]:
    """Tell that much of a photograph (H, W, 3) lies above where some of the wanted files end.

    clipping: the value at which it is clipped, infinite where it is not (Pair.clipping).
    """
    if np.isfinite(clipping) or not wanted & _OF_INTEGERS:
        return []
    step = max(1, max(photograph.shape[:2]) // _SAMPLES)
    brightest = photograph[::step, ::step].max(axis=2)
    share = float(np.mean(brightest > 1.0))
    if share < _NOTABLE:
        return []
    most = quantile(brightest, _BRIGHTEST)
    asked = "" if LAYERS in wanted else ", which was not asked for,"
    message = (
        f"In {share:.0%} of the picture the photograph without the flash is brighter than white "
        f"(1.0), where TIFF and PSD files end; {LAYERS}{asked} holds all of it. To have it in "
        f"every file, divide both photographs by {most:.3g} first."
    )
    return [RunWarning(Code.ABOVE_WHITE, message, {"share": share, "brightest": most})]


def _check_psd(size: tuple[int, int], lamps: LampCount) -> None:
    if lamps != "auto":
        check_psd_size(size, lamps)
        return
    check_psd_size(size, 1)
    excess = psd_excess(size, MOST_LAMPS)
    if excess is not None:
        fewer = "2 or 1" if psd_excess(size, 2) is None else "1"
        raise OptionError(
            f"{excess}, and as many may be found: ask for {fewer}, or leave it out of the outputs."
        )
