from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.matrixfit.evidence import Evidence, gather_evidence
from tests.reduced_pairs import HEIGHT, WIDTH, even, left_and_right, reduced_pair

LAMP, REST = np.array([0.3, 0.2, 0.1]), np.array([0.2, 0.3, 0.3])
ACROSS = np.arange(WIDTH, dtype=float)[None, :, None] * np.ones((HEIGHT, 1, 1))
MIDDLE = WIDTH // 2


def falling(towards: float = MIDDLE) -> Floats64:
    """What a lamp gives a surface that turns away from it, nothing from a column on: (H, W, 1)."""
    return np.maximum(towards - ACROSS, 0.0) / MIDDLE


def rising() -> Floats64:
    """What another lamp gives it meanwhile: ever more, evenly bent."""
    return 0.6 + 0.3 * ACROSS / WIDTH + 0.1 * (ACROSS / WIDTH) ** 2


def shown(light: Floats64, flash: Floats64 | None = None, **more: Any) -> Evidence:
    lit = even(0.5, 0.5, 0.5) if flash is None else flash
    return gather_evidence(reduced_pair(light * lit / 0.5, lit, **more, flash_only=True))


def test_terminators_are_the_lamp_that_begins() -> None:
    """On grey, the other lamp shines on both sides, bent as much as no lamp is that goes on."""
    evidence = shown(LAMP * falling() + REST * rising())

    found = evidence.terminators
    assert evidence.terminator_share == pytest.approx(len(found) / (HEIGHT * WIDTH))
    # at least a column, but for where oblique steps reach beyond the picture
    assert len(found) >= HEIGHT - 6
    np.testing.assert_allclose(found.x, np.full((len(found), 3), 1 / 3))
    np.testing.assert_allclose(found.u, np.tile(LAMP[:2] / 0.6, (len(found), 1)), atol=1e-9)
    assert found.weight.sum() == pytest.approx(250 * len(found) / 600)


def test_light_that_is_bent_evenly_is_no_terminator() -> None:
    assert not len(shown(LAMP * rising() ** 3 + REST * rising()).terminators)


@pytest.mark.parametrize("sign", [1, -1])
def test_an_edge_is_no_terminator(sign: int) -> None:
    step = left_and_right(even(*LAMP), np.zeros((HEIGHT, WIDTH, 3)))[:, ::sign]

    found = shown(step + REST)

    assert len(found.differences)
    assert not len(found.terminators)


def test_light_that_bends_down_is_no_terminator() -> None:
    """No lamp gives less and less until it gives its most."""
    assert not len(shown(LAMP * (1 - falling()) + REST).terminators)


@pytest.mark.parametrize(("other", "some"), [((0.5, 0.5, 0.5), True), ((0.55, 0.5, 0.45), False)])
def test_terminators_are_of_one_surface(other: tuple[float, float, float], some: bool) -> None:
    flash = left_and_right(even(0.5, 0.5, 0.5), even(*other))

    assert bool(len(shown(LAMP * falling() + REST, flash).terminators)) is some


def test_terminators_where_something_is_not_usable_are_left_out() -> None:
    usable = np.ones((HEIGHT, WIDTH), np.bool_)
    usable[:, MIDDLE + 1] = False

    assert not len(shown(LAMP * falling() + REST, usable=usable).terminators)


@pytest.mark.parametrize(("strength", "some"), [(1.0, True), (0.1, False)])
def test_terminators_are_bends_of_some_size(strength: float, some: bool) -> None:
    """A lamp of 0.6 that falls by 1/40 a pixel beside a light of 0.8; 0.01 of the mean is asked."""
    assert bool(len(shown(strength * LAMP * falling() + REST).terminators)) is some


@pytest.mark.parametrize(("noise", "some"), [(1e-4, True), (1e-2, False)])
def test_terminators_stand_out_from_noise(noise: float, some: bool) -> None:
    """A bend of 0.01 relative to the flash, of seven places with noise each."""
    light = LAMP * falling() + REST

    assert bool(len(shown(light, no_flash_variance=noise**2).terminators)) is some


def test_few_terminators_are_chance() -> None:
    """One row of eighty columns, of 3,200 pixels, has one or two."""
    light = np.broadcast_to(REST, (HEIGHT, WIDTH, 3)).copy()
    light[:1] += (LAMP * falling())[:1]

    evidence = shown(light)

    assert not len(evidence.terminators)
    assert evidence.terminator_share == 0


def test_a_picture_smaller_than_a_terminator_has_none() -> None:
    light = np.ones((5, 6, 3)) * REST

    found = gather_evidence(reduced_pair(light, np.full((5, 6, 3), 0.5), flash_only=True))

    assert not len(found.terminators)


@pytest.mark.parametrize("rows", [0, 1, 6, 30])
def test_terminators_are_not_asked_where_shadows_have_edges(rows: int) -> None:
    """A shadow beside the middle in some rows, a terminator in all."""
    light = LAMP * falling() + REST * np.ones((HEIGHT, WIDTH, 1))
    light[:rows, : MIDDLE // 2] += LAMP

    evidence = shown(light)

    assert evidence.has_edges is (rows > 0)
    assert bool(len(evidence.terminators)) is (rows == 0)
    assert (evidence.terminator_share > 0) is (rows == 0)
