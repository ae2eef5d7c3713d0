from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.errors import OptionError
from pipeline.images.frames import Exposure, Frame
from pipeline.options import Options
from pipeline.pair.exposure import ExposureRatio, settled_ratio, written_ratio
from pipeline.pair.ratios import Ratios
from tests.unit.pipeline.pair.ratios_of_scenes import ratios_of
from tests.unit.pipeline.pair.shadows_on_paint import light_of

RNG = np.random.default_rng(3)


def ratios(reached: float, unreached: float | None) -> Ratios:
    """A third of the blocks at one ratio in all channels, the others above, in the flash's colour.

    reached: the least ratio of the others. unreached: of the third, None for none. All things are
    of other colours, which tell nothing.
    """
    logs = np.log(reached) + RNG.uniform(0, 1, (60, 60, 1)) + np.array([0.0, 0.2, 0.4])
    logs += RNG.uniform(-0.15, 0.15, logs.shape)
    if unreached is not None:
        logs[:20] = np.log(unreached) + RNG.normal(0, 0.003, (20, 60, 3))
    return Ratios(np.ones_like(logs), logs, np.full_like(logs, 0.003), np.ones((60, 60), bool), 1)


def photograph(frame: Callable[..., Frame], **exposure: float) -> Frame:
    return frame(np.full((4, 4, 3), 0.5), exposure=Exposure(**exposure))


def test_where_a_ratio_comes_from(frame: Callable[..., Frame]) -> None:
    known = photograph(frame, time_s=1 / 60, iso=100, f_number=8)
    longer = photograph(frame, time_s=1 / 30, iso=100, f_number=8)
    unknown = photograph(frame)

    written = written_ratio(known, longer, Options())
    assert written.value == pytest.approx(2.0)
    assert written.source == "exif"
    assert written_ratio(known, unknown, Options()) == ExposureRatio(1.0, "assumed")
    assert written_ratio(known, longer, Options(exposure_ratio=3)) == ExposureRatio(3.0, "option")


def test_a_lens_that_tells_no_f_number_leaves_time_and_speed(
    frame: Callable[..., Frame],
) -> None:
    once, twice = (
        photograph(frame, time_s=1 / 60, iso=100),
        photograph(frame, time_s=1 / 30, iso=50),
    )
    one_sided = photograph(frame, time_s=1 / 30, iso=100, f_number=8)

    assert written_ratio(once, twice, Options()) == ExposureRatio(1.0, "exif")
    assert written_ratio(once, one_sided, Options()) == ExposureRatio(1.0, "assumed")


@pytest.mark.parametrize("iso", [1e-4, 1e6])
def test_absurd_exposures_are_refused(frame: Callable[..., Frame], iso: float) -> None:
    with pytest.raises(OptionError, match=r"^The exposures in the files differ"):
        written_ratio(
            photograph(frame, time_s=1, iso=100, f_number=8),
            photograph(frame, time_s=1, iso=iso, f_number=8),
            Options(),
        )


@pytest.mark.parametrize(("ratio", "refused"), [(999, False), (1001, True)])
def test_exposures_may_differ_a_thousand_times(
    frame: Callable[..., Frame], ratio: float, refused: bool
) -> None:
    for times in (ratio, 1 / ratio):
        once, other = photograph(frame, time_s=1), photograph(frame, time_s=times)
        unknown = photograph(frame)
        if refused:
            with pytest.raises(OptionError, match=r"^The exposures in the files differ"):
                written_ratio(once, other, Options())
            with pytest.raises(ValidationError, match="exposure_ratio"):
                Options(exposure_ratio=times)
        else:
            assert written_ratio(once, other, Options()).value == pytest.approx(times)
            given = written_ratio(unknown, unknown, Options(exposure_ratio=times))
            assert given == ExposureRatio(times, "option")


@pytest.mark.parametrize("source", ["exif", "option"])
@pytest.mark.parametrize("unreached", [None, 1.0, 1.03, 0.97])
def test_a_ratio_that_fits_is_kept_without_a_word(source: str, unreached: float | None) -> None:
    ratio = ExposureRatio(0.5, source)

    assert settled_ratio(ratio, ratios(1.2, unreached), rendered=False) == (ratio, [])


@pytest.mark.parametrize(("unreached", "shown"), [(0.7, "1.4"), (2.0, "4")])
def test_a_ratio_that_was_written_is_kept_and_doubted(unreached: float, shown: str) -> None:
    ratio = ExposureRatio(2.0, "exif")

    found, warnings = settled_ratio(ratio, ratios(3.0, unreached), rendered=False)

    assert found == ratio
    (warning,) = warnings
    assert warning.message.startswith("The files' exposure ratio, 2, does not fit")
    assert f"shows {shown}. Pass the right exposure ratio" in warning.message
    assert "steady light" in warning.message


