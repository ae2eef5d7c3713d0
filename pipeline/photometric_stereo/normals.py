"""Surface normals, by the method asked for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from pipeline.hui2018.normals import assign_lamps, published_normals
from pipeline.lamps.lamps import Lamps
from pipeline.light.model import Model
from pipeline.options import DirectedLight, Method
from pipeline.pair.reduced import ReducedPair
from pipeline.photometric_stereo.detail import surface_normals
from pipeline.photometric_stereo.facing import Facing
from pipeline.photometric_stereo.outline import turns_away
from pipeline.photometric_stereo.solve import Surface, solve_surface
from pipeline.progress import Progress
from pipeline.run_warnings import Code, RunWarning

_MUCH_LEFT = 0.05  # relative; sensor noise leaves up to 0.025
_MUCH_UNEXPLAINED = 0.07  # of the pixels; development objects with right depth leave up to 0.058
_TURNED_DEG = 1.0  # more than rounding; the light turns directions by more, or not at all

_INSIDE_OUT = -0.05  # of turns_away; things have .35 and more, walls 0, a mirrored egg −.17


def find_facing(
    lights: Sequence[DirectedLight],
    reduced: ReducedPair,
    lamps: Lamps,
    model: Model,
    focal_px: float,
    method: Method,
    progress: Progress,
) -> Facing:
    """Solve for what normals need; see solve_surface ("best") and assign_lamps ("paper").

    Raises OptionError for directions nearly in a plane, and where there are not three lamps;
    UnusablePairError where hardly anything is lit; Canceled.
    """
    if method == "paper":
        directed = assign_lamps(lights, reduced, lamps, model, focal_px)
        normals_of = partial(published_normals, lamps=lamps, directed=directed)
        return Facing(normals_of, directed.strengths, None)
    surface = solve_surface(lights, reduced, lamps, model, focal_px, progress)
    normals_of = partial(surface_normals, surface=surface)
    warnings = (*_of_colours(lights, lamps), *_warnings(surface))
    return Facing(normals_of, surface.strengths, surface, warnings)


def _of_colours(lights: Sequence[DirectedLight], lamps: Lamps) -> tuple[RunWarning, ...]:
    """Warn where colours that are alike are all that tells from where which light comes."""
    if not lamps.alike or all(light.rgb for light in lights):
        return ()
    angle = lamps.least_angle_deg
    message = (
        f"Normals and depth are doubtful: two of the lamps found are only {angle:.1f}° apart in "
        "colour, and which light comes from where is told by colours alone. Give the rgb of each "
        "lamp with its direction, as calibrating the lamps by a sphere does."
    )
    return (RunWarning(Code.NORMALS_DOUBTFUL, message, {"angle_deg": angle}),)


def _warnings(surface: Surface) -> tuple[RunWarning, ...]:
    if surface.misfit >= _MUCH_LEFT:
        why = f"{surface.misfit:.0%} of it is left over in half the picture"
    elif surface.unexplained >= _MUCH_UNEXPLAINED:
        why = f"{surface.unexplained:.0%} of the surface has light that they do not give"
    elif not (surface.strengths > 0).all():
        why = "one of them would have to take light away"
    else:
        return _of_directions(surface) or _of_outline(surface)
    message = (
        "Lamps in the directions given do not explain the light, so that normals and depth are "
        f"doubtful: {why}. Check the directions, the focal length, and that the flash sits at the "
        "camera. If they are right, one thing before another may be why, or a shiny one: "
        "photograph things one at a time, before a far and dark ground."
    )
    figures = {"left_over": surface.misfit, "unexplained": surface.unexplained}
    return (RunWarning(Code.NORMALS_DOUBTFUL, message, figures),)


def _of_directions(surface: Surface) -> tuple[RunWarning, ...]:
    if surface.turned_deg < _TURNED_DEG:
        return ()
    message = (
        f"The light fits directions up to {surface.turned_deg:.0f}° beside those given, and those "
        "that fit were used. Normals and depth may be right so, but check the directions, which "
        "lamp is which, the focal length, and that the flash sits at the camera."
    )
    return (RunWarning(Code.NORMALS_DOUBTFUL, message, {"turned_deg": surface.turned_deg}),)


def _of_outline(surface: Surface) -> tuple[RunWarning, ...]:
    turned = turns_away(surface.mask, surface.w)
    if turned >= _INSIDE_OUT:
        return ()
    message = (
        "Normals and depth are doubtful: at its outline the surface turns to its inside, as of "
        "things seen inside out. Check that directions are x right, y up and z to the camera, and "
        "which lamp is which. Hollow things, such as a bowl seen from above, are right so."
    )
    return (RunWarning(Code.NORMALS_DOUBTFUL, message, {"turned_away": turned}),)
