"""What is said about a run: everything needed to judge it and to repeat it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pipeline.arrays import Floats64
from pipeline.colour.spaces import XYZ_TO_SRGB
from pipeline.colour.temperature import cct_duv
from pipeline.encode.jpeg import to_srgb8
from pipeline.estimate import Estimate
from pipeline.images.frames import Frame
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.manifest_parts import input_entry, versions
from pipeline.mixes.mix_options import MixBasis
from pipeline.options import Options
from pipeline.pair.pair import Pair
from pipeline.photometric_stereo.facing import CONVENTIONS, Facing
from pipeline.result_names import lamp_name
from pipeline.run_warnings import RunWarning


@dataclass(frozen=True)
class Written:
    """What came of working through a pair.

    lamps: from lamp_entries. filled: share of pixels whose layers are filled in from their
    surroundings. files: from describe. mix: what mixing the layers starts from.
    """

    lamps: list[dict[str, Any]]
    filled: float
    files: list[dict[str, Any]]
    mix: MixBasis


def lamp_entries(lamps: Lamps, model: Model, separated: Floats64) -> list[dict[str, Any]]:
    """One entry per lamp: name, coefficients, colour, family, confidence.

    The colour is that of a grey card: rgb as the camera sees it, the largest 1; as people see it
    (Model.lamp_white) CCT and Duv, None far from white (cct_duv), and srgb, for a screen,
    "#rrggbb", its largest channel full, less where sRGB has no such colour (to_srgb8).
    family: the nearest of FAMILIES, family_confidence: 0…1 that it is this one.
    pinned: its place in the option pinned_lamps, from 0, None where it was free.
    separated: (N,) part 0…1 of each lamp's light that was separated and not filled in.
    """
    entries = []
    for index, (coefficients, matrix) in enumerate(
        zip(lamps.coefficients, lamps.matrices, strict=True)
    ):
        seen, white = matrix @ model.flash_white, model.lamp_white(matrix)
        # under a wrong camera the published lights may point the other way
        rgb = (-seen if seen.sum() < 0 else seen).clip(min=0.0)
        white_like = cct_duv(white)
        family, family_confidence = model.families.nearest(matrix)
        entries.append(
            {
                "name": lamp_name(index),
                "coefficients": [round(float(c), 6) for c in coefficients],
                "rgb": [round(float(c), 4) for c in rgb / rgb.max()],
                "cct_k": None if white_like is None else round(white_like[0]),
                "duv": None if white_like is None else round(white_like[1], 4),
                "srgb": _on_screen(white),
                "family": family,
                "family_confidence": round(family_confidence, 3),
                "confidence": round(float(lamps.lamp_confidence[index]), 3),
                "pinned": None if lamps.pinned[index] < 0 else int(lamps.pinned[index]),
                "separated_share": round(float(separated[index]), 3),
            }
        )
    return entries


def _on_screen(xyz: Floats64) -> str:
    linear = XYZ_TO_SRGB @ xyz
    colour = (linear / max(float(linear.max()), 1e-9)).astype(np.float32)
    red, green, blue = to_srgb8(colour.reshape(1, 1, 3))[0, 0]
    return f"#{red:02x}{green:02x}{blue:02x}"


def make_manifest(
    frames: tuple[Frame, Frame],
    options: Options,
    pair: Pair,
    estimate: Estimate,
    written: Written,
    calibrations: list[dict[str, str]],
    warnings: list[RunWarning],
) -> dict[str, Any]:
    """Build the manifest; equal input and options give equal bytes.

    calibrations: from with_kept, those that stood in for options.
    """
    no_flash, flash = frames
    given = options.flash_spectrum
    camera, lamps, facing = estimate.model.camera, estimate.lamps, estimate.facing
    alignment = pair.alignment
    correlation = alignment.correlation
    return {
        "inputs": {"no_flash": input_entry(no_flash), "flash": input_entry(flash)},
        "options": options.model_dump(mode="json"),
        "camera": {"name": camera.name, "source": camera.source},
        "flash": {
            "name": given if isinstance(given, str) else "table",
            "source": "named" if isinstance(given, str) else "file",
            "flash_only": pair.flash_only,
        },
        "exposure_ratio": round(pair.exposure_ratio, 6),
        "exposure_source": pair.exposure_source,
        "tone_curve": None if pair.tone_curve is None else pair.tone_curve.entry(),
        "local_tone_mapping": pair.local_tone_mapping and pair.local_tone_mapping.entry(),
        "balance_change": None if pair.balance_change is None else pair.balance_change.entry(),
        "alignment": {
            "applied": alignment.applied or pair.parallax > 0,
            "matrix": [[round(float(v), 9) for v in row] for row in alignment.matrix],
            "correlation": None if correlation is None else round(correlation, 4),
            "parallax": round(pair.parallax, 4),
        },
        "moved": round(pair.moved, 4),
        "lights": {
            "requested": lamps.requested,
            "found": len(lamps),
            "confidence": round(lamps.confidence, 3),
        },
        "lamps": written.lamps,
        "normals": None if facing is None else _normals(facing, options.normals),
        "filled": round(written.filled, 4),
        "files": written.files,
        "mix": written.mix.model_dump(mode="json"),
        "calibrations": calibrations,
        "warnings": [warning.entry() for warning in warnings],
        "versions": versions(),
    }


def _normals(facing: Facing, convention: Literal["gl", "dx"]) -> dict[str, Any]:
    return {
        "convention": CONVENTIONS[convention],
        "strengths": [round(float(strength), 4) for strength in facing.strengths],
    }
