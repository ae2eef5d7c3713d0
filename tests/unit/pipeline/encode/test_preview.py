from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.encode import preview
from pipeline.encode.preview import PreviewFile, preview_step, thumbnail
from pipeline.images.memory import empty_image, release_rows
from tests.layers import planes_of


@pytest.mark.parametrize(
    ("size", "step"),
    [((1, 1), 1), ((1920, 1080), 1), ((2048, 1024), 1), ((2048, 1025), 2), ((6000, 4000), 4)],
)
def test_a_preview_has_no_more_than_2_megapixels(size: tuple[int, int], step: int) -> None:
    assert preview_step(size) == step


@pytest.mark.parametrize("rows", [1, 5, 64])
def test_a_small_picture_is_kept_to_the_rounding_of_half_floats(tmp_path: Path, rows: int) -> None:
    layer = np.random.default_rng(1).uniform(-0.1, 3, (11, 7, 3)).astype(np.float32)
    file = PreviewFile(tmp_path / "p.exr", (7, 11))
    for top in range(0, 11, rows):
        file.write({"lamp1": layer[top : top + rows], "Y": layer[top : top + rows, :, 0]})
    file.close()

    found = planes_of((tmp_path / "p.exr").read_bytes())

    assert set(found) == {"lamp1.R", "lamp1.G", "lamp1.B", "Y"}
    assert {plane.dtype for plane in found.values()} == {np.dtype(np.float16)}
    for index, letter in enumerate("RGB"):
        np.testing.assert_array_equal(found[f"lamp1.{letter}"], layer[..., index].astype("f2"))


@pytest.mark.parametrize("rows", [1, 4, 64])
def test_a_large_one_becomes_the_means_of_squares(
    tmp_path: Path, rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preview, "PREVIEW_PIXELS", 20)
    plane = np.random.default_rng(1).uniform(0, 1, (13, 11)).astype(np.float32)
    file = PreviewFile(tmp_path / "p.exr", (11, 13))
    for top in range(0, 13, rows):
        file.write({"Y": plane[top : top + rows]})
    file.close()

    means = plane[:12, :9].reshape(4, 3, 3, 3).mean(axis=(1, 3))

    np.testing.assert_allclose(planes_of((tmp_path / "p.exr").read_bytes())["Y"], means, rtol=1e-3)


def test_a_thumbnail_is_at_most_400_pixels_long() -> None:
    assert thumbnail(np.zeros((300, 800, 3), np.float32)).shape == (150, 400, 3)
    assert thumbnail(np.zeros((2, 9000, 3), np.float32)).shape == (1, 400, 3)
    assert thumbnail(np.full((50, 40, 3), 0.5, np.float32)).shape == (50, 40, 3)


def test_a_small_thumbnail_outlasts_the_photograph() -> None:
    photograph = empty_image(384, 384, 3)
    photograph[:] = 0.5

    small = thumbnail(photograph)
    release_rows(photograph, 384)

    assert (small == 0.5).all()