def test_a_camera_may_render_a_picture_a_little_brighter() -> None:
    ratio = ExposureRatio(1.0, "exif")

    assert settled_ratio(ratio, ratios(2.0, 0.8), rendered=True) == (ratio, [])
    assert len(settled_ratio(ratio, ratios(2.0, 0.5), rendered=True)[1]) == 1


def test_where_the_flash_reaches_everything_a_bound_is_told() -> None:
    found, (warning,) = settled_ratio(
        ExposureRatio(2.0, "option"), ratios(0.5, None), rendered=False
    )

    assert found.value == 2.0
    assert warning.message.startswith("The exposure ratio given, 2, makes ")
    assert "of the picture darker with the flash than without: it can be 1." in warning.message


@pytest.mark.parametrize("unreached", [0.5, 1.0, 4.0])
def test_a_ratio_that_nobody_knows_is_taken_from_the_pixels(unreached: float) -> None:
    found, (warning,) = settled_ratio(
        ExposureRatio(1.0, "assumed"), ratios(5.0, unreached), rendered=False
    )

    assert found.source == "pixels"
    assert found.value == pytest.approx(unreached, rel=0.01)
    assert f"shows a ratio of {found.value:.3g}, which was taken" in warning.message


@pytest.mark.parametrize(("reached", "said"), [(1.2, False), (0.4, True)])
def test_without_evidence_exposures_count_as_equal(reached: float, said: bool) -> None:
    ratio = ExposureRatio(1.0, "assumed")

    found, (warning,) = settled_ratio(ratio, ratios(reached, None), rendered=False)

    assert found == ratio
    assert warning.message.startswith("The files do not say how they were exposed; equal exposures")
    assert ("at most" in warning.message) is said


def test_too_few_sure_blocks_tell_nothing() -> None:
    noisy = replace(ratios(0.4, 0.3), noise=np.full((60, 60, 3), 0.2))

    assert settled_ratio(ExposureRatio(1.0, "exif"), noisy, rendered=False)[1] == []


def in_shadows(factor: float) -> Ratios:
    """Of paint in shadows, under a flash, on the scale of a ratio so many times the right one."""
    right = ratios_of(*light_of())
    return replace(right, logs=right.logs - np.log(factor))


@pytest.mark.parametrize("source", ["assumed", "exif", "option"])
def test_colours_that_agree_with_a_ratio_leave_it_without_a_word(source: str) -> None:
    ratio = ExposureRatio(1.0, source)

    assert settled_ratio(ratio, in_shadows(1.0), rendered=False) == (ratio, [])


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_ratio_that_nobody_knows_is_taken_from_colours(factor: float) -> None:
    ratio = ExposureRatio(1.0, "assumed")

    found, (warning,) = settled_ratio(ratio, in_shadows(factor), rendered=False)

    assert found.source == "pixels"
    assert found.value == pytest.approx(1 / factor, rel=0.03)
    assert warning.code == "exposure_estimated"
    assert f"With a ratio of {found.value:.3g} the flash's light has one colour" in warning.message


@pytest.mark.parametrize(("source", "said"), [("exif", "The files'"), ("option", "The")])
def test_a_ratio_that_colours_contradict_is_kept_and_doubted(source: str, said: str) -> None:
    ratio = ExposureRatio(2.0, source)

    found, (warning,) = settled_ratio(ratio, in_shadows(2.0), rendered=False)

    assert found == ratio
    assert warning.code == "exposure_mismatch"
    assert warning.message.startswith(f"{said} exposure ratio")
    assert warning.figures is not None
    assert warning.figures["ratio_shown"] == pytest.approx(1.0, rel=0.03)


def test_a_ratio_that_the_pair_told_before_is_kept_and_told_of() -> None:
    ratio = ExposureRatio(0.7, "pixels")

    found, (warning,) = settled_ratio(ratio, in_shadows(2.0), rendered=True)

    assert found == ratio
    assert (warning.code, warning.figures) == ("exposure_estimated", {"ratio": 0.7})


def test_colours_of_rendered_photographs_tell_no_ratio_here() -> None:
    ratio = ExposureRatio(1.0, "assumed")

    found, (warning,) = settled_ratio(ratio, in_shadows(0.5), rendered=True)

    assert found == ratio
    assert warning.code == "exposure_assumed"
    assert warning.message.endswith(
        "taken for granted. Pass the exposure ratio, even if it is 1: whether the camera balanced "
        "white or mapped tones differently in the two is looked for only where it is known."
    )
