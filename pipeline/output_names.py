"""The files that a run can write, and what each of them is made of: the one table to add to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Need = Literal["white_balanced_1", "white_balanced_2", "facing", "normals", "surface", "response"]


@dataclass(frozen=True)
class Output:
    """What has to be there for an output, and when it is written.

    needs: pictures (pipeline.results.pictures.Pictures), beside the layers and the confidence that
    are always made; "facing", where surfaces face, which takes the lamps' directions; "surface",
    which the method paper does not find. by_default: written where the options name no outputs.
    full_size_jpeg: a JPEG as large as the photograph, which may be more than the format holds.
    """

    needs: tuple[Need, ...] = ()
    by_default: bool = True
    full_size_jpeg: bool = False


OUTPUTS = {
    "layers.exr": Output(),
    "lamps.tif": Output(),
    "lamps.jpg": Output(full_size_jpeg=True),
    "white_balanced_1.jpg": Output(("white_balanced_1",), full_size_jpeg=True),
    "white_balanced_2.jpg": Output(("white_balanced_2",), full_size_jpeg=True),
    "confidence.tif": Output(),
    "gamma.png": Output(),
    "residual.png": Output(),
    "preview.exr": Output(),
    "thumbnail.jpg": Output(),
    "normals.png": Output(("facing", "normals")),
    "normals.exr": Output(("facing", "normals")),
    "normals_confidence.tif": Output(("facing", "normals", "surface")),
    "depth.exr": Output(("facing", "surface")),
    "surface.glb": Output(("facing", "normals", "surface", "white_balanced_1")),
    "white_balanced_1.tif": Output(("white_balanced_1",), by_default=False),
    "white_balanced_2.tif": Output(("white_balanced_2",), by_default=False),
    "white_balanced.exr": Output(("white_balanced_1", "white_balanced_2"), by_default=False),
    "layers.psd": Output(by_default=False),
    "response.jpg": Output(("response",), full_size_jpeg=True),
    "response_lamps.jpg": Output(("response",), full_size_jpeg=True),
    "response.exr": Output(("response",), by_default=False),
}
"""lamps.tif, lamps.jpg and response_lamps.jpg stand for one file per lamp. manifest.json is always
written; what needs what there is not is passed over where it is not asked for by name."""

OUTPUT_NAMES = tuple(OUTPUTS)
DEFAULT_OUTPUTS = frozenset(name for name, output in OUTPUTS.items() if output.by_default)
FULL_SIZE_JPEGS = frozenset(name for name, output in OUTPUTS.items() if output.full_size_jpeg)


def outputs_with(need: Need) -> frozenset[str]:
    """Names of the outputs that need a picture, or what else Output.needs may say."""
    return frozenset(name for name, output in OUTPUTS.items() if need in output.needs)
