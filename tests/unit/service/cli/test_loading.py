from __future__ import annotations

import gc

import pytest

from service.cli.loading import loading


def test_garbage_is_looked_for_again_afterwards_but_not_among_what_was_loaded() -> None:
    try:
        with loading():
            assert not gc.isenabled()
            loaded: list[list[int]] = [[]]
        assert gc.isenabled()
        assert all(one is not loaded for one in gc.get_objects())
    finally:
        gc.unfreeze()


def test_garbage_is_looked_for_again_after_a_failure() -> None:
    try:
        with pytest.raises(ImportError), loading():
            raise ImportError
        assert gc.isenabled()
    finally:
        gc.unfreeze()
