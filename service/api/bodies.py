"""How the OpenAPI document tells what a route takes as its body."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel


def schema_of(*models: type[BaseModel]) -> dict[str, Any]:
    """Refer to the schema of a model, or of one of several."""
    named = [{"$ref": f"#/components/schemas/{model.__name__}"} for model in models]
    return named[0] if len(named) == 1 else {"oneOf": named}


def json_content(*models: type[BaseModel]) -> dict[str, Any]:
    """Describe a body of JSON, an entry of its content. models: it is one of these."""
    return {"application/json": {"schema": schema_of(*models)}}
