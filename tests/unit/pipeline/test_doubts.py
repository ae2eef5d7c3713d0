from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from pipeline import doubts as doubts_module
from pipeline.arrays import Floats64
from pipeline.doubts import doubts, doubts_of_published, expected_snr_db, relative_noise
from pipeline.hui2018.separation import published_layers
from pipeline.light.model import Model
from pipeline.output_names import DEFAULT_OUTPUTS
from pipeline.pair.flash_reach import FlashReach
from pipeline.pair.reduced import reduce_pair
from pipeline.run_warnings import Code, RunWarning
from pipeline.separation.possible import off_possible

Build = Callable[..., Any]


@pytest.fixture
def said(
    exact: Build, lamps_of: Build, warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., list[RunWarning]]:
    """Doubts of a clean pair of two lamps, but for what is given of pair, lamps or light."""

    def find(
        residual: Floats64 | None = None,
        reach: FlashReach | None = None,
        hidden: list[int] | None = None,
        clipped: float = 0.0,
        coefficients: Floats64 | None = None,
        usable: Any = True,
        in_shadows: tuple[float, float] | None = None,
        red_over_blue: float | None = None,
        rendered: bool = False,
        sharp: int = 96,
        method: Literal["best", "paper"] = "best",
        wanted: frozenset[str] = DEFAULT_OUTPUTS,
        **lamps: Any,
    ) -> list[RunWarning]:
        colours = warm_to_cool[[0, 2]] if coefficients is None else coefficients
        pair, _ = exact(warm_to_cool[[0, 2]], clipped=clipped)
        if residual is not None:
            monkeypatch.setattr(doubts_module, "relative_residual", lambda *_: residual)
        if reach is not None:
            monkeypatch.setattr(doubts_module, "flash_reach", lambda *_: reach)
        if hidden is not None:
            monkeypatch.setattr(doubts_module, "without_pure_light", lambda *_: hidden)
        if in_shadows is not None:
            left = np.array(in_shadows)
            monkeypatch.setattr(doubts_module, "light_in_shadows", lambda *_: left)
            monkeypatch.setattr(doubts_module, "_SHARP", sharp)
        reduced = reduce_pair(pair)
        reduced = replace(reduced, usable=reduced.usable & usable, rendered=rendered)
        if red_over_blue is not None:
            red, _, blue = reduced.flash[reduced.usable].mean(axis=0)
            reduced.flash[..., 0] *= red_over_blue * blue / red
            reduced.flash[~reduced.usable] = 9.0, 0.0, 0.0
            none = np.zeros(reduced.usable.shape)
            monkeypatch.setattr(doubts_module, "relative_residual", lambda *_: none)
        return doubts(pair, reduced, lamps_of(colours, **lamps), method, wanted)

    return find


def test_a_clean_pair_has_none(said: Callable[..., list[RunWarning]]) -> None:
    assert said() == []


@pytest.mark.parametrize(
    ("method", "layers"),
    [
        ("best", "are filled in from their surroundings"),
        ("paper", "are as published and cannot be relied on"),
    ],
)
def test_published_layers_are_not_said_to_be_filled_in(
    said: Callable[..., list[RunWarning]], method: Literal["best", "paper"], layers: str
) -> None:
    weak, clipped = said(reach=FlashReach(0.5, 2.0), clipped=0.2, method=method)

    assert (weak.code, clipped.code) == (Code.FLASH_TOO_WEAK, Code.CLIPPED)
    assert f"where the layers {layers}; 50% can be separated" in weak.message
    assert f"where the layers {layers}: expose both shorter." in clipped.message


def test_published_layers_that_lamps_can_have_made_are_not_warned_of(
    exact: Build, lamps_of: Build, model: Model, warm_to_cool: Floats64
) -> None:
    pair, _ = exact(warm_to_cool[[0, 2]])

    assert doubts_of_published(reduce_pair(pair), lamps_of(warm_to_cool[[0, 2]]), model) == []


