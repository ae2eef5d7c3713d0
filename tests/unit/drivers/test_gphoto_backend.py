"""A camera behind the process of libgphoto2, whose answers are made here."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.camera import CameraObject
from drivers.errors import TransferError
from drivers.gphoto.backend import GphotoCamera
from drivers.shot import fetch


class Answering(GphotoCamera):
    """A camera with one file, which is as long as it is when it is asked for."""

    def __init__(self, file: bytes) -> None:
        self.file = file

    def _call(self, method: str, *arguments: Any, patience_s: float = 0.0) -> Any:  # noqa: ARG002
        if method == "describe":
            return CameraObject(1, "jpeg", len(self.file), "DSC_1.JPG", "store_00010001")
        offset = arguments[1]
        return self.file[offset : offset + 4]


def test_a_file_is_fetched_chunk_by_chunk() -> None:
    camera = Answering(b"0123456789")
    assert fetch(camera, camera.describe(1)) == b"0123456789"


@pytest.mark.parametrize("size", [9, 11])
def test_a_file_whose_size_changes_is_no_photograph(size: int) -> None:
    camera = Answering(b"0123456789")
    described = camera.describe(1)
    camera.file = bytes(size)
    with pytest.raises(TransferError, match=f"says {size} bytes where it said 10 before"):
        fetch(camera, described)
