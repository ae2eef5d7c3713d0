from __future__ import annotations

import cv2
import pytest

from service.api.context import open_context
from service.settings import Settings


@pytest.mark.parametrize("processors", [1, 3])
def test_as_many_pairs_are_checked_at_once_as_the_container_has_processors(
    processors: int, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each check holds its photographs in memory; of the host's processors there may be dozens."""
    monkeypatch.setattr(cv2, "getNumberOfCPUs", lambda: processors)
    with open_context(settings) as context:
        begun = [context.checks.acquire(blocking=False) for _ in range(processors + 1)]
    assert begun == [True] * processors + [False]
