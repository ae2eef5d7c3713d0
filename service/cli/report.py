"""One HTML page of a result that needs nothing beside it: pictures, lamps, warnings, figures."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import cv2
import numpy as np

from pipeline.errors import InputError, counted, reason_of
from pipeline.result_names import MANIFEST
from service import durable
from service.cli.display import duv_of, temperature_of
from service.cli.files import read_file

_MOST_SIDE = 1400
_JPEG_QUALITY = 88
_PHOTOGRAPH = {"thumbnail.jpg": "The photograph without the flash"}
_CAPTIONS = {
    "white_balanced_1.jpg": "White balanced: every lamp replaced by the neutral light",
    "white_balanced_2.jpg": "White balanced as a whole: all light, also what no lamp "
    "explains, replaced by the neutral light",
    "response.jpg": "As the other camera would have seen it",
    "normals.png": "Surface normals, their x, y and z in red, green and blue",
    "gamma.png": "The light of every pixel without its surface, and the lamps found in it",
    "residual.png": "What the lamps found do not explain",
    "confidence.tif": "White where the layers were separated, black where they could not be",
    "normals_confidence.tif": "How far each normal can be trusted",
}
_LETTERED = ("gamma.png", "residual.png")
"""Pictures with words in them, which can be read only where they are shown large."""

Html = str
"""Text in which everything that is not ours is escaped."""


def write_report(folder: Path, target: Path) -> Path:
    """Write the page of the results in a folder; its path.

    A report that is there is replaced. Raises InputError where the folder holds no results, and
    where the page cannot be written or another one would be lost.
    """
    if target.suffix.lower() not in (".html", ".htm"):  # perhaps a picture of the results
        raise InputError(f"A page cannot be written as {target}: its name has to end in .html.")
    _check_lost(target)
    manifest = _manifest(folder)
    page = Template(_template())
    try:
        values = {
            "title": escape(f"Light of {counted(len(manifest['lamps']), 'lamp', 'lamps')}"),
            "summary": _summary(manifest),
            "warnings": _warnings(manifest["warnings"]),
            "pictures": "\n".join(_pictures(folder, manifest)),
            "lamps": _lamps(manifest["lamps"]),
            "facts": _facts(manifest),
            "files": _files(manifest["files"]),
        }
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"The manifest in {folder} is not that of a separation, or of another version: "
            "separate the pair again."
        ) from error
    try:
        durable.replace(target, page.substitute(values).encode())
    except OSError as error:
        raise _unwritable(target, error) from error
    return target


def _check_lost(target: Path) -> None:
    try:
        lost = target.exists() and not is_report(target)
    except OSError as error:
        raise _unwritable(target, error) from error
    if lost:
        raise InputError(
            f"The page {target} would be lost, which is no report of this program: give another "
            "name, or move it first."
        )


def _unwritable(target: Path, error: OSError) -> InputError:
    return InputError(f"The page {target} cannot be written: {reason_of(error)}.")


def is_report(path: Path) -> bool:
    """Tell whether a file begins as the pages that write_report makes. Raises OSError."""
    head = _template().partition("$")[0].encode()
    with path.open("rb") as file:
        return file.read(len(head)) == head


def _template() -> str:
    return (files("service.cli") / "report.html").read_text(encoding="utf-8")


def _manifest(folder: Path) -> dict[str, Any]:
    data = read_file(folder / MANIFEST, "manifest")
    try:
        manifest = json.loads(data)
    except ValueError:
        manifest = None
    if not isinstance(manifest, dict) or "lamps" not in manifest:
        raise InputError(
            f"The manifest in {folder} is not that of a separation: name a folder that "
            "`lightlayers separate` or `lightlayers submit` wrote."
        )
    return manifest


def _summary(manifest: Mapping[str, Any]) -> Html:
    lights = manifest["lights"]
    asked = "" if lights["requested"] == "auto" else f" ({lights['requested']} asked for)"
    filled = 100 * manifest["filled"]
    return escape(
        f"{counted(lights['found'], 'lamp', 'lamps')} found{asked}, number certain to "
        f"{100 * lights['confidence']:.0f} %. {filled:.1f} % of the picture could not "
        f"be separated. Camera: {manifest['camera']['name']} ({manifest['camera']['source']}); "
        f"flash: {manifest['flash']['name']} ({manifest['flash']['source']})."
    )


def _warnings(warnings: Sequence[Mapping[str, Any]]) -> Html:
    if not warnings:
        return "<p>No warnings.</p>"
    items = "".join(f"<li>{escape(warning['message'])}</li>" for warning in warnings)
    return f"<h2>Warnings</h2>\n<ul>{items}</ul>"


def _pictures(folder: Path, manifest: Mapping[str, Any]) -> Iterable[Html]:
    names = [file["name"] for file in manifest["files"]]
    lamps = {f"{lamp['name']}.jpg": f"The light of {lamp['name']}" for lamp in manifest["lamps"]}
    captions = _PHOTOGRAPH | lamps | _CAPTIONS
    if normals := manifest.get("normals"):  # whose y points up or down, as was asked for
        captions["normals.png"] += f": {normals['convention']}"
    for name in sorted(set(names) & set(captions), key=list(captions).index):
        data = base64.b64encode(_small(folder / name)).decode()
        caption = escape(captions[name])
        wide = ' class="lettered"' if name in _LETTERED else ""
        yield (
            f'<figure{wide}><img alt="{caption}" src="data:image/jpeg;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>"
        )


def _small(path: Path) -> bytes:
    """Give a picture of the results as a JPEG of at most _MOST_SIDE pixels a side."""
    read = np.frombuffer(read_file(path, "picture"), np.uint8)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR
    picture = cv2.imdecode(read, flags) if read.size else None
    if picture is None:
        raise InputError(f"The picture {path} is damaged: separate the pair again.")
    if picture.dtype == np.uint16:
        picture = cv2.convertScaleAbs(picture, alpha=1 / 257)
    scale = _MOST_SIDE / max(picture.shape)
    if scale < 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _, coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    return coded.tobytes()


def _lamps(lamps: Sequence[Mapping[str, Any]]) -> Html:
    rows = []
    for lamp in lamps:
        chip = f'<span class="chip" style="background: {escape(lamp["srgb"])}"></span>'
        rows.append(
            [
                escape(lamp["name"]),
                chip,
                temperature_of(lamp),
                duv_of(lamp),
                escape(f"{lamp['family']} ({lamp['family_confidence']:.2f})"),
                f"{lamp['confidence']:.2f}",
                f"{100 * lamp['separated_share']:.0f} %",
            ]
        )
    heads = ["lamp", "colour", "temperature", "Duv", "family", "confidence", "light separated"]
    return _table(heads, rows)


def _facts(manifest: Mapping[str, Any]) -> Html:
    rows = []
    for name, words in {"no_flash": "without the flash", "flash": "with the flash"}.items():
        photograph = manifest["inputs"][name]
        facts = ", ".join(f"{key} {_short(value)}" for key, value in photograph.items() if value)
        rows.append([words, escape(facts)])
    options = {key: value for key, value in manifest["options"].items() if value not in (None, [])}
    short = {key: _short(value) for key, value in options.items()}
    rows.append(["options", escape(", ".join(f"{key} {value}" for key, value in short.items()))])
    versions = manifest["versions"].items()
    rows.append(["versions", escape(", ".join(f"{key} {value}" for key, value in versions))])
    return _table(["", ""], rows)


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 80 else f"{text[:79]}…"


def _files(listed: Sequence[Mapping[str, Any]]) -> Html:
    rows = [
        [escape(file["name"]), escape(file["encoding"]), escape(file["colour_space"] or "")]
        for file in listed
    ]
    return _table(["file", "encoding", "colour space"], rows)


def _table(heads: Sequence[Html], rows: Iterable[Sequence[Html]]) -> Html:
    head = "".join(f"<th>{cell}</th>" for cell in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
