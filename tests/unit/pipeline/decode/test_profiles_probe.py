from __future__ import annotations

import numpy as np
import pytest

from pipeline.decode.profiles import _probe


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_probe_holds_each_corner_and_step_of_the_cube_of_colours_once(
    kind: type[np.unsignedinteger],
) -> None:
    probe = _probe(np.dtype(kind))
    assert probe.shape == (16, 256, 3)
    assert probe.dtype == kind
    steps = np.linspace(0, np.iinfo(kind).max, 16).astype(kind)
    expected = {(r, g, b) for r in steps.tolist() for g in steps.tolist() for b in steps.tolist()}
    assert set(map(tuple, probe.reshape(-1, 3).tolist())) == expected
