from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.errors import OptionError
from pipeline.options import Options
from pipeline.output_names import OUTPUT_NAMES, outputs_with
from pipeline.results.wanted_outputs import (
    check_directions,
    check_outputs,
    held_outputs,
    wanted_outputs,
    white_warnings,
)
from pipeline.run_warnings import Code, RunWarning


def test_default_leaves_out_what_is_made_on_request() -> None:
    assert wanted_outputs(Options()) == frozenset(OUTPUT_NAMES) - {
        "white_balanced_1.tif",
        "white_balanced_2.tif",
        "white_balanced.exr",
        "response.exr",
        "layers.psd",
    }


@pytest.mark.parametrize("names", [[], ["gamma.png"], ["layers.exr", "white_balanced.exr"]])
def test_names_are_taken_as_they_are_and_all_is_all(names: list[str]) -> None:
    assert wanted_outputs(Options(outputs=names)) == frozenset(names)
    assert wanted_outputs(Options(outputs="all")) == frozenset(OUTPUT_NAMES)


@pytest.mark.parametrize("name", sorted(outputs_with("facing")))
def test_normals_by_name_need_directions(name: str) -> None:
    names = ["gamma.png", name]
    two = [{"direction": (1, 0, 1)}, {"direction": (0, 1, 1)}]

    with pytest.raises(OptionError, match=f"The output {name} needs the lamps' directions"):
        check_directions(Options(outputs=names))

    check_directions(Options.model_validate({"outputs": names, "light_directions": two}))
    for unnamed in ("all", "default"):
        check_directions(Options.model_validate({"outputs": unnamed}))


@pytest.mark.parametrize(
    ("setup", "told"),
    [("tabel", "for the set-up 'tabel' with"), ("none", "for a set-up with")],
)
def test_the_set_up_is_named_for_which_lamps_were_to_be_kept(setup: str, told: str) -> None:
    with pytest.raises(OptionError, match=f"calibrate the lamps of this camera {told}"):
        check_directions(Options(outputs=["normals.png"], setup=setup))


def test_why_kept_lamps_are_left_out_is_told_where_they_are_needed() -> None:
    left_out = [RunWarning(Code.KEPT_UNUSABLE, "The lamps kept as 'a' were left out.")]

    with pytest.raises(OptionError, match=r"way up first\. The lamps kept as 'a' were left out\.$"):
        check_directions(Options(outputs=["normals.png"]), left_out)


@pytest.mark.parametrize("name", ["depth.exr", "surface.glb", "normals_confidence.tif"])
def test_the_published_normals_come_without_a_surface(name: str) -> None:
    three = [{"direction": one} for one in ((1, 0, 1), (0, 1, 1), (-1, 0, 1))]
    given = {"method": "paper", "light_directions": three}

    with pytest.raises(ValidationError, match=f"the output {name} is not made by the method paper"):
        Options.model_validate({**given, "outputs": ["normals.exr", name]})

    normals = Options.model_validate({**given, "outputs": ["normals.exr", "normals.png"]})
    assert wanted_outputs(normals) == {"normals.exr", "normals.png"}
    assert name in wanted_outputs(Options.model_validate({**given, "outputs": "all"}))
    assert name in wanted_outputs(Options.model_validate(given))


IN_A_PLANE = ((1, 0, 1), (-1, 0, 1), (0, 0, 1))
BEHIND = ((1, 0, -1), (0, 1, -1), (-1, 0, -1))


@pytest.mark.parametrize(
    ("method", "directions", "said"),
    [
        ("best", IN_A_PLANE, "lie nearly in one plane"),
        ("paper", IN_A_PLANE, "lie nearly in one plane"),
        ("best", BEHIND[:2], "None of the light directions"),
        ("paper", ((1, 0, 1), (0, 1, 1)), "need three light directions, and there are 2"),
    ],
)
def test_directions_that_fix_no_normals_are_refused_where_normals_are_wanted(
    method: str, directions: Any, said: str
) -> None:
    lights = [{"direction": one} for one in directions]
    options = Options.model_validate({"method": method, "light_directions": lights})

    with pytest.raises(OptionError, match=said):
        check_directions(options)

    check_directions(options.model_copy(update={"outputs": ["lamps.jpg"]}))


def test_directions_that_fix_normals_are_taken() -> None:
    lights = [{"direction": one} for one in ((1, 0, 1), (0, 1, 1), (-1, 0, 1))]
    for given in (
        {"method": "paper", "light_directions": lights},
        {"light_directions": lights[:2]},
    ):
        options = Options.model_validate(given)
        check_directions(options)


@pytest.mark.parametrize(
    "name",
    [
        "lamps.jpg",
        "white_balanced_1.jpg",
        "white_balanced_2.jpg",
        "response.jpg",
        "response_lamps.jpg",
    ],
)
def test_jpegs_of_what_they_cannot_hold_are_refused(name: str) -> None:
    check_outputs(frozenset({"layers.exr", name}), (65500, 1000), Options())

    with pytest.raises(OptionError, match="A JPEG cannot hold 65501 × 1000 pixels"):
        check_outputs(frozenset({"layers.exr", name}), (65501, 1000), Options())


def test_other_outputs_and_reduced_jpegs_hold_larger_pictures() -> None:
    others = {name for name in OUTPUT_NAMES if not name.endswith((".jpg", ".psd"))}

    check_outputs(frozenset(others | {"thumbnail.jpg"}), (1000, 65501), Options())


PSD = frozenset({"layers.exr", "layers.psd"})


