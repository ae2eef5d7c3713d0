from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from numba.core.registry import cpu_target

from pipeline import code_digest, compiling
from pipeline.compiling import exact, settle


def _double(number: int) -> int:
    return 2 * number


@pytest.fixture
def given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What NUMBA_CACHE_DIR names, with a compiled function."""
    monkeypatch.setattr(compiling._config, "CACHE_DIR", str(tmp_path / "given"))
    settle()
    assert exact(_double)(2) == 4
    monkeypatch.setattr(compiling._config, "CACHE_DIR", str(tmp_path / "given"))
    return tmp_path / "given"


@pytest.fixture
def at_exit(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What would be called at the end of the process."""
    called: list[tuple[Any, ...]] = []
    monkeypatch.setattr("atexit.register", lambda *call: called.append(call))
    return called


@pytest.fixture
def lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_exit: list[tuple[Any, ...]]
) -> Callable[[Path], None]:
    """Have a folder written no more, even by root."""
    assert at_exit == []
    (tmp_path / "own").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "own"))
    write = tempfile.TemporaryFile

    def lock(folder: Path) -> None:
        def refuse(dir: str) -> Any:
            if Path(dir).is_relative_to(folder):
                raise PermissionError(dir)
            return write(dir=dir)

        monkeypatch.setattr(tempfile, "TemporaryFile", refuse)

    return lock


def test_code_is_kept_in_the_folder_that_is_given(given: Path) -> None:
    cache = settle()
    assert cache.folder.parent == given
    assert cache.unwritable is None
    kernel: Any = exact(_double)
    assert kernel(3) == 6
    assert kernel.stats.cache_hits.total() == 1


