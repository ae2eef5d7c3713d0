"""All pictures of a run, some rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pipeline.arrays import Floats32
from pipeline.estimate import Estimate
from pipeline.hui2018.white_balance import PublishedWhiteBalance
from pipeline.images.frames import Image, Plane
from pipeline.options import Method, Options
from pipeline.output_names import Need, outputs_with
from pipeline.pair.pair import Pair
from pipeline.pictures.clipped import shown_layers
from pipeline.pictures.response import other_response
from pipeline.pictures.white_balance import WhiteBalance, whites_of
from pipeline.progress import Progress
from pipeline.separation.separation import Strip, separate, separate_reduced


@dataclass(frozen=True)
class Pictures:
    """Some rows of every picture, linear (h, W, 3); None where not wanted.

    rows: which. layers: (N, h, W, 3). shown_layers: what is shown of them, clipped light in its
    lamp's colour. white_balanced_1, _2: camera RGB as under the neutral light,
    by approach I and II. normals: unit, NaN where unknown. normals_confidence: (h, W) 0…1, how far
    the normals can be trusted. response: the photograph in linear RGB of the other camera.
    confidence: (h, W) 0…1, 0 where the layers are filled in from their surroundings.
    """

    rows: slice
    layers: Floats32
    shown_layers: Floats32
    white_balanced_1: Image | None
    white_balanced_2: Image | None
    normals: Image | None
    normals_confidence: Plane | None
    response: Image | None
    confidence: Plane


def render(
    pair: Pair,
    estimate: Estimate,
    options: Options,
    wanted: frozenset[str],
    progress: Progress,
    strip_rows: int,
) -> Iterator[Pictures]:
    """Separate the pair and make every picture that a wanted output needs, top to bottom.

    estimate: of the pair. options: of which method and quality count. wanted: names of outputs
    (pipeline.output_names).
    """
    facing, lamps, model = estimate.facing, estimate.lamps, estimate.model
    surface = None if facing is None else facing.surface
    balance = _balance(options.method, estimate, pair)
    for strip in separate(pair, estimate.reduced, lamps, model, options, progress, strip_rows):
        normals = None
        if facing is not None and _needed("normals", wanted):
            normals = facing.normals_of(strip)
        trust = None
        if surface is not None and normals is not None and "normals_confidence.tif" in wanted:
            from pipeline.photometric_stereo.confidence import normals_confidence  # few ask for it

            trust = normals_confidence(strip, surface, normals)
        pictures = _shown(strip, pair.clipping, balance, estimate, wanted)
        yield replace(pictures, normals=normals, normals_confidence=trust)


def overview(pair: Pair, estimate: Estimate, method: Method, wanted: frozenset[str]) -> Pictures:
    """Make the pictures that are shown as small as the reduced pair, to tell how bright they are.

    estimate, wanted: as for render. There are no normals.
    """
    strip = separate_reduced(pair, estimate.reduced, estimate.lamps)
    balance = _balance(method, estimate, pair)
    return _shown(strip, pair.clipping, balance, estimate, wanted)


def _shown(
    strip: Strip,
    clipping: float,
    balance: WhiteBalance | PublishedWhiteBalance,
    estimate: Estimate,
    wanted: frozenset[str],
) -> Pictures:
    """All pictures of a strip but the normals."""
    balanced_1, balanced_2 = balance.of(
        strip, _needed("white_balanced_1", wanted), _needed("white_balanced_2", wanted)
    )
    changes = estimate.changes
    shown = shown_layers(strip.layers, whites_of(estimate.lamps, estimate.model), clipping)
    return Pictures(
        rows=strip.rows,
        layers=strip.layers,
        shown_layers=shown,
        white_balanced_1=balanced_1,
        white_balanced_2=balanced_2,
        normals=None,
        normals_confidence=None,
        response=other_response(shown, changes)
        if changes is not None and _needed("response", wanted)
        else None,
        confidence=strip.confidence,
    )


def _needed(picture: Need, wanted: frozenset[str]) -> bool:
    """Whether a wanted output is made from that picture."""
    return not wanted.isdisjoint(outputs_with(picture))


def _balance(
    method: Method, estimate: Estimate, pair: Pair
) -> WhiteBalance | PublishedWhiteBalance:
    if method == "paper":
        return PublishedWhiteBalance(estimate.lamps, estimate.model)
    return WhiteBalance(estimate.lamps, estimate.model, pair.clipping)
