from __future__ import annotations

import cv2
import numpy as np
import pytest

from pipeline.images.area_means import area_means, size_within
from pipeline.images.coded_image import TableImage

TABLE = np.square(np.linspace(0, 1, 256, dtype=np.float32))


@pytest.mark.parametrize("size", [(40, 30), (64, 40), (50, 37), (160, 592), (1, 1)])
@pytest.mark.parametrize("crop", [None, (160, 592)])
def test_code_values_give_the_means_of_their_light(
    size: tuple[int, int], crop: tuple[int, int] | None
) -> None:
    codes = np.random.default_rng(4).integers(0, 256, (600, 161, 3), np.uint8)
    light = TABLE[codes]
    width, height = crop or (161, 600)
    expected = cv2.resize(light[:height, :width], size, interpolation=cv2.INTER_AREA)

    for photograph in (light, TableImage(codes, TABLE)):
        found = area_means(photograph, size, crop)

        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_blocks_become_their_means() -> None:
    codes = np.repeat(np.repeat(np.arange(6, dtype=np.uint8).reshape(2, 3), 4, 0), 4, 1)
    photograph = TableImage(np.stack([codes] * 3, axis=-1), TABLE)

    means = area_means(photograph, (3, 2))

    np.testing.assert_allclose(means[..., 1], TABLE[:6].reshape(2, 3), rtol=1e-6)


@pytest.mark.parametrize(
    ("size", "longest", "expected"),
    [
        ((600, 400), 300, (300, 200)),
        ((400, 600), 300, (200, 300)),
        ((300, 200), 300, (300, 200)),
        ((30, 20), 300, (30, 20)),
        ((1001, 500), 100, (100, 50)),
        ((9000, 2), 400, (400, 1)),
    ],
)
def test_sizes_keep_their_shape_and_grow_never(
    size: tuple[int, int], longest: int, expected: tuple[int, int]
) -> None:
    assert size_within(size, longest) == expected
