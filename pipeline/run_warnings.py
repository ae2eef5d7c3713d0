"""What a run warns of: a stable code for programs, a sentence and its figures for people."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

_DIGITS = 4


class Code(StrEnum):
    """Names of all warnings. They stay as they are; sentences may change."""

    # the pair
    ORIENTATIONS_DIFFER = "orientations_differ"
    NOT_ALIGNED = "not_aligned"
    EXPOSURE_ASSUMED = "exposure_assumed"
    EXPOSURE_ESTIMATED = "exposure_estimated"
    EXPOSURE_MISMATCH = "exposure_mismatch"
    ENCODING_DOUBTFUL = "encoding_doubtful"
    RENDERED_SRGB = "rendered_srgb"
    AUTO_WHITE_BALANCE = "auto_white_balance"
    LOCAL_TONE_MAPPING = "local_tone_mapping"
    ONE_GREY = "one_grey"
    FLASH_BLUE = "flash_blue"
    RENDERED_EXPOSURES_DIFFER = "rendered_exposures_differ"
    BLURRED = "blurred"
    MOVED = "moved"
    LIGHT_CHANGED = "light_changed"
    FLICKER = "flicker"
    VIGNETTING = "vignetting"
    FLASH_LIKE_LAMPS = "flash_like_lamps"
    FLASH_TOO_WEAK = "flash_too_weak"
    CLIPPED = "clipped"
    NOTHING_KEPT = "nothing_kept"
    KEPT_UNUSABLE = "kept_unusable"
    CALIBRATION_UNFIT = "calibration_unfit"
    # the lamps
    CAMERA_APPROXIMATE = "camera_approximate"
    CAMERA_DOUBTFUL = "camera_doubtful"
    FLASH_DOUBTFUL = "flash_doubtful"
    FOUR_OR_MORE = "four_or_more"
    UNEXPLAINED = "unexplained"
    NUMBER_UNCERTAIN = "number_uncertain"
    LAMPS_ALIKE = "lamps_alike"
    LAMPS_AMBIGUOUS = "lamps_ambiguous"
    REFLECTIONS = "reflections"
    SHINES_ITSELF = "shines_itself"
    NO_PURE_LIGHT = "no_pure_light"
    LAYERS_IMPOSSIBLE = "layers_impossible"
    PIN_NOT_PURE = "pin_not_pure"
    PIN_CONTRADICTED = "pin_contradicted"
    FORBIDDEN_LAMP_SHOWS = "forbidden_lamp_shows"
    # normals
    FOCAL_LENGTH_ASSUMED = "focal_length_assumed"
    NORMALS_DOUBTFUL = "normals_doubtful"
    FLASH_ASIDE = "flash_aside"
    HIGHLIGHT_CLIPPED = "highlight_clipped"
    # the files
    OUTPUT_LEFT_OUT = "output_left_out"
    ABOVE_WHITE = "above_white"


@dataclass(frozen=True)
class RunWarning:
    """One warning.

    message: what, where and what to do, one or two sentences. figures: what the message is based
    on, by names that end in their unit where they have one; shares are 0…1.
    """

    code: Code
    message: str
    figures: Mapping[str, float] = field(default_factory=dict)

    def entry(self) -> dict[str, Any]:
        """Return what the manifest says of it: code, message, figures."""
        figures = {name: round(float(value), _DIGITS) for name, value in self.figures.items()}
        return {"code": self.code.value, "message": self.message, "figures": figures}
