"""Pairs of which is taken off what a camera's rendering made of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Exposure, Frame, Image
from pipeline.images.noise import Noise
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.exposure import ExposureRatio
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.rendering import Rendering, find_rendering
from pipeline.pair.tone_curve import ToneCurve
from pipeline.run_warnings import Code
from tests.unit.pipeline.pair.pairs_of_frames import have_neighbours, lay_as_they_are, paired

Build = Callable[..., Any]
Given = dict[str, list[tuple[Any, ...]]]

TONE = ToneCurve(np.linspace(-0.5, 0.0, 11))
BALANCE = BalanceChange(1.25, 0.8)
MAPPING = LocalToneMapping(np.tile(np.linspace(0.1, 0.4, 128), (96, 1)), 1, 0.25)
"""Brighter towards the right, by blocks as small as pixels."""
FOUND: dict[str, Any] = {"tone": TONE, "mapping": MAPPING, "balance": BALANCE}
SEARCHES = {
    "tone": "find_tone_curve",
    "mapping": "find_local_tone_mapping",
    "balance": "find_balance_change",
}


def without(kind: str, light: Image) -> Image:
    """A flash photograph without what was found."""
    if kind == "tone":
        return TONE.light(light)
    if kind == "mapping":
        return np.asarray(light * np.exp(MAPPING.logs)[..., None], np.float32)
    return np.asarray(light @ BALANCE.matrix.T, np.float32)


@pytest.fixture
def search(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Given]:
    """Have searches find some kinds, and the others nothing; what each is given, each time."""

    def have(*kinds: str) -> Given:
        given: Given = {}
        for kind, name in SEARCHES.items():
            given[kind] = []

            def find(*arguments: Any, kind: str = kind) -> Any:
                given[kind].append(arguments)
                return FOUND[kind] if kind in kinds else None

            monkeypatch.setattr(f"pipeline.pair.rendering.{name}", find)
        monkeypatch.setattr(
            "pipeline.pair.rendering.settle_balance_change", lambda *arguments: arguments[1:]
        )
        monkeypatch.setattr("pipeline.pair.rendering.find_ratio_and_balance", lambda *_: None)
        have_neighbours(monkeypatch)
        return given

    return have


def rendered(frames: Build, scale: float = 1.0, **more: Any) -> tuple[Frame, Frame]:
    """A pair that a camera rendered."""
    before, after = (replace(one, encoding="srgb", **more) for one in frames(scale=scale))
    return before, after


@pytest.mark.parametrize("laid", [True, False])
@pytest.mark.parametrize("kind", SEARCHES)
def test_what_is_found_is_taken_off(
    frames: Build,
    search: Callable[..., Given],
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    laid: bool,
) -> None:
    """Also off a photograph that was laid on the other; exposures are put on one scale after it."""
    before, after = rendered(frames, scale=0.5)
    seen = after.pixels[:].copy()
    given = search(kind)
    if laid:
        lay_as_they_are(monkeypatch)

    pair = paired((before, after), exposure_ratio=0.5, align=laid)

    found = {
        "tone": pair.tone_curve,
        "mapping": pair.local_tone_mapping,
        "balance": pair.balance_change,
    }
    assert found == dict.fromkeys(SEARCHES) | {kind: FOUND[kind]}
    neighbours = given[kind][0][1 if kind == "mapping" else 0]
    assert neighbours.ratio == 0.5
    np.testing.assert_array_equal(after.pixels[:], seen)
    np.testing.assert_allclose(pair.flash[:], without(kind, seen) / 0.5, rtol=2e-4, atol=1e-6)
    light = TONE.light(before.pixels[:]) if kind == "tone" else before.pixels[:]
    np.testing.assert_allclose(pair.no_flash[:], light, rtol=2e-4)


@pytest.mark.parametrize(
    ("kind", "code"), [("mapping", Code.LOCAL_TONE_MAPPING), ("balance", Code.AUTO_WHITE_BALANCE)]
)
def test_of_what_is_not_alike_in_both_it_is_warned(
    frames: Build, search: Callable[..., Given], kind: str, code: Code
) -> None:
    search(kind)

    pair = paired(rendered(frames), exposure_ratio=1.0)

    (warning,) = [one for one in pair.warnings if one.code == code]
    assert warning.figures == FOUND[kind].entry()


@pytest.mark.parametrize("kind", SEARCHES)
def test_compression_noise_of_the_flash_photograph_goes_along(
    frames: Build, search: Callable[..., Given], kind: str
) -> None:
    noise = Noise(np.full(3, 1e-3), np.full(3, 1e-3))
    before, after = rendered(frames)
    search(kind)

    plain = paired((before, after), exposure_ratio=1.0)
    pair = paired((before, replace(after, compression=noise)), exposure_ratio=1.0)

    added = pair.flash_noise.floor - plain.flash_noise.floor
    np.testing.assert_allclose(added, FOUND[kind].noise(noise).floor, rtol=1e-6)


def test_each_is_looked_for_without_what_was_found_before_and_taken_off_around_it(
    frames: Build, search: Callable[..., Given]
) -> None:
    """A balance is asked for with the mapping on, first, for that to be told from it."""
    before, after = rendered(frames)
    given = search(*SEARCHES)

    pair = paired((before, after), exposure_ratio=1.0)

    there = MAPPING.logs.ravel()[[[0], [1]]]
    brightened = [one[0].brightened for one in given["balance"]]
    np.testing.assert_array_equal(brightened, [np.zeros((2, 1)), there])
    assert [one[2] for one in given["mapping"]] == [BALANCE]
    ((neighbours, *beside),) = given["tone"]
    np.testing.assert_array_equal(neighbours.brightened, there)
    assert beside == [BALANCE, True]
    expected = without("balance", without("mapping", TONE.light(after.pixels[:])))
    np.testing.assert_allclose(pair.flash[:], expected, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(pair.no_flash[:], TONE.light(before.pixels[:]), rtol=2e-4)


def test_balance_and_contrast_are_settled_together(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch
) -> None:
    search("balance", "tone")
    settled = BalanceChange(1.1, 0.9)
    given: list[Any] = []

    def settle(*arguments: Any) -> tuple[BalanceChange, None]:
        given.append(arguments[1:])
        return settled, None

    monkeypatch.setattr("pipeline.pair.rendering.settle_balance_change", settle)

    pair = paired(rendered(frames), exposure_ratio=1.0)

    assert given == [(BALANCE, TONE)]
    assert (pair.balance_change, pair.tone_curve) == (settled, None)


@pytest.mark.parametrize(
    ("encoding", "flash_only"), [("linear", False), ("raw", False), ("srgb", True)]
)
def test_nothing_is_looked_for_in_sensor_values_or_without_the_lamps_light(
    frames: Build, search: Callable[..., Given], encoding: str, flash_only: bool
) -> None:
    before, after = rendered(frames)
    given = search(*SEARCHES)

    pair = paired(
        (replace(before, encoding=encoding), replace(after, encoding=encoding)),
        flash_only=flash_only,
        exposure_ratio=1.0,
    )

    assert given == {kind: [] for kind in SEARCHES}
    assert (pair.tone_curve, pair.local_tone_mapping, pair.balance_change) == (None, None, None)
    np.testing.assert_array_equal(pair.no_flash[:], before.pixels[:])


def test_where_exposures_are_not_known_a_contrast_alone_is_looked_for(
    frames: Build, search: Callable[..., Given]
) -> None:
    given = search(*SEARCHES)

    pair = paired(rendered(frames, exposure=Exposure()))

    assert (given["mapping"], given["balance"]) == ([], [])
    assert [one[1:] for one in given["tone"]] == [(None, False)]
    assert (pair.tone_curve, pair.local_tone_mapping, pair.balance_change) == (TONE, None, None)


@pytest.mark.parametrize("places", [True, False])
def test_a_ratio_that_nobody_knows_is_taken_from_the_pair(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch, places: bool
) -> None:
    """A contrast is looked for with it, and neither a mapping nor a balance."""
    before, after = rendered(frames, exposure=Exposure())
    given = search()
    monkeypatch.setattr("pipeline.pair.rendering.find_rendered_ratio", lambda _: 0.8)
    if not places:
        monkeypatch.setattr("pipeline.pair.rendering.find_neighbours", lambda *_: None)

    pair = paired((before, after))

    assert (pair.exposure_ratio, pair.exposure_source) == (0.8, "pixels")
    assert [one[0].ratio for one in given["tone"]] == [0.8] * places
    assert [one[1:] for one in given["tone"]] == [(None, True)] * places
    assert (given["mapping"], given["balance"]) == ([], [])
    np.testing.assert_allclose(pair.flash[:], after.pixels[:] / 0.8, rtol=1e-5)
    codes = [one.code for one in pair.warnings]
    assert Code.EXPOSURE_ESTIMATED in codes
    assert Code.RENDERED_EXPOSURES_DIFFER in codes
    assert Code.EXPOSURE_ASSUMED not in codes


@pytest.mark.parametrize("ratio", [0.75, 1.0])
def test_a_balance_that_differs_as_well_is_taken_off_with_the_ratio(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch, ratio: float
) -> None:
    """It is told with the ratio, where that was found without gains as well."""
    before, after = rendered(frames, exposure=Exposure())
    search()
    alone: list[float] = []
    monkeypatch.setattr("pipeline.pair.rendering.find_rendered_ratio", lambda _: 0.8)

    def find(_: Any, found: float) -> tuple[float, BalanceChange]:
        alone.append(found)
        return ratio, BALANCE

    monkeypatch.setattr("pipeline.pair.rendering.find_ratio_and_balance", find)

    pair = paired((before, after))

    assert alone == [0.8]
    assert (pair.exposure_ratio, pair.balance_change) == (ratio, BALANCE)
    assert pair.exposure_source == ("assumed" if ratio == 1.0 else "pixels")
    expected = without("balance", after.pixels[:]) / ratio
    np.testing.assert_allclose(pair.flash[:], expected, rtol=1e-3, atol=1e-5)
    codes = {one.code for one in pair.warnings}
    exposure = Code.EXPOSURE_ASSUMED if ratio == 1.0 else Code.EXPOSURE_ESTIMATED
    assert {Code.AUTO_WHITE_BALANCE, exposure} <= codes
    assert (Code.RENDERED_EXPOSURES_DIFFER in codes) == (ratio != 1.0)


def test_balances_set_by_hand_are_not_asked_for_with_the_ratio(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch
) -> None:
    search()
    monkeypatch.setattr("pipeline.pair.rendering.find_rendered_ratio", lambda _: None)
    monkeypatch.setattr(
        "pipeline.pair.rendering.find_ratio_and_balance", lambda *_: (0.75, BALANCE)
    )

    pair = paired(rendered(frames, exposure=Exposure(), auto_white_balance=False))

    assert (pair.exposure_ratio, pair.balance_change) == (1.0, None)


def test_a_ratio_that_was_given_is_not_asked_for(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch
) -> None:
    search()
    monkeypatch.setattr("pipeline.pair.rendering.find_rendered_ratio", lambda _: 0.8)

    pair = paired(rendered(frames), exposure_ratio=1.0)

    assert (pair.exposure_ratio, pair.exposure_source) == (1.0, "option")


def test_where_few_places_tell_nothing_is_looked_for(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch
) -> None:
    given = search(*SEARCHES)
    monkeypatch.setattr("pipeline.pair.rendering.find_neighbours", lambda *_: None)

    pair = paired(rendered(frames), exposure_ratio=1.0)

    assert given == {kind: [] for kind in SEARCHES}
    assert (pair.tone_curve, pair.local_tone_mapping, pair.balance_change) == (None, None, None)


@pytest.mark.parametrize(
    ("without_flash", "with_flash", "asked"),
    [(False, False, 0), (True, False, 2), (False, True, 2), (None, False, 2)],
)
def test_a_balance_is_looked_for_where_the_camera_may_have_set_one(
    frames: Build,
    search: Callable[..., Given],
    without_flash: bool | None,
    with_flash: bool | None,
    asked: int,
) -> None:
    """Once more where there is a mapping, too."""
    before, after = rendered(frames)
    given = search("mapping")

    paired(
        (
            replace(before, auto_white_balance=without_flash),
            replace(after, auto_white_balance=with_flash),
        ),
        exposure_ratio=1.0,
    )

    assert len(given["balance"]) == asked


def test_it_is_looked_for_where_the_photographs_lie_on_each_other(
    frames: Build, search: Callable[..., Given], monkeypatch: pytest.MonkeyPatch
) -> None:
    search()
    before, after = rendered(frames)
    laid, unusable = after.pixels[:, ::-1], before.unusable
    given: list[tuple[Any, ...]] = []
    monkeypatch.setattr("pipeline.pair.rendering.average_pair", lambda *all: given.append(all))

    find_rendering(before, after, laid, unusable, ExposureRatio(1.0, "exif"))

    ((first, second, marked),) = given
    assert (first is before.pixels, second is laid, marked is unusable) == (True, True, True)


@pytest.mark.parametrize("kind", SEARCHES)
def test_memory_of_its_own_is_written_over_and_the_files_is_not(frames: Build, kind: str) -> None:
    _, after = rendered(frames)
    seen, laid = after.pixels[:].copy(), after.pixels[:].copy()
    rendering = Rendering(**{kind: FOUND[kind]})

    off, over = rendering.off_flash(after, laid)
    _, beside = rendering.off_flash(after, after.pixels)

    assert over is laid
    np.testing.assert_allclose(over[:], without(kind, seen), rtol=2e-4, atol=1e-6)
    np.testing.assert_array_equal(beside[:], over[:])
    np.testing.assert_array_equal(after.pixels[:], seen)
    assert (off.pixels is after.pixels) == (kind != "tone")
