"""The script that installs packages, with a system beside it that has only some."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

_SCRIPT = Path(__file__).parents[3] / ".ci" / "apt-install"
_APT_GET = """#!/bin/sh
echo "$*" >> "$SAID"
case " $* " in *" unknown"*) echo "E: Unable to locate package" >&2; exit 100;; esac
"""


@pytest.fixture
def system(tmp_path: Path) -> Path:
    """A folder of programs: apt-get, which knows no package `unknown…`, and a user that is root."""
    for name, text in {"apt-get": _APT_GET, "id": "#!/bin/sh\necho 0\n"}.items():
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o700)
    return tmp_path


def _install(system: Path, *packages: str) -> tuple[subprocess.CompletedProcess[str], list[str]]:
    """What came of the script, and what apt-get was told to change."""
    path = f"{system}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "SAID": str(system / "said")}
    done = subprocess.run(
        ["sh", _SCRIPT, *packages], env=environment, capture_output=True, text=True, check=False
    )
    said = (system / "said").read_text().splitlines()
    return done, [line for line in said if "--simulate" not in line]


def test_unknown_packages_are_named_and_the_others_installed(system: Path) -> None:
    done, changes = _install(system, "one", "unknown-a", "two", "unknown-b")
    assert changes == ["update -q", "install -q -y --no-install-recommends one two"]
    assert done.returncode == 1
    assert "Missing: unknown-a unknown-b." in done.stderr


def test_known_packages_are_installed_at_once(system: Path) -> None:
    done, changes = _install(system, "one", "two")
    assert changes == ["update -q", "install -q -y --no-install-recommends one two"]
    assert (done.returncode, done.stderr) == (0, "")


def test_nothing_is_installed_where_all_are_unknown(system: Path) -> None:
    done, changes = _install(system, "unknown")
    assert changes == ["update -q"]
    assert done.returncode == 1
    assert "Missing: unknown." in done.stderr
