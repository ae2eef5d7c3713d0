from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.images.frames import Frame, Matrix


@pytest.fixture
def frame_of() -> Callable[..., Frame]:
    """Build a frame of a camera whose pixels do not matter."""

    def build(
        make: str = "", model: str = "", encoding: str = "raw", matrix: Matrix | None = None
    ) -> Frame:
        return Frame(
            pixels=np.zeros((2, 2, 3), np.float32),
            saturated=np.zeros((2, 2), bool),
            encoding=encoding,
            sha256="",
            make=make,
            model=model,
            xyz_to_camera=matrix,
        )

    return build


@pytest.fixture
def ampas() -> bytes:
    """A camera in AMPAS JSON: three bells, the green one twice as high as the red one."""
    rows = {
        str(nm): [
            0.4 * float(np.exp(-(((nm - 600) / 40) ** 2))),
            0.8 * float(np.exp(-(((nm - 540) / 40) ** 2))),
            0.6 * float(np.exp(-(((nm - 460) / 40) ** 2))),
        ]
        for nm in range(380, 781, 5)
    }
    document = {
        "header": {"manufacturer": "Acme", "model": "One"},
        "spectral_data": {
            "units": "relative",
            "index": {"main": ["R", "G", "B"]},
            "data": {"main": rows},
        },
    }
    return json.dumps(document).encode()


@pytest.fixture
def spectra_folder(tmp_path: Path, ampas: bytes, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the user's own spectra: a camera, a camera in a subfolder, and a light."""
    (tmp_path / "Acme_One_380_780_5.json").write_bytes(ampas)
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "Canon_EOS_5D_Mark_II.csv").write_text(
        "wavelength_nm,R,G,B\n400,0,0.1,0.6\n500,0.2,1,0.4\n600,0.9,0.3,0\n700,0.1,0,0\n"
    )
    (tmp_path / "my_torch.csv").write_text("wavelength_nm,power\n400,1\n700,3\n")
    (tmp_path / "notes.txt").write_text("no spectrum")
    monkeypatch.setenv("LIGHTLAYERS_SPECTRA", str(tmp_path))
    return tmp_path
