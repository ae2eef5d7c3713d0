"""Pairs that were sent the wrong way round."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.errors import SwappedPairError
from pipeline.images.frames import Frame
from pipeline.pair.pair_checks import check_belonging
from tests.unit.pipeline.pair.pairs_of_frames import paired


def test_a_swapped_pair_is_told_by_the_exif(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()

    with pytest.raises(SwappedPairError, match=r"swap the two\.$"):
        paired((replace(after, flash_fired=True), replace(before, flash_fired=False)))


def test_a_swapped_pair_is_told_by_its_light(
    frames: Callable[..., tuple[Frame, Frame]],
) -> None:
    before, after = frames()

    with pytest.raises(
        SwappedPairError, match=r"^The photograph with the flash is darker than the one without"
    ):
        paired((after, before))


@pytest.mark.parametrize("reach", [0.1, 0.3, 0.5])
@pytest.mark.parametrize(
    ("ratio", "told"),
    [
        (None, "The photograph with the flash is darker than the one without it: swap the two"),
        (1.0, "With the exposure ratio given, 1, the photograph with the flash is darker than "),
    ],
)
def test_a_swapped_pair_is_told_by_its_light_however_far_the_flash_reaches(
    frames: Callable[..., tuple[Frame, Frame]], reach: float, ratio: float | None, told: str
) -> None:
    """Elsewhere the two differ by no more than their noise."""
    before, after = (np.array(one.pixels[:]) for one in frames())
    edge = round(reach * before.shape[1])
    grain = np.random.default_rng(8).normal(0, 0.002, before.shape).astype(np.float32)
    after[:, edge:] = (before + grain)[:, edge:]
    one, other = frames()
    swapped = replace(one, pixels=after), replace(other, pixels=before)

    with pytest.raises(SwappedPairError, match=f"^{told}"):
        paired(swapped, exposure_ratio=ratio, align=False)


@pytest.mark.parametrize(
    ("fired", "swapped"),
    [
        ((True, False), True),
        ((True, None), False),
        ((True, True), False),
        ((False, False), False),
        ((None, False), False),
    ],
)
def test_photographs_are_swapped_only_where_the_exif_says_both(
    frames: Callable[..., tuple[Frame, Frame]],
    fired: tuple[bool | None, bool | None],
    swapped: bool,
) -> None:
    both = [replace(one, flash_fired=told) for one, told in zip(frames(), fired, strict=True)]

    if swapped:
        with pytest.raises(SwappedPairError, match="swap the two"):
            check_belonging(both[0], both[1], False)
    else:
        check_belonging(both[0], both[1], False)