def _asked(package: Path, **variables: str) -> tuple[int, Path]:
    """What the compiled function of a small package says, and the folder of its code."""
    code = "import pipeline.caller as called; print(called.answer(), called.CACHE.folder)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(package.parent), **variables},
        cwd=package.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    number, folder = done.stdout.split()
    return int(number), Path(folder)


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package whose one compiled function has a number of another module compiled in."""
    package = tmp_path / "pipeline"
    package.mkdir()
    (package / "__init__.py").touch()
    for module in (Path(compiling.__file__), Path(code_digest.__file__)):
        (package / module.name).write_bytes(module.read_bytes())
    (package / "callee.py").write_text("NUMBER = 42\n")
    (package / "caller.py").write_text(
        "from pipeline.callee import NUMBER\n"
        "from pipeline.compiling import CACHE, exact\n"
        "@exact\n"
        "def answer():\n"
        "    return NUMBER\n"
    )
    return package


@pytest.mark.parametrize("given", [True, False])
def test_code_that_another_module_is_compiled_into_notices_its_change(
    given: bool, package: Path
) -> None:
    home = package.parent / "given" if given else package / "__pycache__"
    variables = {"NUMBA_CACHE_DIR": str(home) if given else ""}
    number, folder = _asked(package, **variables)
    assert (number, folder.parent) == (42, home)
    assert _asked(package, **variables) == (42, folder)
    (package / "callee.py").write_text("NUMBER = 43\n")
    assert _asked(package, **variables)[0] == 43


def test_code_of_the_last_versions_is_kept_and_of_older_ones_removed(
    tmp_path: Path, given: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (own,) = given.iterdir()
    older = [given / f"code-{number}" for number in range(4)]
    for age, folder in enumerate(older):
        (folder / "pipeline").mkdir(parents=True)
        os.utime(folder, (1000 - age, 1000 - age))
    (given / "spectra.npz").touch()
    settle()
    assert set(given.iterdir()) == {own, *older, given / "spectra.npz"}
    own.rename(tmp_path / "gone")  # as if this version came now
    monkeypatch.setattr(compiling._config, "CACHE_DIR", str(given))
    settle()
    assert set(given.iterdir()) == {own, *older[:2], given / "spectra.npz"}


def test_what_may_only_be_read_is_read(
    given: Path,
    tmp_path: Path,
    lock: Callable[[Path], None],
    at_exit: list[tuple[Any, ...]],
) -> None:
    lock(given)
    cache = settle()
    assert cache.unwritable == given
    assert cache.folder.is_relative_to(tmp_path / "own")
    kernel: Any = exact(_double)
    assert kernel(3) == 6
    assert kernel.stats.cache_hits.total() == 1
    kept = {path: path.read_bytes() for path in given.rglob("*.nb?")}
    assert kernel(1.5) == 3  # compiled anew, for numbers of another kind
    assert kernel.stats.cache_misses.total() == 1
    assert {path: path.read_bytes() for path in given.rglob("*.nb?")} == kept
    ((remove, own, owner),) = at_exit
    remove(own, owner + 1)  # as in a fork
    assert own.exists()
    assert owner == os.getpid()
    remove(own, owner)
    assert list((tmp_path / "own").iterdir()) == []


def test_where_nothing_can_be_kept_code_is_compiled_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lock: Callable[[Path], None]
) -> None:
    monkeypatch.setattr(compiling._config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    lock(Path(compiling.__file__).parent)
    user = tmp_path / "user" / "numba"
    cache = settle()
    assert (cache.folder.is_relative_to(user), cache.unwritable) == (True, None)
    monkeypatch.setattr(compiling._config, "CACHE_DIR", "")
    (tmp_path / "user").rename(tmp_path / "gone")
    (tmp_path / "user").touch()  # no folder
    cache = settle()
    assert cache.folder.is_relative_to(tmp_path / "own")
    assert cache.unwritable == Path(compiling.__file__).with_name("__pycache__")


def test_code_of_another_processor_is_none(given: Path) -> None:
    cache = settle()
    assert cache.folder.parent == given
    assert cache.is_filled()
    (index,) = cache.folder.glob("*/*.nbi")
    processor = cpu_target.target_context.codegen().magic_tuple()[1].encode()
    index.write_bytes(index.read_bytes().replace(processor, b"8086"))
    assert not cache.is_filled()


@pytest.mark.parametrize("writable", [True, False])
def test_code_of_modules_in_any_folder_of_the_package_is_told(
    writable: bool, tmp_path: Path, lock: Callable[[Path], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compiling._config, "CACHE_DIR", str(tmp_path / "given"))
    assert not settle().is_filled()
    code = "import numpy as np; from pipeline.images.blocks import any_in_blocks as loop; "
    code += "loop(np.ones((4, 4), bool), 2)"
    subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "given")},
        check=True,
    )
    if not writable:
        lock(tmp_path / "given")
    monkeypatch.setattr(compiling._config, "CACHE_DIR", str(tmp_path / "given"))
    cache = settle()
    assert (cache.is_filled(), cache.unwritable is None) == (True, writable)


def test_a_module_with_loops_is_imported_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    nowhere = {"NUMBA_CACHE_DIR": str(tmp_path / "file"), "TMPDIR": str(tmp_path)}
    code = (
        "import pipeline.separation.smoothing, pipeline.compiling as c; print(c.CACHE.unwritable)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **nowhere},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == str(tmp_path / "file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_loops_load_no_linear_algebra_of_scipy_which_can_be_had_afterwards() -> None:
    program = (
        "import sys, numpy as np\n"
        "from pipeline import compiling\n"
        "from pipeline.images.blocks import any_in_blocks\n"
        "assert any_in_blocks(np.ones((4, 4), bool), 2).all()\n"
        "print('scipy.linalg' in sys.modules)\n"
        "import scipy.linalg\n"
        "print(scipy.linalg.norm([3.0, 4.0]))\n"
    )
    said = subprocess.check_output([sys.executable, "-c", program], text=True)

    assert said.split() == ["False", "5.0"]


def test_the_first_function_of_a_prepared_process_loads_no_module() -> None:
    """Of Numba; what else the function is made of is imported with it."""
    program = (
        "import sys, numpy as np\n"
        "from pipeline import compiling\n"
        "from pipeline.images.blocks import any_in_blocks\n"
        "{}\n"
        "known = set(sys.modules)\n"
        "assert any_in_blocks(np.ones((4, 4), bool), 2).all()\n"
        "print(len(set(sys.modules) - known))\n"
    )
    loaded = [
        int(subprocess.check_output([sys.executable, "-c", program.format(step)], text=True))
        for step in ("", "compiling.prepare()")
    ]

    assert loaded[0] > 0
    assert loaded[1] == 0
