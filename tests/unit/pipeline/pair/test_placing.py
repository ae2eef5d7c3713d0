from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats32
from pipeline.images.noise import Noise
from pipeline.pair.placing import HALO, mend_proportions, place_flash, placement
from tests.definitions import pixels

QUIET = Noise(np.zeros(3), np.zeros(3))
LOUD = Noise(np.full(3, 1e-3), np.full(3, 1e-5))


@pytest.fixture
def scene() -> dict[str, Floats32]:
    """Patches of paint; the flash part is some pixels' own, others' of the pixel beside."""
    rng = np.random.default_rng(3)
    paint = np.kron(rng.uniform(0.1, 0.9, (5, 6, 3)), np.ones((6, 7, 1)))
    light = paint * [0.9, 0.6, 0.3]
    flash = (paint + np.roll(paint, 1, axis=1)) * 0.25
    placed = np.where(np.ptp(np.stack([flash, paint / 2]), axis=0).max(axis=2) > 1e-6, 0.1, 1.0)
    return {
        "no_flash": light.astype(np.float32),
        "flash": flash.astype(np.float32),
        "truth": (paint / 2).astype(np.float32),
        "placed": placed.astype(np.float32),
        "confidence": rng.uniform(0.5, 1.0, placed.shape).astype(np.float32),
    }


def parts(scene: dict[str, Floats32], lamps: int) -> Floats32:
    """Proportions of lamps that hang on the paint alone."""
    shares = np.stack([np.roll(scene["truth"], k, axis=2) + 0.1 for k in range(lamps)])
    return np.asarray(shares / shares.sum(axis=0), np.float32)


def test_three_percent_of_the_flash_part_place_a_pixel_by_half() -> None:
    part = np.array([[1.0, 0.5, 2.0, 1.0]], np.float32)
    variance = np.array([[0.03**2, 0.015**2, 0.0, 0.09**2]], np.float32)

    np.testing.assert_allclose(placement(part, variance), [[0.5, 0.5, 1.0, 0.1]], rtol=1e-5)


@pytest.mark.parametrize("part", [0.0, -1.0])
def test_no_flash_part_is_not_placed(part: float) -> None:
    part_, variance = np.full((2, 2), part, np.float32), np.full((2, 2), 1e-6, np.float32)

    np.testing.assert_array_equal(placement(part_, variance), np.zeros((2, 2)))


def test_the_flash_gets_the_edges_of_the_other_photograph(scene: dict[str, Floats32]) -> None:
    found = place_flash(scene["no_flash"], scene["flash"], scene["placed"], scene["confidence"])

    badly = scene["placed"] < 0.5
    before, after = (
        np.abs(flash - scene["truth"])[badly].mean() for flash in (scene["flash"], found)
    )
    assert after < 0.35 * before
    np.testing.assert_array_equal(found[~badly], scene["flash"][~badly])


def test_the_regression_is_as_defined(scene: dict[str, Floats32]) -> None:
    random = np.random.default_rng(5).uniform(0, 1, scene["placed"].shape)
    scene["placed"] = random.astype(np.float32)
    scene["confidence"][:, :3] = 0.0
    given = scene["no_flash"], scene["flash"], scene["placed"], scene["confidence"]

    np.testing.assert_allclose(place_flash(*given), pixels.place_flash(*given), atol=2e-6)


def test_a_black_picture_stays_black() -> None:
    black, none = np.zeros((6, 7, 3), np.float32), np.zeros((6, 7), np.float32)

    assert not place_flash(black, black, none, none).any()


def test_what_two_lamps_have_of_one_paint_they_have_beside_its_edge(
    scene: dict[str, Floats32],
) -> None:
    truth = parts(scene, 2)
    wrong = np.where(scene["placed"][..., None] < 0.5, truth[::-1], truth)

    mended, _ = mend_proportions(
        wrong,
        wrong,
        scene["no_flash"],
        QUIET,
        np.where(scene["placed"] < 0.5, 0.0, 1.0).astype(np.float32),
        scene["confidence"],
        slice(0, len(scene["placed"])),
    )

    assert np.abs(mended - truth).max() < 0.15 * np.abs(wrong - truth).max()
    np.testing.assert_allclose(mended.sum(axis=0), 1.0, atol=1e-5)


