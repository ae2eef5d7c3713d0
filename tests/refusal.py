"""What a photograph is refused with."""

from __future__ import annotations

import pytest

from pipeline.decode import decode
from pipeline.errors import UnreadableImageError


def refusal(data: bytes) -> str:
    """Return the sentence with which these bytes are refused. Fails where they are read."""
    with pytest.raises(UnreadableImageError) as caught:
        decode(data)
    return str(caught.value)
