from __future__ import annotations

import subprocess
import sys

import pytest

_IMPORT = """
import sys
from pipeline.spectra.colour_science import colour_science
table = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
assert table.values.shape[1] == 3
"""


@pytest.mark.parametrize(
    "then",
    [
        "assert 'matplotlib' not in sys.modules",
        "import matplotlib.figure; assert matplotlib.figure.Figure().axes == []",
    ],
    ids=["is not imported", "can be imported later"],
)
def test_matplotlib(then: str) -> None:
    """In a process of its own: here something else may have imported it."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", _IMPORT + then],
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