def test_published_layers_that_do_not_add_up_are_told(
    exact: Build, lamps_of: Build, model: Model, warm_to_cool: Floats64
) -> None:
    """The light of a bulb and of blue sky, from a bulb and a green lamp."""
    pair, _ = exact(warm_to_cool[[0, 2]])
    reduced = reduce_pair(pair)
    lamps = lamps_of(warm_to_cool[:2])

    (warning,) = doubts_of_published(reduced, lamps, model)

    layers = published_layers(
        reduced.no_flash, reduced.flash, lamps.coefficients, model.tensor, model.published
    )
    missing = np.linalg.norm(layers.sum(axis=0) - reduced.no_flash)
    assert warning.code == Code.LAYERS_IMPOSSIBLE
    # each of two layers takes half of what is missing
    least = missing / np.linalg.norm(reduced.no_flash) / np.sqrt(2)
    assert warning.figures["off"] >= 0.99 * least > 0.1
    assert 0.2 < warning.figures["share"] <= 1.0


def test_published_layers_that_are_negative_are_told(
    exact: Build, lamps_of: Build, model: Model, warm_to_cool: Floats64
) -> None:
    """Of a lamp that is red beyond all others: they add up, with light taken away."""
    pair, _ = exact(warm_to_cool[[0, 2]])
    reduced = reduce_pair(pair)
    beyond = warm_to_cool[0] + 1.5 * (warm_to_cool[0] - warm_to_cool[2])
    lamps = lamps_of(np.array([beyond / np.linalg.norm(beyond), warm_to_cool[2]]))

    (warning,) = doubts_of_published(reduced, lamps, model)

    layers = published_layers(
        reduced.no_flash, reduced.flash, lamps.coefficients, model.tensor, model.published
    )
    np.testing.assert_allclose(layers.sum(axis=0), reduced.no_flash, atol=1e-3)
    assert layers.min() < -0.05
    assert warning.code == Code.LAYERS_IMPOSSIBLE
    off = off_possible(reduced.no_flash, layers) / np.linalg.norm(reduced.no_flash, axis=-1)
    assert warning.figures["share"] == pytest.approx(np.mean(off > 0.1), abs=1e-3)
    assert np.mean(off > 0.05) > np.mean(off > 0.1) > np.mean(off > 0.2)
    assert f"in {warning.figures['share']:.1%} of the picture they are negative" in warning.message


def test_four_lamps_are_told_instead_of_what_they_leave(
    said: Callable[..., list[RunWarning]],
) -> None:
    (warning,) = said(four_or_more=True, left_over=0.2)

    assert warning.code == Code.FOUR_OR_MORE
    assert "four or more" in warning.message


@pytest.mark.parametrize(
    ("number", "advice"),
    [(1, "Ask for more lamps, or check"), (2, "Ask for more lamps, or check"), (3, "Check")],
)
def test_no_more_than_three_lamps_are_to_be_asked_for(
    said: Callable[..., list[RunWarning]], warm_to_cool: Floats64, number: int, advice: str
) -> None:
    (warning,) = said(coefficients=warm_to_cool[:number], hidden=[], left_over=0.09)

    assert f"in a tenth of it. {advice} camera and flash spectrum" in warning.message


def test_what_lamps_leave_everywhere_is_not_called_a_reflection(
    said: Callable[..., list[RunWarning]],
) -> None:
    (warning,) = said(left_over=0.09, residual=np.full((64, 96), 0.15))

    assert warning.code == Code.UNEXPLAINED
    assert warning.figures == {"left_over": 0.09}
    assert warning.message.startswith("2 lamps do not explain the photograph: 9%")


def test_one_lamp_that_does_not_explain_the_photograph_is_told(
    said: Callable[..., list[RunWarning]], warm_to_cool: Floats64
) -> None:
    (warning,) = said(left_over=0.09, coefficients=warm_to_cool[:1])

    assert warning.message.startswith("One lamp does not explain the photograph: 9%")


