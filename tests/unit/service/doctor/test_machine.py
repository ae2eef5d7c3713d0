from __future__ import annotations

import resource
import shutil
import sys
from pathlib import Path

import pytest

from pipeline import compiling
from service.doctor.finding import Finding
from service.settings import MIB, Settings
from tests.unit.service.findings import Look


def test_a_folder_that_is_a_file_is_told(look: Look, settings: Settings) -> None:
    settings.data_dir.write_text("no folder")
    found = look()["data_dir"]
    assert (found.grade, "LIGHTLAYERS_DATA_DIR" in found.sentence) == ("wrong", True)


def test_a_folder_that_cannot_be_looked_at_is_told_with_the_rest(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_DATA_DIR", str(tmp_path / ("x" * 300)))  # even by root
    found = look()
    assert {part for part, finding in found.items() if finding.grade == "wrong"} == {
        "data_dir",
        "database",
        "store",
    }
    assert "LIGHTLAYERS_DATA_DIR" in found["data_dir"].sentence
    assert found["disk"].sentence.endswith(f"free at {tmp_path}.")
    assert found["port"].grade == "ok"


def test_a_folder_that_others_may_read_is_told(look: Look, settings: Settings) -> None:
    settings.data_dir.mkdir(mode=0o755)
    assert look()["data_dir"].grade == "note"
    settings.data_dir.chmod(0o700)
    assert look()["data_dir"].grade == "ok"


def _disks(look: Look) -> dict[str, str | None]:
    found = look()
    return {part: found[part].grade if part in found else None for part in ("disk", "store's disk")}


def test_a_full_disk_is_told_of_the_store_as_of_where_requests_are_received(
    look: Look, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = {tmp_path / "data": 5 * MIB, tmp_path / "elsewhere": 500}
    monkeypatch.setenv("LIGHTLAYERS_STORE_URL", (tmp_path / "elsewhere").as_uri())
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "400")
    usage = shutil.disk_usage("/")
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage._replace(free=free[path]))
    assert _disks(look) == {"disk": "ok", "store's disk": "ok"}
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "600")
    assert _disks(look) == {"disk": "ok", "store's disk": "wrong"}
    assert "new jobs are refused" in look()["store's disk"].sentence
    monkeypatch.setenv("LIGHTLAYERS_UPLOAD_BYTES", str(6 * MIB))
    monkeypatch.setenv("LIGHTLAYERS_FREE_BYTES", "400")
    assert _disks(look) == {"disk": "note", "store's disk": "ok"}
    assert "large requests" in look()["disk"].sentence


def test_memory_that_a_job_may_not_have_is_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LIGHTLAYERS_JOB_MEMORY_BYTES", str(2**50))
    assert look()["memory"].grade == "note"
    limits = resource.RLIM_INFINITY, 2**40
    monkeypatch.setattr("service.doctor.machine.resource.getrlimit", lambda _what: limits)
    assert look()["memory"].grade == "wrong"


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (("max\n", None), "64.0 GiB for 1 job"),
        ((f"{3 * 2**30}\n", None), "3.0 GiB for 1 job"),
        ((None, f"{2 * 2**30}\n"), "2.0 GiB for 1 job"),
        ((None, "9223372036854771712\n"), "64.0 GiB for 1 job"),
        ((None, None), "64.0 GiB for 1 job"),
    ],
)
def test_the_memory_of_a_container_is_its_own(
    texts: tuple[str | None, str | None],
    said: str,
    look: Look,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By control groups of version 2, and of version 1."""
    limits = tuple(tmp_path / name for name in ("memory.max", "memory.limit_in_bytes"))
    for limit, text in zip(limits, texts, strict=True):
        if text is not None:
            limit.write_text(text)
    sizes = {"SC_PHYS_PAGES": 2**24, "SC_PAGE_SIZE": 2**12}
    monkeypatch.setattr("service.doctor.machine.os.sysconf", sizes.__getitem__)
    monkeypatch.setattr("service.doctor.machine._MEMORY_LIMITS", limits)
    assert look()["memory"].sentence.startswith(said)


def test_too_few_files_are_told(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.doctor.machine.resource.getrlimit", lambda _what: (256, -1))
    assert look()["ulimits"].grade == "wrong"


def test_files_that_a_job_may_not_have_are_told(
    look: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.doctor.machine.resource.getrlimit", lambda _what: (1024, 4096))
    monkeypatch.setenv("LIGHTLAYERS_JOB_OPEN_FILES", "4096")
    assert look()["ulimits"] == Finding("ok", "ulimits", "ulimit -n is 1024.")
    monkeypatch.setenv("LIGHTLAYERS_JOB_OPEN_FILES", "4097")
    found = look()["ulimits"]
    assert found.grade == "wrong"
    assert found.sentence.startswith("ulimit -Hn allows 4096 files, fewer than LIGHTLAYERS_JOB_")


@pytest.mark.parametrize(
    ("filled", "unwritable", "grade", "words"),
    [
        (True, None, "ok", "in /compiled/pipeline."),
        (True, Path("/compiled"), "ok", "they are compiled; /compiled cannot be written"),
        (False, None, "note", f"run `{sys.executable} -m service.compile`."),
        (False, Path("/compiled"), "wrong", "each process compiles them anew"),
    ],
)
def test_whether_kernels_are_compiled_is_told(
    filled: bool,
    unwritable: Path | None,
    grade: str,
    words: str,
    look: Look,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cache = compiling.Cache(Path("/compiled/pipeline"), unwritable)
    monkeypatch.setattr(compiling, "CACHE", cache)
    monkeypatch.setattr(compiling.Cache, "is_filled", lambda _self: filled)
    found = look()["kernels"]
    assert (found.grade, words in found.sentence) == (grade, True)
