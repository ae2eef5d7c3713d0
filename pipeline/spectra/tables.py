"""Spectral tables that people hand in: CSV and the AMPAS JSON of rawtoaces."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

from pydantic import ValidationError

from pipeline.errors import OptionError, own_words
from pipeline.options import MOST_ROWS, Sensitivities, Spectrum

_CAMERA_COLUMNS = ("r", "g", "b")
_LIGHT_COLUMNS = ("power",)
_CSV_HEAD = "wavelength_nm"
_TAKEN_WITH = "taken_with"


def parse_sensitivities(data: bytes) -> Sensitivities:
    """Read a camera's sensitivities from CSV (wavelength_nm,R,G,B) or AMPAS JSON.

    Raises OptionError with one sentence for anything wrong.
    """
    wavelengths, (r, g, b), more = _table(data, _CAMERA_COLUMNS, "camera table")
    try:
        return Sensitivities(wavelength_nm=wavelengths, r=r, g=g, b=b, **more)
    except ValidationError as error:
        raise OptionError(_sentence("camera table", error)) from error


def parse_spectrum(data: bytes) -> Spectrum:
    """Read a light's spectrum from CSV (wavelength_nm,power) or AMPAS JSON.

    Raises OptionError with one sentence for anything wrong.
    """
    wavelengths, (power,), more = _table(data, _LIGHT_COLUMNS, "light table")
    try:
        return Spectrum(wavelength_nm=wavelengths, power=power, **more)
    except ValidationError as error:
        raise OptionError(_sentence("light table", error)) from error


def write_sensitivities(table: Sensitivities) -> bytes:
    """Write a camera's sensitivities as AMPAS JSON, which parse_sensitivities reads."""
    return _ampas(_CAMERA_COLUMNS, table, table.r, table.g, table.b)


def write_spectrum(table: Spectrum) -> bytes:
    """Write a light's spectrum as AMPAS JSON, which parse_spectrum reads."""
    return _ampas(_LIGHT_COLUMNS, table, table.power)


def _ampas(names: tuple[str, ...], table: Sensitivities | Spectrum, *columns: list[float]) -> bytes:
    rows = zip(table.wavelength_nm, *columns, strict=True)
    main = {f"{nm:g}": [float(f"{value:.6g}") for value in row] for nm, *row in rows}
    heads = [name.upper() if len(name) == 1 else name for name in names]
    content: dict[str, Any] = {"spectral_data": {"index": {"main": heads}, "data": {"main": main}}}
    if table.taken_with is not None:
        content[_TAKEN_WITH] = table.taken_with.model_dump()
    return (json.dumps(content, indent=1) + "\n").encode()


def _table(
    data: bytes, columns: tuple[str, ...], what: str
) -> tuple[list[float], list[list[float]], dict[str, Any]]:
    """Wavelengths, the columns asked for, and what a calibration says besides, as it stands."""
    try:
        text = data.decode("utf-8-sig").strip()
    except UnicodeDecodeError as error:
        raise OptionError(f"The {what} is not text: send CSV or AMPAS JSON in UTF-8.") from error
    if text.startswith("{"):
        rows, more = _json_rows(text, what)
    else:
        rows, more = _csv_rows(text, what), {}
    head, *body = rows
    wanted = (_CSV_HEAD, *columns)
    if tuple(head) != wanted:
        raise OptionError(
            f"The {what} has the columns {','.join(head)[:80]}: it needs {','.join(wanted)}."
        )
    numbers = [
        [_number(cell, what, place) for cell in row] for place, row in enumerate(body, start=1)
    ]
    if any(len(row) != len(wanted) for row in numbers):
        raise OptionError(f"A row of the {what} has not {len(wanted)} numbers: mend that row.")
    values = [list(column) for column in zip(*numbers, strict=True)]
    if not values:
        raise OptionError(f"The {what} has no rows: send one per wavelength.")
    return values[0], values[1:], more


def _number(cell: str, what: str, row: int) -> float:
    try:
        return float(cell)
    except ValueError as error:
        raise OptionError(
            f"The {what} holds {cell[:40]!r} in row {row}, which is not a number: mend that row."
        ) from error


def _csv_rows(text: str, what: str) -> list[list[str]]:
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(io.StringIO(text)) if row]
    except csv.Error as error:
        raise OptionError(f"The {what} is no CSV: {error}.") from error
    if not rows:
        raise OptionError(f"The {what} is empty: send CSV or AMPAS JSON.")
    return [[cell.lower() for cell in rows[0]], *rows[1:]]


def _json_rows(text: str, what: str) -> tuple[list[list[str]], dict[str, Any]]:
    try:
        document = json.loads(text)
        spectral = document["spectral_data"]
        head = [str(column).lower() for column in spectral["index"]["main"]]
        main = dict(spectral["data"]["main"])
        rows = [
            [_CSV_HEAD, *head],
            *([*map(str, (wavelength, *row))] for wavelength, row in main.items()),
        ]
        return rows, {name: document[name] for name in (_TAKEN_WITH,) if name in document}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise OptionError(
            f"The {what} is no AMPAS JSON: it needs spectral_data.index.main and data.main."
        ) from error


def _sentence(what: str, error: ValidationError) -> str:
    first = error.errors()[0]
    if first["type"] == "too_short":
        return f"The {what} has one row: send two or more, one per wavelength."
    if first["loc"][:1] == (_TAKEN_WITH,):
        return (
            f"The {what} does not say in {_TAKEN_WITH} what it was found with, as a calibration "
            "writes it: calibrate anew, or remove that."
        )
    if first["type"] == "too_long":
        return (
            f"The {what} has {first['ctx']['actual_length']:,} rows: send at most {MOST_ROWS:,}, "
            "in wider steps."
        )
    if first["loc"]:
        column, row = first["loc"]
        bound = "finite" if first["type"] == "finite_number" else "0 or more"
        return (
            f"The {what} has {first['input']:g} as {column} in row {int(row) + 1}: it must be "
            f"{bound}."
        )
    return f"The {what} cannot be used: {own_words(first['msg'])}."