@pytest.mark.parametrize(("columns", "warned"), [(28, False), (29, True)])
def test_reflections_are_told_from_a_share_of_the_usable_picture_on(
    said: Callable[..., list[RunWarning]], columns: int, warned: bool
) -> None:
    """1.5 %; what is not usable has no layers to doubt."""
    residual, usable = np.zeros((64, 96)), np.ones((64, 96), bool)
    residual[:2, :columns] = residual[40:] = 0.3
    usable[40:] = False

    found = said(residual=residual, usable=usable)

    assert [one.code for one in found] == [Code.REFLECTIONS] * warned
    if warned:
        assert found[0].figures == {"share": pytest.approx(2 * 29 / (40 * 96))}


@pytest.mark.parametrize(("rows", "warned"), [(0, False), (8, True)])
def test_what_lamps_leave_in_places_is_a_reflection(
    said: Callable[..., list[RunWarning]], rows: int, warned: bool
) -> None:
    residual = np.full((64, 96), 0.09)
    residual[:rows] = 0.11

    found = said(residual=residual)

    assert [warning.code for warning in found] == [Code.REFLECTIONS] * warned
    if warned:
        assert found[0].figures["share"] == pytest.approx(rows / 64)
        assert "residual.png" in found[0].message


@pytest.mark.parametrize(
    ("requested", "lamps", "asks"), [("auto", 1, 2), ("auto", 2, 3), (2, 2, 0), ("auto", 3, 0)]
)
def test_where_the_number_was_counted_reflections_may_be_a_weak_lamp(
    said: Callable[..., list[RunWarning]],
    warm_to_cool: Floats64,
    requested: Literal["auto", 2],
    lamps: int,
    asks: int,
) -> None:
    (warning,) = said(
        residual=np.full((64, 96), 0.11),
        coefficients=warm_to_cool[:lamps],
        requested=requested,
        hidden=[],
    )

    assert warning.code == Code.REFLECTIONS
    assert warning.message.endswith("all over the picture.") is not bool(asks)
    assert (f"A weak lamp more looks alike: ask for {asks} lamps" in warning.message) is bool(asks)


@pytest.mark.parametrize(
    ("outputs", "words"),
    [
        ({"residual.png"}, "; residual.png shows where."),
        ({"lamps.jpg"}, "; the output residual.png, which was not asked for, shows where."),
    ],
)
def test_sentences_send_nobody_to_a_map_that_is_not_written(
    said: Callable[..., list[RunWarning]], outputs: set[str], words: str
) -> None:
    wanted = frozenset(outputs)

    (reflections,) = said(residual=np.full((64, 96), 0.11), wanted=wanted)
    (unexplained,) = said(left_over=0.09, wanted=wanted)

    assert (reflections.code, unexplained.code) == (Code.REFLECTIONS, Code.UNEXPLAINED)
    assert words in reflections.message
    assert words in unexplained.message


def test_lines_along_edges_are_no_reflections(said: Callable[..., list[RunWarning]]) -> None:
    residual = np.zeros((64, 96))
    residual[::3], residual[:, ::48] = 0.3, 0.3

    assert said(residual=residual) == []


