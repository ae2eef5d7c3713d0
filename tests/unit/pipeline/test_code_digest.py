from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.code_digest import digest


@pytest.fixture
def package(tmp_path: Path) -> Path:
    package = tmp_path / "package"
    (package / "within").mkdir(parents=True)
    (package / "a.py").write_text("A = 1\n")
    (package / "within" / "b.py").write_text("B = 1\n")
    return package


def test_the_digest_is_that_of_all_modules_wherever_they_lie(package: Path, tmp_path: Path) -> None:
    before = digest(package)
    assert len(before) == 16 and int(before, 16)
    (package / "table.csv").write_text("1\n")  # no module
    package.rename(tmp_path / "elsewhere")
    assert digest(tmp_path / "elsewhere") == before


@pytest.mark.parametrize(
    "change",
    [
        lambda package: (package / "a.py").write_text("A = 2\n"),
        lambda package: (package / "within" / "b.py").write_text(""),
        lambda package: (package / "a.py").rename(package / "c.py"),
        lambda package: (package / "a.py").rename(package / "within" / "a.py"),
        lambda package: (package / "within" / "c.py").touch(),
        lambda package: (package / "a.py").unlink(),
    ],
    ids=["text", "text within", "name", "place", "one more", "one less"],
)
def test_every_change_of_a_module_gives_another(
    change: Callable[[Path], object], package: Path
) -> None:

    before = digest(package)
    change(package)
    assert digest(package) != before


def test_a_module_that_cannot_be_read_is_no_version(package: Path) -> None:
    (package / "lost.py").symlink_to(package / "nowhere")
    with pytest.raises(OSError, match=r"lost\.py"):
        digest(package)
