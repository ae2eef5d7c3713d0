"""Whether two photographs are a pair that can be separated at all; refusals with what to do."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.colour.curves import linear_to_srgb
from pipeline.decode import read_alike, read_header
from pipeline.errors import PairMismatchError, SwappedPairError, UnusablePairError
from pipeline.images.frames import Frame, Image, Mask, Photograph
from pipeline.images.noise import Noise
from pipeline.images.quantiles import quantile
from pipeline.images.strips import STRIP_ROWS, strips

NO_FLASH, FLASH = "photograph without the flash", "photograph with the flash"
"""What messages call the two files."""

_IDENTICAL = "The two photographs are identical: send one without the flash and one with it."
_BLACK = 2e-4  # of the white level; an 8-bit sRGB code of 1 is 3e-4
_MIN_USABLE = 0.02  # share of the pixels that the flash must reach
_ALIKE = (2.5 / 65535, 2.5 / 255)  # code values of 16 bits linear and of 8 bits rendered
_DARKER = 0.6  # share of lit pixels that lose light with the flash on: the frames are swapped
_DARKER_ALONE = 0.05  # the same where hardly any gain light; a flash need not reach everything
_SMALLEST = 32  # pixels, of the shorter side
_MOST_RATIO = 100  # times the shorter side, into which blocks must fit; no photograph is longer
_SAMPLES, _LEAST_STEP = 200_000, 4  # pixels looked at, and the step between them at least
_FEW_ROWS = 16  # of these, of which the first is looked at for colour


def check_pair(no_flash: bytes, flash: bytes) -> int:
    """Refuse, from the headers alone, files that can never be separated. Raises InputError.

    Returns the EXIF orientation, 1–8, by which to decode the flash photograph.
    """
    before = read_header(no_flash, NO_FLASH)
    after = read_alike(before, read_header(flash, FLASH))
    check_sizes(before.size, after.size)
    if before.place != after.place:
        raise PairMismatchError(
            f"The photographs are EXRs whose data windows lie at different places, {before.place} "
            f"without the flash and {after.place} with it: save both with the whole picture as "
            "data window."
        )
    if no_flash == flash:
        raise UnusablePairError(_IDENTICAL)
    return after.orientation


def check_sizes(no_flash: tuple[int, int], flash: tuple[int, int]) -> None:
    """Check two (width, height) in pixels.

    Raises PairMismatchError if unequal, UnusablePairError below 32 pixels to a side or where the
    longer side is more than 100 times the shorter one.
    """
    if no_flash != flash:
        (w1, h1), (w2, h2) = no_flash, flash
        raise PairMismatchError(
            f"The photographs have different sizes, {w1} × {h1} without the flash and {w2} × {h2} "
            "with it: send both as the camera made them, uncropped."
        )
    if min(no_flash) < _SMALLEST:
        width, height = no_flash
        raise UnusablePairError(
            f"The photographs have only {width} × {height} pixels: send them in full size."
        )
    if max(no_flash) > _MOST_RATIO * min(no_flash):
        width, height = no_flash
        raise UnusablePairError(
            f"The photographs have {width} × {height} pixels, one side more than {_MOST_RATIO} "
            "times the other: send them as the camera made them, uncropped."
        )


def check_belonging(no_flash: Frame, flash: Frame, flash_only: bool) -> None:
    """Check sizes, encodings and cameras, and that the flash fired in the right photograph.

    flash_only: the second is the flash part alone, which may have been computed from RAW files and
    written as linear values without a profile.
    Raises PairMismatchError, UnusablePairError, SwappedPairError.
    """
    check_sizes(no_flash.size, flash.size)
    encodings = {no_flash.encoding, flash.encoding}
    profiled = no_flash.profiled or flash.profiled
    mixed = len(encodings) > 1 or no_flash.profiled != flash.profiled
    if mixed and not (flash_only and encodings == {"raw", "linear"} and not profiled):
        raise PairMismatchError(
            f"The photograph without the flash holds {_words(no_flash)}, the one with it "
            f"{_words(flash)}: send two files with values of one kind."
        )
    cameras = [_camera(frame) for frame in (no_flash, flash)]
    if None not in cameras and cameras[0] != cameras[1]:
        raise PairMismatchError(
            f"The photograph without the flash is of a {no_flash.make} {no_flash.model}, the one "
            f"with it of a {flash.make} {flash.model}: send two files of one camera."
        )
    if no_flash.sha256 == flash.sha256 or _equal(no_flash.pixels, flash.pixels):
        raise UnusablePairError(_IDENTICAL)
    if no_flash.flash_fired and flash.flash_fired is False:
        raise SwappedPairError(
            "The flash fired in the photograph that should be without it: swap the two."
        )


def _equal(first: Photograph, second: Photograph) -> bool:
    """Whether all values are the same; two photographs differ in their first rows."""
    return all(np.array_equal(first[rows], second[rows]) for rows in strips(len(first), STRIP_ROWS))


def _camera(frame: Frame) -> tuple[str, str] | None:
    """Make and model, however they are spelt; None where not both are known."""
    make, model = frame.make.strip().casefold(), frame.model.strip().casefold()
    return (make, model) if make and model else None


def _words(frame: Frame) -> str:
    if frame.profiled:
        return "linear values of a colour profile"
    return {"raw": "sensor values", "linear": "linear values", "srgb": "sRGB values"}[
        frame.encoding
    ]


def check_light(no_flash: Frame, flash: Frame) -> None:
    """Raise UnusablePairError where one of the photographs is black."""
    for frame, name in ((no_flash, NO_FLASH), (flash, FLASH)):
        if quantile(_sampled(frame.pixels).max(axis=2), 0.99) < _BLACK:
            raise UnusablePairError(
                f"The {name} is black: expose it longer or raise the ISO speed."
            )


def check_colours(no_flash: Frame, flash: Frame) -> None:
    """Raise UnusablePairError where both photographs are grey, saved in colour though they are."""
    if is_grey(no_flash) and is_grey(flash):
        raise UnusablePairError(
            "The two photographs are grey, but lamps are told apart by their colours: send colour "
            "photographs."
        )


def is_grey(frame: Frame) -> bool:
    """Whether the channels agree within two code values wherever a file's pixels are not clipped.

    Sensor values never do. False where all are clipped, which is told as that.
    """
    if frame.encoding == "raw" or _sampled(frame.saturated).all():
        return False
    rendered = frame.encoding == "srgb"

    def agree(pixels: Image, saturated: Mask) -> bool:
        codes = linear_to_srgb(pixels) if rendered else pixels
        apart = codes.max(axis=2) - codes.min(axis=2)
        return bool((apart[~saturated] <= _ALIKE[rendered]).all())

    few = slice(None, None, _FEW_ROWS)  # tell coloured photographs at once
    return agree(_sampled(frame.pixels)[few], _sampled(frame.saturated)[few]) and all(
        agree(frame.pixels[rows], frame.saturated[rows])
        for rows in strips(len(frame.pixels), STRIP_ROWS)
    )


def check_flash_adds(
    no_flash: Photograph,
    flash: Photograph,
    unusable: Mask,
    noises: tuple[Noise, Noise],
    given_ratio: float | None = None,
) -> None:
    """Raise UnusablePairError where the flash part is missing, or all is clipped.

    SwappedPairError where it is negative.

    no_flash, flash: (H, W, 3) on one scale. given_ratio: of the exposures that made it so, None
    where nobody gave one. What is left to use is told later.
    """
    before, after = _sampled(no_flash), _sampled(flash)
    part = after.sum(axis=2) - before.sum(axis=2)
    noise = np.sqrt(noises[0].variance(before).sum(axis=2) + noises[1].variance(after).sum(axis=2))
    open_ = ~_sampled(unusable)
    if not open_.any():
        raise UnusablePairError(
            "Every pixel is clipped in one of the photographs: expose both shorter."
        )
    adds = np.mean(part[open_] > 3 * noise[open_]) >= _MIN_USABLE
    darker_alone = not adds and np.mean(part[open_] < -3 * noise[open_]) > _DARKER_ALONE
    if darker_alone or np.mean(part[open_] < -2 * noise[open_]) > _DARKER:
        if given_ratio is not None:
            raise SwappedPairError(
                f"With the exposure ratio given, {given_ratio:.3g}, the photograph with the flash "
                "is darker than the one without it: pass the flash frame's exposure divided by the "
                "other's, or swap the two if they are the wrong way round."
            )
        raise SwappedPairError(
            "The photograph with the flash is darker than the one without it: swap the two, or "
            "pass the exposure ratio if the camera did not write it."
        )
    if not adds:
        raise UnusablePairError(
            "The flash adds too little light to measure: bring it nearer, raise its power, or "
            "shorten both exposures."
        )


def _sampled(pixels: Photograph | Mask) -> NDArray[Any]:
    """Some of the pixels (H, W, …), at equal steps."""
    height, width = pixels.shape[:2]
    step = max(_LEAST_STEP, int(np.sqrt(height * width / _SAMPLES)))
    return pixels[::step, ::step]
