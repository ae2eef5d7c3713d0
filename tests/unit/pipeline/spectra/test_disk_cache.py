from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import pipeline
from pipeline.arrays import Floats64
from pipeline.spectra.disk_cache import cached_on_disk

Make = Callable[[int], Floats64]
CALLS: list[int] = []


@pytest.fixture
def table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """A table that is cached in a folder of its own, and notes in CALLS when it is made."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "compiled"))
    CALLS.clear()

    @cached_on_disk
    def ramp(length: int) -> Floats64:
        CALLS.append(length)
        return np.arange(length) / 3

    return ramp


def test_a_table_is_made_once_and_read_afterwards(table: Make) -> None:
    first, second = table(5), table(5)

    np.testing.assert_array_equal(first, np.arange(5) / 3)
    np.testing.assert_array_equal(first, second)
    assert CALLS == [5]
    assert not first.flags.writeable and not second.flags.writeable


def test_arguments_have_tables_of_their_own(table: Make) -> None:
    assert [len(table(length)) for length in (5, 7, 5)] == [5, 7, 5]
    assert CALLS == [5, 7]


def test_a_table_of_another_version_is_made_anew(
    table: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    table(5)
    monkeypatch.setattr("pipeline.spectra.disk_cache._stamp", lambda *_: "another")

    table(5)
    table(5)

    assert CALLS == [5, 5]


def test_a_table_of_other_modules_is_made_anew(tmp_path: Path) -> None:
    """A table follows from the wavelengths, too, which is in another module than what makes it."""
    shutil.copytree(Path(pipeline.__file__).parent, tmp_path / "pipeline")
    code = "from pipeline.spectra.observer import cie_1931; print(cie_1931().shape[1])"
    kept_in = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def count() -> int:
        run = [sys.executable, "-c", code]  # which imports from where it runs
        done = subprocess.run(run, cwd=tmp_path, env=kept_in, capture_output=True, check=True)
        return int(done.stdout)

    assert [count(), count()] == [81, 81]
    wavelengths = tmp_path / "pipeline" / "spectra" / "wavelengths.py"
    wavelengths.write_text(wavelengths.read_text().replace("781.0", "756.0"))
    assert count() == 76


@pytest.mark.parametrize("damage", [b"", b"PK\3\4 no archive", b"nothing"])
def test_a_damaged_file_is_made_anew(table: Make, tmp_path: Path, damage: bytes) -> None:
    table(5)
    (file,) = (tmp_path / "compiled").iterdir()
    file.write_bytes(damage)

    np.testing.assert_array_equal(table(5), np.arange(5) / 3)
    assert CALLS == [5, 5]


def test_who_may_not_write_the_file_may_read_it(table: Make, tmp_path: Path) -> None:
    table(5)
    (file,) = (tmp_path / "compiled").iterdir()
    assert file.stat().st_mode & 0o777 == 0o644


def test_without_a_folder_it_is_made_each_time(table: Make, tmp_path: Path) -> None:
    (tmp_path / "compiled").touch()  # no folder

    assert len(table(5)) == len(table(5)) == 5
    assert CALLS == [5, 5]


def test_names_are_cached_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    @cached_on_disk
    def names() -> NDArray[np.str_]:
        return np.array(["60 A/W", "D65"])

    assert names().tolist() == names().tolist() == ["60 A/W", "D65"]


def test_what_jobs_look_up_does_without_colour_science_once_made() -> None:
    code = (
        "import sys; from pipeline.spectra import cameras, families, lights;"
        "cameras.srgb_stand_in(); lights.lamp_spectra(); families.family_spectra();"
        "print('colour' in sys.modules)"
    )
    said = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert said[1].stdout.split() == ["False"]
