from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats32, Floats64
from pipeline.errors import UnusablePairError
from pipeline.lamps.count import DOUBTFUL
from pipeline.lamps.lamps import Lamps
from pipeline.options import LampCount
from pipeline.pair.pairs_of_places import Places
from pipeline.pair.reduced import ReducedPair
from pipeline.separation.changed_lamps import _refined, _told, lit_by_flash, without_change
from tests.reduced_pairs import HEIGHT, WIDTH, reduced_pair

Build = Callable[..., Any]

_PATCH = 8  # blocks of one surface


@pytest.fixture
def lamps(lamps_of: Build, warm_to_cool: Floats64) -> Lamps:
    """A bulb and blue sky."""
    found: Lamps = lamps_of(warm_to_cool[[0, 2]])
    return found


@pytest.fixture
def room(surfaces: Floats64, lamps: Lamps) -> Callable[..., tuple[ReducedPair, Floats32]]:
    """Patches of paint under shadows of both lamps, which changed, and the flash's own light."""

    def build(
        changes: tuple[float, float], even: bool = False, lit: Lamps = lamps, **more: Any
    ) -> tuple[ReducedPair, Floats32]:
        random = np.random.default_rng(3)
        shape = HEIGHT // _PATCH, WIDTH // _PATCH
        paint = surfaces[random.choice(len(surfaces), shape)]
        flash = paint.repeat(_PATCH, axis=0).repeat(_PATCH, axis=1).astype(np.float32)
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        shadows = np.sin(x / 5) * np.cos(y / 7) > 0
        share = np.full(y.shape, 0.5) if even else np.where(shadows, 0.1, 0.9)
        shares = np.stack([share, 1.0 - share])[..., None]
        layers = shares * np.stack([flash @ matrix.T for matrix in lit.matrices])
        more_light = np.tensordot(changes, layers, 1)
        given = {"no_flash": layers.sum(axis=0), "flash": flash + more_light, **more}
        pair = {name: np.asarray(given.pop(name), np.float32) for name in ("no_flash", "flash")}
        return reduced_pair(pair["no_flash"], pair["flash"], **given), flash

    return build


def never(_: ReducedPair, __: LampCount) -> Lamps:
    raise AssertionError("lamps are found once more")


@pytest.mark.parametrize("changes", [(0.0, 0.0), (0.05, 0.0), (0.0, -0.05)])
def test_steady_lamps_stay_as_they_were_found(
    room: Build, lamps: Lamps, changes: tuple[float, float]
) -> None:
    reduced, _ = room(changes)

    assert without_change(reduced, lamps, never) is None


@pytest.mark.parametrize("changes", [(0.07, 0.0), (0.0, 0.1), (-0.15, 0.0), (0.35, 0.0)])
def test_what_lamps_gave_more_is_taken_off_the_flash_part(
    room: Build, lamps: Lamps, changes: tuple[float, float]
) -> None:
    reduced, flash = room(changes)
    asked = []

    def estimate(lit: ReducedPair, _: LampCount) -> Lamps:
        asked.append(lit)
        return lamps

    found = without_change(reduced, lamps, estimate)

    assert found is not None
    steady, of_steady, _ = found
    assert of_steady.changes is not None
    np.testing.assert_allclose(of_steady.changes, changes, atol=0.01)
    np.testing.assert_allclose(steady.flash, flash, rtol=0.02)
    assert steady.no_flash is reduced.no_flash
    np.testing.assert_array_equal(asked[0].no_flash, reduced.no_flash)
    assert np.abs(asked[0].flash - flash).mean() < 0.3 * np.abs(reduced.flash - flash).mean()