@pytest.mark.parametrize(
    ("lights", "holds", "beyond", "layers"),
    [
        ("auto", (10_000, 8_943), (14_000, 12_777), "a layer"),
        (1, (14_000, 12_774), (14_000, 12_777), "a layer"),
        (2, (12_000, 9_937), (12_000, 9_938), "2 layers"),
        (3, (10_000, 8_943), (10_000, 8_944), "3 layers"),
        (1, (30_000, 100), (30_001, 100), "a layer"),
    ],
)
def test_layers_by_name_that_can_be_held_by_no_means_are_refused_before_any_work(
    lights: Any, holds: tuple[int, int], beyond: tuple[int, int], layers: str
) -> None:
    options = Options(outputs=sorted(PSD), lights=lights)

    check_outputs(PSD, holds, options)

    width, height = beyond
    words = rf"^layers\.psd cannot hold {layers} of {width} × {height} pixels, .*; leave it out of"
    with pytest.raises(OptionError, match=words):
        check_outputs(PSD, beyond, options)
    check_outputs(frozenset({"layers.exr"}), beyond, options)


@pytest.mark.parametrize(
    ("size", "fewer"),
    [((10_000, 8_944), "2 or 1"), ((12_000, 9_937), "2 or 1"), ((12_000, 9_938), "1")],
)
def test_more_layers_by_name_than_can_be_held_are_refused_before_they_are_found(
    size: tuple[int, int], fewer: str
) -> None:
    width, height = size
    words = (
        rf"^layers\.psd cannot hold 3 layers of {width} × {height} pixels, .* 2 GB, and as many "
        rf"may be found: ask for {fewer}, or leave it out of the outputs\.$"
    )
    with pytest.raises(OptionError, match=words):
        check_outputs(PSD, size, Options(outputs=sorted(PSD)))
    check_outputs(PSD, size, Options(outputs=sorted(PSD), lights=1))
    check_outputs(PSD, size, Options(outputs="all"))


def test_layers_that_nobody_named_are_passed_over_with_a_warning() -> None:
    options, size = Options(outputs="all", lights=3), (12_000, 9_000)
    check_outputs(PSD, size, options)

    rest, (warning,) = held_outputs(PSD, size, 3, options)

    assert rest == {"layers.exr"}
    assert warning.code == "output_left_out"
    assert warning.message.startswith("layers.psd cannot hold 3 layers of 12000 × 9000 pixels")
    assert held_outputs(PSD, size, 2, options) == (PSD, [])
    assert held_outputs(rest, size, 3, options) == (rest, [])


def test_layers_by_name_are_not_passed_over() -> None:
    """They are refused before, when they may be too many."""
    options = Options(outputs=sorted(PSD))

    assert held_outputs(PSD, (12_000, 9_000), 3, options) == (PSD, [])


def test_what_files_of_integers_cut_off_is_told_with_what_to_divide_by() -> None:
    photograph = np.full((100, 100, 3), 0.5, np.float32)
    photograph[:98, :, 1] = 200.0
    tiffs = frozenset({"lamps.tif"})

    (warning,) = white_warnings(photograph, np.inf, tiffs)

    assert warning.code == "above_white"
    assert warning.figures == {"share": pytest.approx(0.98), "brightest": 200.0}
    assert "In 98% of the picture" in warning.message
    assert "divide both photographs by 200 first" in warning.message
    assert "; layers.exr, which was not asked for, holds all of it." in warning.message
    (warning,) = white_warnings(photograph, np.inf, tiffs | {"layers.exr"})
    assert "; layers.exr holds all of it." in warning.message
    assert white_warnings(photograph, np.inf, frozenset({"layers.exr", "lamps.jpg"})) == []
    assert white_warnings(photograph / np.float32(200), np.inf, tiffs) == []
    assert white_warnings(photograph, 1.0, tiffs) == []


def test_a_few_highlights_above_white_are_not_told_of() -> None:
    photograph = np.full((100, 100, 3), 0.5, np.float32)
    photograph[0, :99] = 3.0

    assert white_warnings(photograph, np.inf, frozenset({"layers.psd"})) == []


@pytest.mark.parametrize(("share", "told"), [(0.0075, False), (0.0125, True)])
def test_light_just_above_white_is_told_of_in_more_than_a_hundredth(
    share: float, told: bool
) -> None:
    photograph = np.full((80, 100, 3), 1.0, np.float32)
    photograph.reshape(-1, 3)[: round(share * 8000), 2] = 1.01

    found = white_warnings(photograph, np.inf, frozenset({"lamps.tif"}))

    assert [warning.figures["share"] for warning in found] == [pytest.approx(share)] * told


def test_who_divides_by_what_is_told_keeps_all_but_the_brightest_200th() -> None:
    photograph = np.full((100, 100, 3), 1.5, np.float32)
    photograph[0], photograph[1, :40] = 3.0, 90.0

    (warning,) = white_warnings(photograph, np.inf, frozenset({"lamps.tif"}))

    assert warning.figures == {"share": 1.0, "brightest": 3.0}


@pytest.mark.parametrize("size", [(5000, 40), (40, 5000)])
def test_of_a_tall_photograph_no_more_is_looked_at_than_of_a_wide_one(
    size: tuple[int, int],
) -> None:
    looked_at: list[Any] = []

    class Looked:
        shape = (*size, 3)

        def __getitem__(self, part: Any) -> Any:
            looked_at.append(part)
            return np.zeros((1, 1, 3), np.float32)

    photograph: Any = Looked()

    assert white_warnings(photograph, np.inf, frozenset({"lamps.tif"})) == []
    assert looked_at == [np.s_[::5, ::5]]
