"""What the pipeline writes it also reads: results can be used as photographs again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from pipeline.arrays import Floats32
from pipeline.colour.spaces import XYZ_TO_REC2020, XYZ_TO_SRGB
from pipeline.decode import decode
from pipeline.encode.exr import write_exr
from pipeline.encode.jpeg import write_jpeg
from pipeline.encode.tiff import TiffFile
from tests.strips import size_of, write_by_strips


@pytest.fixture
def picture() -> Floats32:
    x, y = np.meshgrid(np.linspace(0.05, 0.9, 90), np.linspace(0.1, 1.0, 300))
    return np.stack([x, 0.8 * y, 0.5 * x * y + 0.1], axis=-1).astype(np.float32)


def test_layers_exr_is_read_as_its_sum(tmp_path: Path, picture: Floats32) -> None:
    planes = {name: picture[..., i] for i, name in enumerate("RGB")}
    lamps = {f"lamp1.{name}": 0.25 * plane for name, plane in planes.items()}
    write_exr(tmp_path / "layers.exr", {**planes, **lamps})

    np.testing.assert_array_equal(decode((tmp_path / "layers.exr").read_bytes()).pixels, picture)


def test_a_written_tiff_is_linear_and_leads_back_to_the_colours_of_srgb(
    tmp_path: Path, picture: Floats32
) -> None:
    to_rec2020 = XYZ_TO_REC2020 @ np.linalg.inv(XYZ_TO_SRGB)
    write_by_strips(TiffFile(tmp_path / "lamp1.tif", size_of(picture), to_rec2020), picture)

    frame = decode((tmp_path / "lamp1.tif").read_bytes())

    assert (frame.encoding, frame.profiled) == ("linear", True)
    np.testing.assert_allclose(frame.pixels, picture, atol=1e-4)


def test_an_8_bit_picture_in_rec2020_is_read_by_its_profile(
    tmp_path: Path, picture: Floats32
) -> None:
    """The profile of a written TIFF, on 8-bit values, leads back to the colours of sRGB."""
    to_rec2020 = XYZ_TO_REC2020 @ np.linalg.inv(XYZ_TO_SRGB)
    write_by_strips(TiffFile(tmp_path / "a.tif", size_of(picture), to_rec2020), picture)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        values, profile = file.pages.first.asarray(), file.pages.first.iccprofile
    tifffile.imwrite(
        tmp_path / "b.tif",
        np.round(values / 257).astype(np.uint8),
        photometric="rgb",
        iccprofile=profile,
    )

    np.testing.assert_allclose(
        decode((tmp_path / "b.tif").read_bytes()).pixels, picture, atol=0.006
    )


def test_a_written_jpeg_is_srgb(tmp_path: Path, picture: Floats32) -> None:
    write_jpeg(tmp_path / "lamp1.jpg", picture)

    frame = decode((tmp_path / "lamp1.jpg").read_bytes())

    assert frame.encoding == "srgb"
    assert np.abs(frame.pixels - picture).mean() < 0.005
