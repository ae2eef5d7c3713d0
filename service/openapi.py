"""Writes the OpenAPI document: python -m service.openapi > openapi.json."""

from __future__ import annotations

import json
import sys

from service.api import create_app


def document() -> str:
    """Write the document as text, the same for the same app."""
    return json.dumps(create_app().openapi(), indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.stdout.write(document())
