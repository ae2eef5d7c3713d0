from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.images.coded_image import TableImage
from pipeline.images.frames import (
    Exposure,
    Frame,
    by_planes,
    channels_first,
    planes_of,
    rows_by_planes,
)


@pytest.mark.parametrize(
    ("one", "other", "ratio"),
    [
        (Exposure(0.5, 400, 2), Exposure(0.25, 100, 4), 32),
        (Exposure(0.5, 400), Exposure(0.25, 100), 8),
        (Exposure(0.5, None, 2), Exposure(0.25, None, 4), 8),
        (Exposure(0.5), Exposure(0.25), 2),
        (Exposure(0.5, 400, 0.0), Exposure(0.25, 100, None), 8),
        (Exposure(), Exposure(), None),
        (Exposure(None, 100, 2), Exposure(None, 100, 2), None),
        (Exposure(0.5, 100, 2), Exposure(None, 100, 2), None),
        (Exposure(0.0, 100, 2), Exposure(0.5, 100, 2), None),
        (Exposure(0.5, 100, 2), Exposure(0.5, 100), None),
        (Exposure(0.5, None, 2), Exposure(0.5, 100, 2), None),
    ],
)
def test_exposures_are_compared_by_what_both_know(
    one: Exposure, other: Exposure, ratio: float | None
) -> None:
    back = None if ratio is None else 1 / ratio

    assert one.times(other) == pytest.approx(ratio)
    assert other.times(one) == pytest.approx(back)


def test_size_is_width_and_height(frame: Callable[..., Frame]) -> None:
    assert frame(np.zeros((20, 30, 3))).size == (30, 20)


def test_facts_are_the_frame_without_the_memory_of_its_pixels(
    frame: Callable[..., Frame],
) -> None:
    given = frame(np.full((20, 30, 3), 0.5), make="Nikon")

    facts = given.facts()

    assert (facts.size, facts.make, facts.sha256) == ((30, 20), "Nikon", given.sha256)
    assert not np.shares_memory(facts.pixels[:], given.pixels[:])
    assert facts.pixels[:].strides == (0, 0, 0)
    assert facts.saturated.strides == (0, 0)


def test_an_image_by_planes_is_an_image_of_contiguous_channels() -> None:
    layers = by_planes(2, 5, 7, 3)

    assert layers.shape == (2, 5, 7, 3)
    assert layers.dtype == np.float32
    for plane in planes_of(layers[1]):
        assert plane.shape == (5, 7)
        assert plane.flags.c_contiguous


def test_planes_of_an_image_by_planes_are_its_own_memory() -> None:
    """What loops write into them is in the image."""
    layers = by_planes(2, 5, 7, 3)
    layers[...] = 0
    for k, plane in enumerate(planes_of(layers[1])):
        plane[2, 3] = k + 1

    np.testing.assert_array_equal(layers[1, 2, 3], [1, 2, 3])
    assert layers.sum() == 6
    first = channels_first(layers)
    first[0, 2, 4, 6] = 5
    assert first.shape == (2, 3, 5, 7)
    assert layers[0, 4, 6, 2] == 5


def test_rows_of_an_image_by_planes_are_its_own_memory_too() -> None:
    image = by_planes(9, 7, 3)
    image[...] = 0

    planes_of(image[2:5])[1][0, 6] = 4

    assert image[2, 6, 1] == 4


def test_planes_of_other_images_are_copies_with_the_same_values() -> None:
    image = np.random.default_rng(1).uniform(size=(4, 6, 3)).astype(np.float32)

    planes = planes_of(image)

    np.testing.assert_array_equal(np.stack(planes, axis=-1), image)
    np.testing.assert_array_equal(channels_first(image), np.stack(planes))
    assert not any(np.shares_memory(plane, image) for plane in planes)
    assert all(plane.flags.c_contiguous for plane in planes)


@pytest.mark.parametrize("coded", [False, True], ids=["linear", "code values"])
def test_rows_by_planes_are_a_copy_of_contiguous_channels(coded: bool) -> None:
    codes = np.random.default_rng(1).integers(0, 256, (9, 7, 3), dtype=np.uint8)
    table = np.linspace(0, 1, 256, dtype=np.float32)
    image = table[codes]

    rows = rows_by_planes(TableImage(codes, table) if coded else image, slice(2, 6))

    np.testing.assert_array_equal(rows, image[2:6])
    assert np.shares_memory(rows, planes_of(rows)[1])
    assert not np.shares_memory(rows, image)


def test_rows_of_an_image_by_planes_stay_by_planes() -> None:
    image = by_planes(9, 7, 3)
    image[...] = np.random.default_rng(1).uniform(size=image.shape)

    rows = rows_by_planes(image, slice(2, 6))

    np.testing.assert_array_equal(rows, image[2:6])
    assert np.shares_memory(rows, planes_of(rows)[1])


@pytest.mark.parametrize(
    ("encoding", "profiled", "undeclared"),
    [
        ("linear", False, True),
        ("linear", True, False),
        ("raw", False, False),
        ("srgb", False, False),
    ],
)
def test_linear_values_without_a_profile_are_undeclared(
    frame: Callable[..., Frame], encoding: str, profiled: bool, undeclared: bool
) -> None:
    found = frame(np.zeros((2, 2, 3)), encoding=encoding, profiled=profiled)

    assert found.undeclared == undeclared
    assert found.in_colour_space == (profiled or encoding == "srgb")