@pytest.mark.parametrize(("share", "warned"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("noise", [0.0, 0.04])
def test_light_in_a_lamps_shadows_is_a_reflection_where_it_is_more_than_lamps_are_mixed_up(
    said: Callable[..., list[RunWarning]],
    warm_to_cool: Floats64,
    monkeypatch: pytest.MonkeyPatch,
    noise: float,
    share: float,
    warned: bool,
) -> None:
    """Three hundredths of a lamp's light, more in noise, and the more the nearer lamps are."""
    sine = float(np.linalg.norm(np.cross(*warm_to_cool[[0, 2]])))
    left = share * 3 * np.hypot(0.01, noise / 2) / sine
    monkeypatch.setattr(doubts_module, "relative_noise", lambda _: noise)

    found = said(in_shadows=(0.001, left))

    assert [one.code for one in found] == [Code.REFLECTIONS] * warned
    if warned:
        assert found[0].figures == {"in_shadows": pytest.approx(left)}
        assert found[0].message.startswith(f"In the shadows of lamp2 there is {left:.0%} of its")
        assert "or the lamp is so large that its shadows" in found[0].message


def test_light_in_shadows_is_not_asked_of_bent_values_nor_of_published_lamps(
    said: Callable[..., list[RunWarning]],
) -> None:
    assert said(in_shadows=(0.5, 0.5), rendered=True) == []
    assert said(in_shadows=(0.5, 0.5), method="paper") == []


def test_light_in_shadows_is_not_asked_of_small_pairs(
    said: Callable[..., list[RunWarning]],
) -> None:
    """The pair's longer side is of 96 blocks."""
    assert len(said(in_shadows=(0.5, 0.5), sharp=96)) == 1
    assert said(in_shadows=(0.5, 0.5), sharp=97) == []


def test_what_lamps_leave_is_told_before_light_in_shadows(
    said: Callable[..., list[RunWarning]],
) -> None:
    (warning,) = said(residual=np.full((64, 96), 0.3), in_shadows=(0.5, 0.5))

    assert set(warning.figures) == {"share"}


@pytest.mark.parametrize(("degrees", "warned"), [(5.9, True), (6.1, False)])
def test_lamps_that_are_alike_come_with_angle_and_expectation(
    said: Callable[..., list[RunWarning]], warm_to_cool: Floats64, degrees: float, warned: bool
) -> None:
    warm, _, cool = warm_to_cool
    aside = cool - (cool @ warm) * warm
    angle = np.radians(degrees)
    other = np.cos(angle) * warm + np.sin(angle) * aside / np.linalg.norm(aside)

    found = said(coefficients=np.stack([warm, other]), hidden=[], residual=np.zeros((64, 96)))

    assert [warning.code for warning in found] == [Code.LAMPS_ALIKE] * warned
    if warned:
        figures = found[0].figures
        assert figures["angle_deg"] == pytest.approx(degrees, abs=0.01)
        assert figures["expected_snr_db"] == pytest.approx(expected_snr_db(degrees, 0.0), abs=0.5)
        assert f"{degrees}° apart" in found[0].message
        assert "If they are one lamp, ask for 1; if not, a coloured filter" in found[0].message


def test_what_is_expected_of_lamps_that_are_alike_falls_with_noise(
    said: Callable[..., list[RunWarning]], warm_to_cool: Floats64, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doubts_module, "relative_noise", lambda _: 0.02)
    near = np.stack([warm_to_cool[0], 0.99 * warm_to_cool[0] + 0.01 * warm_to_cool[2]])

    (warning,) = said(coefficients=near, hidden=[], residual=np.zeros((64, 96)))

    expected = expected_snr_db(warning.figures["angle_deg"], 0.02)
    assert warning.figures["expected_snr_db"] == expected
    assert expected < expected_snr_db(warning.figures["angle_deg"], 0.0) - 1


def test_what_speaks_against_known_lamps_is_told(said: Callable[..., list[RunWarning]]) -> None:
    against = RunWarning(Code.PIN_CONTRADICTED, "The photograph speaks against it.", {"pin": 1})

    assert said(contradictions=(against,)) == [against]


@pytest.mark.parametrize(("rival_deg", "warned"), [(5.0, False), (5.1, True), (25.0, True)])
def test_other_lamps_nearly_as_likely_are_told(
    said: Callable[..., list[RunWarning]], rival_deg: float, warned: bool
) -> None:
    found = said(rival_deg=rival_deg)

    assert [(one.code, one.figures) for one in found] == [
        (Code.LAMPS_AMBIGUOUS, {"angle_deg": rival_deg})
    ] * warned


def test_lamps_never_seen_alone_are_named(said: Callable[..., list[RunWarning]]) -> None:
    (warning,) = said(hidden=[0, 1])

    assert warning.code == Code.NO_PURE_LIGHT
    assert "lit by lamp1 alone or by lamp2 alone" in warning.message
    assert warning.figures == {"lamps": 2}
    assert said(hidden=[0, 1], method="paper") == []


@pytest.mark.parametrize(("confidence", "warned"), [(0.59, True), (0.6, False)])
def test_an_uncertain_number_is_told(
    said: Callable[..., list[RunWarning]], confidence: float, warned: bool
) -> None:
    found = said(confidence=confidence)

    assert [(one.code, one.figures) for one in found] == [
        (Code.NUMBER_UNCERTAIN, {"confidence": confidence})
    ] * warned


@pytest.mark.parametrize(
    ("weak", "stops", "words"),
    [(0.4, 2.26, "flash at least 2.3 stops stronger"), (1.0, 6.0, "flash at least 6.0 stops")],
)
def test_a_weak_flash_comes_with_what_to_do(
    said: Callable[..., list[RunWarning]], weak: float, stops: float, words: str
) -> None:
    (warning,) = said(reach=FlashReach(weak, stops))

    assert warning.code == Code.FLASH_TOO_WEAK
    assert warning.figures == {"share": weak, "usable_share": 1 - weak, "stops": stops}
    assert words in warning.message


@pytest.mark.parametrize(("weak", "warned"), [(0.05, False), (0.09, False), (0.11, True)])
def test_a_flash_that_misses_little_is_strong_enough(
    said: Callable[..., list[RunWarning]], weak: float, warned: bool
) -> None:
    assert [one.code for one in said(reach=FlashReach(weak, 3.0))] == [Code.FLASH_TOO_WEAK] * warned


@pytest.mark.parametrize(("clipped", "warned"), [(0.04, False), (0.06, True)])
def test_clipping_is_told(
    said: Callable[..., list[RunWarning]], clipped: float, warned: bool
) -> None:
    found = said(clipped=clipped)

    assert [(one.code, one.figures) for one in found] == [
        (Code.CLIPPED, {"share": clipped})
    ] * warned


@pytest.mark.parametrize(("times", "warned"), [(1.05, False), (0.95, True)])
@pytest.mark.parametrize("rendered", [False, True])
def test_a_rendering_in_which_the_flash_is_blue_is_told(
    said: Callable[..., list[RunWarning]], times: float, warned: bool, rendered: bool
) -> None:
    """A sensor's values have any balance. What is unusable counts for nothing."""
    usable = np.arange(96) > 20
    found = said(red_over_blue=0.4 * times, rendered=rendered, usable=usable)

    if not (warned and rendered):
        assert found == []
        return
    (one,) = found
    assert one.code == Code.FLASH_BLUE
    assert one.figures == {"red_over_blue": pytest.approx(0.38)}
    assert "with 0.38 times as much red as blue" in one.message


def test_expected_snr_falls_with_noise_and_likeness() -> None:
    by_angle = [expected_snr_db(angle, 0.0) for angle in (1, 2, 5, 10, 40)]

    assert by_angle == sorted(by_angle)
    # twice the angle parts small ones by 6 dB
    assert by_angle[1] - by_angle[0] == pytest.approx(6.0, abs=0.3)
    assert expected_snr_db(2, 0.02) == pytest.approx(by_angle[1] - 3.0, abs=0.1)
    assert expected_snr_db(0.0, 0.0) == expected_snr_db(0.01, 0.0) == 4.0


def test_noise_is_that_of_both_lights_in_the_middle(exact: Build, warm_to_cool: Floats64) -> None:
    reduced = reduce_pair(exact(warm_to_cool[:1])[0])
    light, part = np.full((4, 5, 3), 0.1, np.float32), np.full((4, 5, 3), 0.2, np.float32)
    noise = np.full((4, 5, 3), 3e-6, np.float32)
    usable = np.ones((4, 5), bool)
    light[0, 0], usable[0, 0] = 1e-6, False
    light[1] = 1e-3  # fewer than half of the pixels

    found = relative_noise(
        replace(
            reduced,
            no_flash=light,
            flash=part,
            no_flash_variance=noise,
            flash_variance=noise,
            usable=usable,
        )
    )

    assert found == pytest.approx(np.hypot(0.01, 0.005))
