"""The focal length of a photograph."""

from __future__ import annotations

from pipeline.images.frames import Frame
from pipeline.run_warnings import Code, RunWarning

_NORMAL_LENS = 50.0 / 36.0  # of the longer side


def focal_length_px(frame: Frame, given: float | None) -> tuple[float, list[RunWarning]]:
    """Focal length in pixels: the given one, else the file's, else a normal lens's with a warning.

    Returns the warning as a list, which is empty where there is none.
    """
    known = given or frame.focal_px
    if known:
        return known, []
    message = (
        "The focal length is not known; that of a 50 mm lens on 35 mm film was taken. Pass the "
        "focal length in pixels for exact normals."
    )
    focal_px = _NORMAL_LENS * max(frame.size)
    return focal_px, [RunWarning(Code.FOCAL_LENGTH_ASSUMED, message, {"focal_px": focal_px})]
