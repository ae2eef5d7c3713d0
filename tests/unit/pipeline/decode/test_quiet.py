from __future__ import annotations

import os
import sys

import pytest

from pipeline.decode.quiet import muted


def test_what_decoders_write_is_dropped_and_the_rest_comes_through(
    capfd: pytest.CaptureFixture[str],
) -> None:
    os.write(2, b"before ")
    with muted():
        os.write(2, b"from C")
        sys.stdout.write("from Python")
    os.write(2, b"after")
    sys.stdout.write("printed")

    out, err = capfd.readouterr()

    assert err == "before after"
    assert out == "printed"


def test_the_terminal_comes_back_after_an_error(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match="broken"), muted():
        raise ValueError("broken")
    os.write(2, b"heard")

    assert capfd.readouterr().err == "heard"
