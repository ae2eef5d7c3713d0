"""White balance under mixed light: what is compared, all on the same files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from pipeline.arrays import Floats64
from pipeline.images.frames import Image
from pipeline.spectra.lights import find_light
from tests.evaluation.baselines.hsu2008 import mixture_balance
from tests.evaluation.baselines.hui2016 import pixel_kernels
from tests.evaluation.baselines.shades_of_grey import shades_of_grey
from tests.evaluation.product import run_product
from tests.evaluation.scenes import NEUTRAL
from tests.evaluation.shots import Shot
from tests.layers import picture

_SHADES = 6.0


def _hsu_2008(shot: Shot) -> Image:
    return mixture_balance(shot.photograph, shot.lamp_spectra @ shot.sensitivities.T, _white(shot))


def _hui_2016(shot: Shot) -> Image:
    flash = shot.pair.flash - shot.photograph
    white = shot.sensitivities @ shot.flash_spectrum
    return pixel_kernels(shot.photograph, flash, white / white[1], _white(shot))


def _product(shot: Shot, method: Literal["best", "paper"], approach: Literal[1, 2]) -> Image:
    _, planes = run_product(shot, "white_balanced.exr", method=method, neutral=NEUTRAL)
    return picture(planes, "" if approach == 1 else "any.")


def _white(shot: Shot) -> Floats64:
    """A white card's colour (3,) under the neutral light, green 1."""
    white = shot.sensitivities @ find_light(NEUTRAL)
    return np.asarray(white / white[1])


BALANCES: dict[str, Callable[[Shot], Image]] = {
    "uncorrected": lambda shot: shot.photograph,
    "grey_world": lambda shot: shades_of_grey(shot.photograph, _white(shot), 1.0),
    "shades_of_grey": lambda shot: shades_of_grey(shot.photograph, _white(shot), _SHADES),
    "hsu_2008": _hsu_2008,
    "hui_2016": _hui_2016,
    "paper_1": partial(_product, method="paper", approach=1),
    "paper_2": partial(_product, method="paper", approach=2),
    "best_1": partial(_product, method="best", approach=1),
    "best_2": partial(_product, method="best", approach=2),
}
"""In the order of the tables. hsu_2008 is for two lamps alone."""
