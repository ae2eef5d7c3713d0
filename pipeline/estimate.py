"""What a whole pair tells, before any strip of it is worked on: its lamps and what follows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Floats64
from pipeline.doubts import doubts, doubts_of_published
from pipeline.images.frames import Frame, Mask
from pipeline.lamps.known_lamps import find_known
from pipeline.lamps.lamps import FindLamps, Lamps, estimate_lamps
from pipeline.lamps.shining import shining_warning, without_shining
from pipeline.light.model import Model
from pipeline.options import LampCount, Options
from pipeline.output_names import outputs_with
from pipeline.pair.moved_shadows import find_moved_shadows, moved_shadows_warning
from pipeline.pair.pair import Pair
from pipeline.pair.pair_warnings import NOTABLE_MOTION
from pipeline.pair.reduced import ReducedPair
from pipeline.photometric_stereo.facing import Facing
from pipeline.photometric_stereo.focal import focal_length_px
from pipeline.pictures.response import camera_changes
from pipeline.progress import Progress
from pipeline.run_warnings import RunWarning
from pipeline.separation.changed_lamps import without_change


@dataclass(frozen=True)
class Estimate:
    """What pictures, files and the manifest are made by.

    reduced: what it was estimated from. model: of the camera taken. facing: None where no normals
    are wanted. changes: (N, 3, 3) of camera_changes, None where there is no other camera.
    warnings: of the lamps and normals. left_out: (h, w), what shines itself and where shadows
    moved, not usable in reduced; None where nothing does.
    """

    reduced: ReducedPair
    model: Model
    lamps: Lamps
    facing: Facing | None = None
    changes: Floats64 | None = None
    warnings: tuple[RunWarning, ...] = ()
    left_out: Mask | None = None


def make_estimate(
    pair: Pair,
    reduced: ReducedPair,
    model: Model,
    frame: Frame,
    options: Options,
    wanted: frozenset[str],
    progress: Progress,
) -> Estimate:
    """Estimate the lamps, and where surfaces face if a wanted output needs it.

    reduced: of the pair. frame: the no-flash photograph, of which size and EXIF count. wanted:
    names of outputs (pipeline.output_names). Raises InputError for what the user can mend
    (find_known, estimate_lamps, find_facing), Canceled.
    """
    known = find_known(options, reduced, model)

    def find(some: ReducedPair, number: LampCount) -> Lamps:
        return estimate_lamps(some, model, number, options.method, known)

    if options.method == "best":
        found = _undisturbed(reduced, pair.moved > NOTABLE_MOTION, options.number_of_lamps, find)
    else:
        found = _Found(reduced, find(reduced, options.number_of_lamps))
    reduced, lamps = found.reduced, found.lamps
    warnings = [*found.warnings, *doubts(pair, reduced, lamps, options.method, wanted)]
    if options.method == "paper":
        warnings += doubts_of_published(reduced, lamps, model)
    facing = None
    if wanted & outputs_with("facing"):
        facing = _facing(found, model, frame, options, progress)
        warnings += facing.warnings if facing else ()
    changes = None
    if model.response is not None:
        changes = camera_changes(lamps, model, model.response, options.method)
    return Estimate(reduced, model, lamps, facing, changes, tuple(warnings), found.left_out)


@dataclass(frozen=True)
class _Found:
    """The lamps, and what they were found in; the rest as in Estimate.

    warnings: of what was left out or taken off for them.
    """

    reduced: ReducedPair
    lamps: Lamps
    left_out: Mask | None = None
    warnings: tuple[RunWarning, ...] = ()


def _undisturbed(
    reduced: ReducedPair, something_moved: bool, number: LampCount, find: FindLamps
) -> _Found:
    """Find lamps without moved shadows, what shines itself, and what lamps gave more by the flash.

    something_moved: whether the photographs show other things, as the pair tells itself.
    """
    moved = find_moved_shadows(reduced, something_moved)
    if moved is not None:
        find = _finding_beside(moved.places, find)
    lamps, warnings = find(reduced, number), []
    left_out = np.zeros_like(reduced.usable)
    if (rest := without_shining(reduced, lamps, find)) is not None:
        reduced, lamps, left_out = rest.reduced, rest.lamps, rest.shining
        warnings.append(shining_warning(float(rest.shining.mean())))
    if moved is not None:
        reduced = replace(reduced, usable=reduced.usable & ~moved.surely)
        left_out = left_out | moved.surely
        if not something_moved:
            warnings.append(moved_shadows_warning(moved.share))
    # lamps whose shadows moved seem to have changed
    still = moved is None and not something_moved
    if still and (steady := without_change(reduced, lamps, find)) is not None:
        reduced, lamps, told = steady
        warnings.append(told)
    return _Found(reduced, lamps, left_out if left_out.any() else None, tuple(warnings))


def _finding_beside(places: Mask, find: FindLamps) -> FindLamps:
    """Find lamps as find does, in what is usable beside places (h, w)."""
    return lambda some, number: find(replace(some, usable=some.usable & ~places), number)


def _facing(
    found: _Found, model: Model, frame: Frame, options: Options, progress: Progress
) -> Facing | None:
    """Where surfaces face; None where no directions of lamps are given. Raises as find_facing."""
    if options.light_directions is None:
        return None
    # imported only here: few ask for it, and it brings half of SciPy
    from pipeline.photometric_stereo.normals import find_facing

    focal_px, assumed = focal_length_px(frame, options.focal_px)
    facing = find_facing(
        options.light_directions,
        found.reduced,
        found.lamps,
        model,
        focal_px,
        options.method,
        progress,
    )
    return replace(facing, warnings=(*assumed, *facing.warnings))