@pytest.mark.parametrize("lamps", [2, 3])
@pytest.mark.parametrize("noise", [QUIET, LOUD], ids=["quiet", "loud"])
def test_the_average_is_as_defined(scene: dict[str, Floats32], lamps: int, noise: Noise) -> None:
    rng = np.random.default_rng(7)
    placed, confidence = rng.uniform(0, 1, (2, *scene["placed"].shape)).astype(np.float32)
    given = rng.dirichlet(np.ones(lamps), (*placed.shape, 3)).transpose(3, 0, 1, 2)
    proportions = np.ascontiguousarray(given, np.float32)
    smooth = parts(scene, lamps)
    variance = noise.variance(scene["no_flash"]).sum(axis=2)
    wanted, wanted_trust = pixels.mend_proportions(
        smooth, proportions, scene["no_flash"], variance, placed, confidence
    )

    rows = slice(0, len(placed))
    found, trust = mend_proportions(
        smooth, proportions, scene["no_flash"], noise, placed, confidence, rows
    )

    np.testing.assert_allclose(found, wanted, atol=2e-6)
    np.testing.assert_allclose(trust, wanted_trust, atol=2e-6)


def test_pixels_without_a_flash_part_take_what_their_paint_has_beside_them(
    scene: dict[str, Floats32],
) -> None:
    truth = parts(scene, 2)
    border = np.zeros(scene["placed"].shape, bool)
    border[:, :3] = True
    wrong = np.where(border[..., None], truth[::-1], truth)
    everywhere = np.ones(border.shape, np.float32)
    unknown = np.where(border, 0.0, 0.9).astype(np.float32)

    mended, trust = mend_proportions(
        wrong, wrong, scene["no_flash"], QUIET, everywhere, unknown, slice(0, len(border))
    )

    assert np.abs(mended - truth).max() < 0.15 * np.abs(wrong - truth).max()
    np.testing.assert_array_equal(mended[:, ~border], truth[:, ~border])
    assert (trust[border] > 0.9).all()
    np.testing.assert_array_equal(trust[~border], unknown[~border])


def test_one_lamp_keeps_all(scene: dict[str, Floats32]) -> None:
    whole = np.ones((1, *scene["truth"].shape), np.float32)
    none = np.zeros_like(scene["placed"])

    found, _ = mend_proportions(
        whole, whole, scene["no_flash"], QUIET, none, none, slice(0, len(scene["placed"]))
    )

    np.testing.assert_array_equal(found, whole)


def test_where_no_neighbour_is_sure_proportions_stay(scene: dict[str, Floats32]) -> None:
    given, none = parts(scene, 2), np.zeros_like(scene["placed"])

    kept, trust = mend_proportions(
        given, given[::-1], scene["no_flash"], QUIET, none, none, slice(0, len(none))
    )

    np.testing.assert_array_equal(kept, given)
    assert not trust.any()


def test_rows_with_their_halo_are_as_the_whole(scene: dict[str, Floats32]) -> None:
    names = ("no_flash", "flash", "placed", "confidence")
    given = [scene[name] for name in names]
    whole = place_flash(*given)
    top, bottom = 12, 20
    wide = slice(top - HALO, bottom + HALO)
    part = place_flash(*(one[wide] for one in given))
    np.testing.assert_array_equal(part[HALO:-HALO], whole[top:bottom])

    proportions = parts(scene, 2)
    light, placed, confidence = scene["no_flash"], scene["placed"], scene["confidence"]
    all_rows, all_trust = mend_proportions(
        proportions, proportions, light, QUIET, placed, confidence, slice(0, len(placed))
    )
    some, some_trust = mend_proportions(
        proportions[:, top:bottom],
        proportions[:, wide],
        light[wide],
        QUIET,
        placed[wide],
        confidence[wide],
        slice(HALO, HALO + bottom - top),
    )
    np.testing.assert_array_equal(some, all_rows[:, top:bottom])
    np.testing.assert_array_equal(some_trust, all_trust[top:bottom])