def test_what_cannot_be_used_tells_nothing(room: Build, lamps: Lamps) -> None:
    reduced, _ = room((0.1, 0.0))
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[:, : WIDTH // 3] = False
    wrong, _ = room((0.1, 0.0), usable=usable)
    wrong.flash[~usable] = reduced.no_flash[~usable] * np.float32(3.0)

    found = without_change(wrong, lamps, lambda _, __: lamps)

    assert found is not None
    assert found[1].changes is not None
    np.testing.assert_allclose(found[1].changes, (0.1, 0.0), atol=0.01)


def test_half_a_picture_tells_nothing(room: Build, lamps: Lamps) -> None:
    """As of an object before black, which has few surfaces."""
    usable = np.ones((HEIGHT, WIDTH), bool)
    usable[:, : WIDTH // 2] = False
    reduced, _ = room((0.1, 0.0), usable=usable)

    assert without_change(reduced, lamps, lambda _, __: lamps) is None


@pytest.mark.parametrize("more", [{"rendered": True}, {"flash_only": True}])
def test_renderings_and_flash_parts_given_alone_are_not_asked(
    room: Build, lamps: Lamps, more: dict[str, Any]
) -> None:
    reduced, _ = room((0.3, 0.0))

    assert without_change(replace(reduced, **more), lamps, never) is None


def test_a_single_lamp_that_was_asked_for_is_not_asked(
    room: Build, lamps_of: Build, warm_to_cool: Floats64
) -> None:
    reduced, _ = room((0.3, 0.3))

    assert without_change(reduced, lamps_of(warm_to_cool[:1]), never) is None


@pytest.mark.parametrize("changes", [(0.0, 0.0), (0.1, 0.0)])
def test_two_lamps_are_tried_where_one_was_counted(
    room: Build,
    lamps: Lamps,
    lamps_of: Build,
    warm_to_cool: Floats64,
    changes: tuple[float, float],
) -> None:
    """Also of the pair without the change, and then their number is a guess."""
    reduced, _ = room(changes)
    counted = lamps_of(warm_to_cool[:1], requested="auto")

    found = without_change(
        reduced, counted, lambda _, number: counted if number == "auto" else lamps
    )

    if not any(changes):
        assert found is None
    else:
        assert found is not None
        assert found[1].changes == pytest.approx(changes, abs=0.01)
        assert (found[1].requested, found[1].confidence) == ("auto", DOUBTFUL)


@pytest.mark.parametrize("change", [0.45, 0.9])
def test_changes_too_great_to_be_told_are_none(room: Build, lamps: Lamps, change: float) -> None:
    reduced, _ = room((change, 0.0))

    assert without_change(reduced, lamps, never) is None


def test_even_light_tells_nothing(room: Build, lamps: Lamps) -> None:
    reduced, _ = room((0.3, 0.0), even=True)

    assert without_change(reduced, lamps, never) is None


def test_where_nothing_is_usable_nothing_is_told(room: Build, lamps: Lamps) -> None:
    reduced, _ = room((0.3, 0.0), usable=np.zeros((HEIGHT, WIDTH), bool))

    assert without_change(reduced, lamps, never) is None


def test_lamps_that_are_not_found_again_stay_as_they_were(room: Build, lamps: Lamps) -> None:
    reduced, _ = room((0.2, 0.0))

    def estimate(_: ReducedPair, __: LampCount) -> Lamps:
        raise UnusablePairError("too few pixels")

    assert without_change(reduced, lamps, estimate) is None


def test_lamps_that_become_more_by_every_round_stay_as_they_were(
    room: Build, lamps: Lamps, lamps_of: Build, warm_to_cool: Floats64
) -> None:
    """Changes that belong to other lamps than the last ones say nothing of these."""
    reduced, _ = room((0.2, 0.0))
    numbers = iter([3, 2, 3, 2])

    def estimate(_: ReducedPair, __: LampCount) -> Lamps:
        return lamps if next(numbers) == 2 else lamps_of(warm_to_cool)

    assert without_change(reduced, lamps, estimate) is None


def test_a_flash_part_of_steady_lamps_is_returned_itself(room: Build, lamps: Lamps) -> None:
    reduced, _ = room((0.2, 0.0))

    assert lit_by_flash(reduced.no_flash, reduced.flash, lamps) is reduced.flash


@pytest.mark.parametrize(
    ("changes", "lamp", "change", "said"),
    [
        ((0.0, 0.1), 2, 0.1, "lamp2 was "),
        ((-0.2, 0.0), 1, -0.2, "% weaker"),
    ],
)
def test_the_warning_names_the_lamp_that_changed_most(
    room: Build,
    lamps: Lamps,
    changes: tuple[float, float],
    lamp: int,
    change: float,
    said: str,
) -> None:
    found = without_change(room(changes)[0], lamps, lambda _, __: lamps)

    assert found is not None
    warning = found[2]
    assert warning.code == "light_changed"
    assert said in warning.message
    assert warning.figures == {"lamp": lamp, "change": pytest.approx(change, abs=0.02)}


def places(change: float, alike: int, strangers: int = 0, unlit: int = 0) -> Places:
    """Pairs of places that a lamp lights, more in the second one, and one that does not matter.

    change: of that lamp. alike: so many are of one paint. strangers: so many are not. unlit: so
    many of the others are of one paint, but without the lamps.
    """
    paint = np.random.default_rng(4).uniform(0.5, 0.9, (alike + strangers, 3))
    other = paint.copy()
    other[alike:, 0] *= 3
    lamp = np.stack([0.2 * paint, 1.5 * other]) * [1.0, 0.6, 0.3]
    other[alike : alike + unlit], lamp[:, alike : alike + unlit] = paint[alike : alike + unlit], 0.0
    return Places(
        np.stack([paint, other]) + change * lamp, np.stack([lamp, 0.01 * lamp[..., ::-1]])
    )


@pytest.mark.parametrize(("alike", "told"), [(5, False), (8, True)])
def test_a_peak_of_few_pairs_is_chance(alike: int, told: bool) -> None:
    """.86 % for each of 1,000 that are of one paint; .53 % are asked for."""
    found = _told(places(0.2, alike, 1000 - alike))

    assert (found is not None) == told
    if found is not None:
        np.testing.assert_allclose(found, (0.2, 0.0), atol=1e-3)


@pytest.mark.parametrize(
    ("alike", "unlit", "told"),
    [(3, 24, False), (4, 24, True), (22, 466, False), (30, 466, True)],
)
def test_a_gain_is_more_than_chance_and_a_share_of_the_height(
    alike: int, unlit: int, told: bool
) -> None:
    """.086 % for each; of a height of 2 % chance makes .28, and 6 % of 40 % are 2.4."""
    found = _told(places(0.2, alike, 1000 - alike, unlit))

    assert (found is not None) == told


def test_a_lamp_of_the_flashs_own_colour_is_not_told_weaker() -> None:
    """Its light, put back to the flash part, makes any two places more alike."""
    random = np.random.default_rng(4)
    flash = np.exp(random.normal(0, 0.03, (2, 1000, 3)))
    near = np.ones_like(flash)
    near[1, :, 0] = 1.2
    like_flash, steady = Places(flash, np.stack([near, 0.01 * flash])), np.zeros(2)

    found = like_flash.fit([0], steady, 0.4)

    assert -0.4 < found[0] < -0.1
    assert like_flash.height(found) > 1.15 * like_flash.height(steady)
    assert _told(like_flash) is None


def test_two_lamps_may_have_changed() -> None:
    """Each lights one place of half of the pairs alone."""
    paint = np.random.default_rng(4).uniform(0.5, 0.9, (2, 80, 3))
    paint[1] = paint[0]
    warm, cool = np.zeros((2, 2, 80, 3))
    warm[1, :40], cool[1, 40:] = paint[1, :40] * [1.0, 0.6, 0.3], paint[1, 40:] * [0.3, 0.6, 1.0]

    found = _told(Places(paint + 0.2 * warm - 0.1 * cool, np.stack([warm, cool])))

    assert found is not None
    np.testing.assert_allclose(found, (0.2, -0.1), atol=1e-3)


def test_a_change_is_refined_of_the_lamps_that_changed_alone() -> None:
    found = _refined(places(0.2, 50), np.array([0.17, 0.0]))

    np.testing.assert_allclose(found, (0.2, 0.0), atol=1e-3)
    assert found[1] == 0.0
    assert np.abs(_refined(places(0.9, 50), np.array([0.35, 0.0]))).max() <= 0.4


def test_pairs_of_which_nothing_would_be_left_do_not_draw() -> None:
    right = places(0.2, 40)
    dim = np.concatenate([right.flash, np.full_like(right.flash, 1e-3)], axis=1)

    both = Places(dim, np.concatenate([right.light] * 2, axis=2))
    found = _refined(both, np.array([0.17, 0.0]))

    np.testing.assert_allclose(found, (0.2, 0.0), atol=1e-3)
