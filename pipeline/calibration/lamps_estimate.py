"""What spheres tell of lamps, matt or mirrors, and which of a sphere's pixels tell it."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.arrays import Floats64
from pipeline.calibration.marks import disc
from pipeline.errors import OptionError
from pipeline.images.frames import Mask
from pipeline.options import Circle

_SMALLEST_PX = 12.0  # radius


@dataclass(frozen=True)
class LampsEstimate:
    """Distant lamps as they were found, the strongest first.

    directions: (N, 3) unit, from the surface to the lamp, x right, y up, z to the viewer.
    colours: (N, 3) camera RGB of a grey card that faces the lamp, one scale for all.
    deviations_deg: (N,) standard deviation of each direction: of a matt sphere as far as noise and
    paint go, of a mirror for an outline marked a hundredth of its radius aside, which is assumed.
    misfit: relative error of the light on a matt sphere, root mean square; None of a mirror, whose
    highlights are summed and not explained by a model.
    circle: the sphere's outline as it was found near the one that was marked.
    flash_aside_deg: angle at the sphere between the camera and the flash; None where a mirror does
    not show the flash. one_more: whether one lamp more would explain far more of the light on a
    matt sphere.
    """

    directions: Floats64
    colours: Floats64
    deviations_deg: Floats64
    misfit: float | None
    circle: Circle
    flash_aside_deg: float | None
    one_more: bool = False


def inside_sphere(shape: tuple[int, ...], sphere: Circle, share: float) -> Mask:
    """Pixels (H, W) within a share, 0…1, of the radius of a sphere's outline.

    Raises OptionError for an outline that is too small or not wholly in the picture.
    """
    if sphere.radius < _SMALLEST_PX:
        raise OptionError(
            f"The sphere has a radius of only {sphere.radius:.3g} pixels: it must have "
            f"{_SMALLEST_PX:g}, so photograph it from nearer."
        )
    disc(shape, sphere, "sphere")
    return disc(shape, Circle(x=sphere.x, y=sphere.y, radius=share * sphere.radius), "sphere")
