"""Pairs made of frames, as they lie or laid on each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.images.frames import Frame
from pipeline.options import Options
from pipeline.pair.align import Alignment
from pipeline.pair.pair import Pair, make_pair
from pipeline.progress import Progress
from tests.unit.pipeline.pair.shadows_on_paint import neighbours_of


def paired(frames: tuple[Frame, Frame], **options: Any) -> Pair:
    """The pair of two frames with some options."""
    return make_pair(*frames, Options(**options), Progress())


def have_found(monkeypatch: pytest.MonkeyPatch, search: str, found: Any) -> list[tuple[Any, ...]]:
    """Have a search of pipeline.pair.pair find this from now on; what it was asked."""
    given: list[tuple[Any, ...]] = []

    def find(*arguments: Any) -> Any:
        given.append(arguments)
        return found

    monkeypatch.setattr(f"pipeline.pair.pair.{search}", find)
    return given


def lay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have alignment lay flash photographs where they lie, in memory of their own."""
    shifted = Alignment(True, np.eye(3), 0.9)
    monkeypatch.setattr("pipeline.pair.pair.estimate_alignment", lambda *_: shifted)
    monkeypatch.setattr("pipeline.pair.pair.residual_flow", lambda *_: None)
    monkeypatch.setattr("pipeline.pair.pair.warp", lambda pixels, mask, _: (pixels[:].copy(), mask))


def have_neighbours(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have pairs of places be found, however small pictures are, that know their exposures."""
    monkeypatch.setattr(
        "pipeline.pair.rendering.find_neighbours",
        lambda *given: neighbours_of(np.full((4, 1, 3), 0.2), given[1]),
    )
