"""Writes the table of settings for people: python -m service.reference prints it."""

from __future__ import annotations

from pydantic.fields import FieldInfo

from service.settings import Settings

_DERIVED = {
    "database_url": "`lightlayers.sqlite` in the folder",
    "store_url": "`store` in the folder",
}


def table() -> str:
    """Make the table, as Markdown: one row per setting, in the order of service.settings."""
    rows = [
        f"| `LIGHTLAYERS_{name.upper()}` | {_default(name, field)} | {field.description} |"
        for name, field in Settings.model_fields.items()
    ]
    return "\n".join(["| variable | default | what |", "|---|---|---|", *rows]) + "\n"


def _default(name: str, field: FieldInfo) -> str:
    if name in _DERIVED:
        return _DERIVED[name]
    return "none" if field.default is None else f"`{field.default}`"


if __name__ == "__main__":
    print(table(), end="")  # noqa: T201
