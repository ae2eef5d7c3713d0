from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from pipeline.encode import exr_rows
from pipeline.encode.exr import ExrFile, write_exr
from pipeline.encode.exr_rows import ScanLines
from pipeline.errors import InputError

NAMES = ["lamp1.R", "lamp1.G", "lamp1.B", "lamp2.R", "lamp2.G", "lamp2.B"]


def reader(data: bytes) -> Callable[[int, int], bytes]:
    return lambda start, end: data[start:end]


@pytest.fixture(params=[True, False], ids=["16 bits", "32 bits"])
def half(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture
def layers(tmp_path: Path, half: bool) -> tuple[Path, np.ndarray]:
    random = np.random.default_rng(1)
    pictures = random.uniform(-0.1, 1, (2, 31, 47, 3)).astype(np.float32)
    path = tmp_path / "layers.exr"
    file = ExrFile(path, (47, 31), half)
    file.write({"lamp1": pictures[0], "lamp2": pictures[1], "RGB": pictures.sum(0)})
    file.close()
    return path, pictures


@pytest.mark.parametrize("area", [(0, 0, 47, 31), (5, 7, 11, 13), (46, 30, 1, 1)])
def test_an_area_is_that_of_the_layers(
    layers: tuple[Path, np.ndarray], area: tuple[int, int, int, int]
) -> None:
    path, pictures = layers
    left, top, width, height = area
    lines = ScanLines(reader(path.read_bytes()))
    assert (lines.width, lines.height) == (47, 31)
    found = lines.area(NAMES, *area).reshape(2, 3, height, width)
    part = pictures[:, top : top + height, left : left + width]
    np.testing.assert_array_equal(found, np.moveaxis(part, -1, 1).astype(np.float16))


@pytest.mark.parametrize("at_once", [1, 5000])
def test_an_area_is_the_same_in_pieces(
    layers: tuple[Path, np.ndarray], monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    lines = ScanLines(reader(layers[0].read_bytes()))
    whole = lines.area(NAMES, 5, 7, 11, 13)

    monkeypatch.setattr(exr_rows, "_AT_ONCE", at_once)

    np.testing.assert_array_equal(lines.area(NAMES, 5, 7, 11, 13), whole)


def test_only_the_lines_of_an_area_are_read(layers: tuple[Path, np.ndarray], half: bool) -> None:
    data = layers[0].read_bytes()
    read: list[int] = []

    def count(start: int, end: int) -> bytes:
        read.append(end - start)
        return data[start:end]

    lines = ScanLines(count)
    read.clear()
    lines.area(NAMES, 3, 9, 4, 2)
    assert sum(read) == 2 * (8 + (2 if half else 4) * 47 * 9)


def test_light_beyond_16_bits_is_cut_off(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"lamp1": np.full((2, 2, 3), 1e6, np.float32)})
    found = ScanLines(reader((tmp_path / "a.exr").read_bytes())).area(NAMES[:3], 0, 0, 2, 2)
    assert found.max() == 65504


def test_other_files_are_refused(tmp_path: Path) -> None:
    plane = np.zeros((4, 4), np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"lamp1.R": plane}).write(str(tmp_path / "zip.exr"))
    mixed = {"lamp1.R": plane, "lamp1.G": plane.astype(np.float16)}
    plain = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(plain, mixed).write(str(tmp_path / "mixed.exr"))
    OpenEXR.File(plain, {"lamp1.R": plane.astype(np.uint32)}).write(str(tmp_path / "whole.exr"))
    for name, words in (("zip", "compressed"), ("mixed", "no EXR"), ("whole", "no EXR")):
        with pytest.raises(InputError, match=words):
            ScanLines(reader((tmp_path / f"{name}.exr").read_bytes()))
    for data in (b"", b"layers", b"\x76\x2f\x31\x01\x02\0\0\0name"):
        with pytest.raises(InputError, match="no EXR"):
            ScanLines(reader(data))
