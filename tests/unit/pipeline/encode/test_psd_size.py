from __future__ import annotations

import pytest

from pipeline.encode.psd_size import check_psd_size, psd_excess
from pipeline.errors import OptionError

ROOM = 2**31 - 2**20


@pytest.mark.parametrize(
    ("size", "lamps", "fits"),
    [
        ((30_000, 10), 1, True),
        ((30_001, 1), 1, False),
        ((1, 30_001), 1, False),
        # of 6 bytes a pixel, in each layer and in the photograph
        ((ROOM // (6 * 2 * 10_000), 10_000), 1, True),
        ((ROOM // (6 * 2 * 10_000) + 1, 10_000), 1, False),
        ((ROOM // (6 * 4 * 10_000), 10_000), 3, True),
        ((ROOM // (6 * 4 * 10_000) + 1, 10_000), 3, False),
    ],
)
def test_a_photoshop_file_ends_at_its_sides_and_bytes(
    size: tuple[int, int], lamps: int, fits: bool
) -> None:
    assert (psd_excess(size, lamps) is None) == fits


@pytest.mark.parametrize(("lamps", "layers"), [(1, "a layer"), (3, "3 layers")])
def test_what_it_does_not_hold_is_told_and_to_be_left_out(lamps: int, layers: str) -> None:
    check_psd_size((6000, 4000), lamps)
    with pytest.raises(OptionError) as told:
        check_psd_size((30_001, 4000), lamps)
    assert str(told.value) == (
        f"layers.psd cannot hold {layers} of 30001 × 4000 pixels, as the format ends at "
        "30,000 pixels a side and 2 GB; leave it out of the outputs."
    )
