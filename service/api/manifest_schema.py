"""The manifest of a job's results as JSON Schema, for clients that are made from openapi.json.

docs/results.md says what each field means. A mix and a calibration have some of them alone.
"""

from __future__ import annotations

from typing import Any

from pipeline.run_warnings import Code

_Schema = dict[str, Any]

_TEXT: _Schema = {"type": "string"}
_YES_OR_NO: _Schema = {"type": "boolean"}
_COUNT: _Schema = {"type": "integer", "minimum": 0}
_NUMBER: _Schema = {"type": "number"}
_SHARE: _Schema = {"type": "number", "minimum": 0, "maximum": 1}
_ANY: _Schema = {"type": "object", "additionalProperties": True}


def _object(description: str, **properties: _Schema) -> _Schema:
    """An object that always has these properties."""
    return {
        "type": "object",
        "description": description,
        "required": list(properties),
        "properties": properties,
    }


def _list(items: _Schema) -> _Schema:
    return {"type": "array", "items": items}


def _or_null(schema: _Schema) -> _Schema:
    return {"anyOf": [schema, {"type": "null"}]}


def _named(name: str) -> _Schema:
    return {"$ref": f"#/components/schemas/{name}"}


def _about(schema: _Schema, description: str) -> _Schema:
    return schema | {"description": description}


_PHOTOGRAPH = _object(
    "One of the photographs that were sent.",
    sha256=_TEXT,
    width=_COUNT,
    height=_COUNT,
    encoding={"type": "string", "enum": ["raw", "linear", "srgb"]},
    exposure_time_s=_or_null(_NUMBER),
    iso=_or_null(_NUMBER),
    f_number=_or_null(_NUMBER),
)
_PHOTOGRAPHS = _object(
    "Both photographs.", no_flash=_named("Photograph"), flash=_named("Photograph")
)
_LAMP = _object(
    "A lamp that was found.",
    name=_about(_TEXT, "As its files begin: lamp1 …"),
    coefficients=_list(_NUMBER),
    rgb=_about(_list(_NUMBER), "Of a grey card in its light: linear camera RGB, the largest 1."),
    cct_k=_about(_or_null(_NUMBER), "Colour temperature in kelvin; null far from white."),
    duv=_or_null(_NUMBER),
    srgb=_about(_TEXT, "Its colour for a screen, as #rrggbb."),
    family=_about(_TEXT, "The nearest family of lamps, in words."),
    family_confidence=_SHARE,
    confidence=_SHARE,
    pinned=_about(_or_null(_COUNT), "Which of pinned_lamps it is, from 0."),
    separated_share=_about(_SHARE, "Of its light, that is separated and not filled in."),
)
_FILE: _Schema = {
    "type": "object",
    "description": "A file of the results; a surface has no width and height, and of a "
    "calibration's files name and SHA-256 alone are told.",
    "required": ["name", "sha256"],
    "properties": {
        "name": _TEXT,
        "sha256": _TEXT,
        "encoding": _TEXT,
        "colour_space": _TEXT,
        "width": _COUNT,
        "height": _COUNT,
    },
}
_WARNING = _object(
    "What of the result to trust less.",
    code={
        "type": "string",
        "enum": [code.value for code in Code],
        "description": "Stays the same from version to version.",
    },
    message=_about(_TEXT, "What, where and what to do, for people."),
    figures={
        "type": "object",
        "additionalProperties": _NUMBER,
        "description": "What the message is based on; shares are 0 to 1.",
    },
)
_MANIFEST: _Schema = {
    "type": "object",
    "required": ["files", "warnings", "versions"],
    "properties": {
        "inputs": _named("Photographs"),
        "options": _about(_ANY, "All options, as given or by default."),
        "camera": _object("The sensitivities that were taken.", name=_TEXT, source=_TEXT),
        "flash": _object(
            "The flash that was taken.", name=_TEXT, source=_TEXT, flash_only=_YES_OR_NO
        ),
        "exposure_ratio": _about(
            _NUMBER, "Exposure of the flash photograph divided by that of the other."
        ),
        "exposure_source": {"type": "string", "enum": ["option", "exif", "pixels", "assumed"]},
        "tone_curve": _or_null(
            _object("A contrast that was taken off.", codes=_list(_NUMBER), light=_list(_NUMBER))
        ),
        "local_tone_mapping": _or_null(
            _object(
                "A local tone mapping that was taken off.",
                power=_NUMBER,
                least=_NUMBER,
                most=_NUMBER,
            )
        ),
        "balance_change": _or_null(
            _object("A white balance that was taken off.", red=_NUMBER, blue=_NUMBER)
        ),
        "alignment": _object(
            "How the flash photograph was laid on the other.",
            applied=_YES_OR_NO,
            matrix=_list(_list(_NUMBER)),
            correlation=_or_null(_NUMBER),
            parallax=_SHARE,
        ),
        "moved": _SHARE,
        "lights": _object(
            "The number of lamps.",
            requested={"type": ["integer", "string"], "description": "A number, or auto."},
            found=_COUNT,
            confidence=_SHARE,
        ),
        "lamps": _list(_named("FoundLamp")),
        "normals": _or_null(
            _object("How normals are told.", convention=_TEXT, strengths=_list(_NUMBER))
        ),
        "filled": _SHARE,
        "files": _list(_named("DescribedFile")),
        "mix": _about(_ANY, "What mixing starts from; of a mix, its settings."),
        "calibrations": _list(_about(_ANY, "One that was kept and stood in for an option.")),
        "found": _about(_ANY, "Of a calibration: what it found."),
        "taken_with": _about(_ANY, "Of a calibration: camera and files that it holds for."),
        "warnings": _list(_named("RunWarning")),
        "versions": {"type": "object", "additionalProperties": _TEXT},
    },
}
SCHEMAS: dict[str, _Schema] = {
    "Manifest": _MANIFEST,
    "Photographs": _PHOTOGRAPHS,
    "Photograph": _PHOTOGRAPH,
    "FoundLamp": _LAMP,
    "DescribedFile": _FILE,
    "RunWarning": _WARNING,
}
"""Every field of the manifest of a separation, a mix or a calibration, as schemas of OpenAPI."""
