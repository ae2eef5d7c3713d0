from __future__ import annotations

from pathlib import Path

from pipeline.calibration.kept_calibrations import Kept
from pipeline.taken_with import TakenWith
from service.workers import kept_file


def test_what_is_written_is_read(tmp_path: Path) -> None:
    one = Kept(
        kind="flash",
        setup="default",
        name="a",
        made="2001-09-09T01:46:45+00:00",
        taken_with=TakenWith(model="D5100", body="0123456789ab"),
        content="wavelength_nm,power\n400,1\n",
    )
    kept_file.write(tmp_path, [one])
    assert kept_file.read(tmp_path) == [one]


def test_without_any_there_is_no_file(tmp_path: Path) -> None:
    kept_file.write(tmp_path, [])
    assert list(tmp_path.iterdir()) == []
    assert kept_file.read(tmp_path) == []
