from __future__ import annotations

import base64
import copy
import io
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from pipeline.photometric_stereo.facing import CONVENTIONS
from service import durable
from service.cli import run

LAMP = {
    "name": "lamp1",
    "cct_k": 2856.4,
    "duv": -0.0123,
    "srgb": "#ffb066",
    "family": "incandescent",
    "family_confidence": 0.53,
    "confidence": 0.87,
    "separated_share": 0.96,
}
MANIFEST: dict[str, Any] = {
    "inputs": {
        "no_flash": {"sha256": "ab" * 32, "width": 64, "iso": 100.0},
        "flash": {"sha256": "cd" * 32, "width": 64, "iso": None},
    },
    "options": {"lights": "auto", "camera": None, "response": {"table": list(range(100))}},
    "camera": {"name": "<b>Nikon</b>", "source": "measured"},
    "flash": {"name": "xenon", "source": "named"},
    "lights": {"requested": "auto", "found": 1, "confidence": 0.91},
    "lamps": [LAMP],
    "filled": 0.0123,
    "files": [
        {"name": "confidence.tif", "encoding": "16-bit", "colour_space": None},
        {"name": "lamp1.jpg", "encoding": "8-bit", "colour_space": "sRGB"},
        {"name": "layers.exr", "encoding": "32-bit float", "colour_space": "camera RGB"},
    ],
    "warnings": [{"code": "clipped", "message": '5 < 6 & "clipped".', "figures": {}}],
    "versions": {"lightlayers": "0.1.0"},
}


class Page(HTMLParser):
    """What a page shows: its texts, and its pictures with what they are called."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.pictures: dict[str, Image.Image] = {}
        self.tags: set[str] = set()
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        values = dict(attrs)
        if tag == "img":
            data = (values["src"] or "").removeprefix("data:image/jpeg;base64,")
            picture = Image.open(io.BytesIO(base64.b64decode(data, validate=True)))
            self.pictures[values["alt"] or ""] = picture

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


@pytest.fixture
def results(tmp_path: Path) -> Path:
    Image.fromarray(np.full((100, 2800, 3), (200, 100, 50), np.uint8)).save(tmp_path / "lamp1.jpg")
    tifffile.imwrite(tmp_path / "confidence.tif", np.full((40, 60), 0xC000, np.uint16))
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    return tmp_path


def test_a_page_has_everything_in_it(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["report", str(results)]) == 0
    assert capsys.readouterr().out == f"{results / 'report.html'}\n"
    html = (results / "report.html").read_text()
    page = Page(html)
    lamp, confidence = page.pictures.values()
    assert list(page.pictures) == [
        "The light of lamp1",
        "White where the layers were separated, black where they could not be",
    ]
    assert (lamp.size, confidence.size) == ((1400, 50), (60, 40))
    np.testing.assert_allclose(np.asarray(lamp).mean((0, 1)), (200, 100, 50), atol=2)
    np.testing.assert_allclose(np.asarray(confidence), 0xC0, atol=2)
    for text in ("Light of 1 lamp", "2856 K", "-0.012", "incandescent (0.53)", "0.87", "96 %"):
        assert text in page.texts
    assert '5 < 6 & "clipped".' in page.texts
    assert "1 lamp found, number certain to 91 %. 1.2 % of the picture could not be sep" in html
    assert not re.search(r"(?:src|href|url\()\s*=?\s*[\"']?(?:https?:)?//", html)


@pytest.mark.parametrize("convention", CONVENTIONS.values())
def test_normals_are_captioned_as_they_were_written(results: Path, convention: str) -> None:
    Image.new("RGB", (6, 4)).save(results / "normals.png")
    files = [{"name": "normals.png", "encoding": "8-bit", "colour_space": None}]
    manifest = MANIFEST | {"files": files, "normals": {"convention": convention}}
    (results / "manifest.json").write_text(json.dumps(manifest))
    assert run(["report", str(results)]) == 0
    (caption,) = Page((results / "report.html").read_text()).pictures
    assert caption.endswith(f": {convention}")


def test_the_photograph_is_seen_before_its_layers(results: Path) -> None:
    Image.new("RGB", (30, 20), (10, 200, 30)).save(results / "thumbnail.jpg")
    thumbnail = {"name": "thumbnail.jpg", "encoding": "8-bit", "colour_space": "sRGB"}
    manifest = MANIFEST | {"files": [*MANIFEST["files"], thumbnail]}
    (results / "manifest.json").write_text(json.dumps(manifest))
    assert run(["report", str(results)]) == 0
    pictures = Page((results / "report.html").read_text()).pictures
    captions = ["The photograph without the flash", "The light of lamp1"]
    assert list(pictures)[:2] == captions
    photograph = np.asarray(pictures[captions[0]])
    np.testing.assert_allclose(photograph.mean((0, 1)), (10, 200, 30), atol=2)


def test_pictures_with_words_in_them_are_shown_large(results: Path) -> None:
    names = ["lamp1.jpg", "gamma.png", "residual.png"]
    for name in names[1:]:
        Image.new("RGB", (6, 4)).save(results / name)
    files = [{"name": name, "encoding": "8-bit", "colour_space": None} for name in names]
    (results / "manifest.json").write_text(json.dumps(MANIFEST | {"files": files}))
    assert run(["report", str(results)]) == 0
    html = (results / "report.html").read_text()
    assert re.findall(r"<figure([^>]*)>", html) == ["", *2 * [' class="lettered"']]
    assert re.search(r"\.lettered \{ grid-column: span 2; \}", html)


def test_what_files_say_is_no_markup(results: Path) -> None:
    assert run(["report", str(results)]) == 0
    page = Page((results / "report.html").read_text())
    assert "b" not in page.tags and "script" not in page.tags
    assert any("<b>Nikon</b>" in text for text in page.texts)


def test_a_page_may_lie_elsewhere(results: Path, tmp_path: Path) -> None:
    assert run(["report", str(results), "-o", str(tmp_path / "shown.html")]) == 0
    assert (tmp_path / "shown.html").exists() and not (results / "report.html").exists()


def test_a_folder_that_is_named_for_the_page_is_told(
    results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["report", str(results), "-o", "."]) == 2
    said = capsys.readouterr().err
    assert said == "A page cannot be written as .: its name has to end in .html.\n"


def test_a_picture_is_not_written_over(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = results / "lamp1.jpg"
    before = picture.read_bytes()
    assert run(["report", str(results), "-o", str(picture)]) == 2
    assert "lamp1.jpg: its name has to end in .html." in capsys.readouterr().err
    assert picture.read_bytes() == before


def test_a_report_is_replaced_by_the_next(results: Path) -> None:
    page = results / "report.html"
    assert run(["report", str(results)]) == 0
    first = page.read_bytes()
    page.write_bytes(first + b"changed")
    assert run(["report", str(results)]) == 0
    assert page.read_bytes() == first


@pytest.mark.parametrize("text", ["", "<!doctype html>\nmine"])
@pytest.mark.parametrize("name", ["report.html", "mine.htm"])
def test_another_page_is_not_lost(
    name: str, text: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / name).write_text(text)
    assert run(["report", str(results), "-o", str(results / name)]) == 2
    assert f"{name} would be lost, which is no report" in capsys.readouterr().err
    assert (results / name).read_text() == text


def test_on_a_full_disk_the_earlier_report_stays(
    results: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(["report", str(results)]) == 0
    before = {path.name: path.read_bytes() for path in results.iterdir()}

    def write_some(path: Path, data: bytes) -> None:
        path.write_bytes(data[:9])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(durable, "write", write_some)
    assert run(["report", str(results)]) == 2
    assert "report.html cannot be written: no space left on device." in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in results.iterdir()} == before


def test_a_folder_is_no_page(results: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (results / "report.html").mkdir()
    assert run(["report", str(results)]) == 2
    assert "report.html cannot be written: is a directory." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("encoding", "printed"),
    [
        ("utf-8:strict", b"K\xc3\xbcche\xe2\x80\xa6 \xff"),
        ("latin-1", b"K\xfcche? \xff"),
        ("ascii", b"K?che? \xff"),
    ],
)
def test_a_folder_is_printed_as_it_is_as_far_as_the_encoding_goes(
    encoding: str, printed: bytes, results: Path
) -> None:
    folder = results / "Küche… \udcff"  # the last byte of which is not UTF-8
    folder.mkdir()
    (folder / "manifest.json").write_text(json.dumps(MANIFEST | {"files": []}))
    done = subprocess.run(
        [sys.executable, "-m", "service.cli", "report", folder],
        env={**os.environ, "PYTHONIOENCODING": encoding},
        capture_output=True,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == os.fsencode(results) + b"/" + printed + b"/report.html\n"


@pytest.mark.parametrize("missing", ["manifest.json", "lamp1.jpg"])
def test_a_file_that_is_not_there_is_told(
    missing: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / missing).unlink()
    assert run(["report", str(results)]) == 2
    assert f"{missing} cannot be read: no such file or directory." in capsys.readouterr().err
    assert not (results / "report.html").exists()


@pytest.mark.parametrize("data", [b"", b"\xff\xd8\xff light"])
def test_a_damaged_picture_is_told(
    data: bytes, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / "lamp1.jpg").write_bytes(data)
    assert run(["report", str(results)]) == 2
    assert "lamp1.jpg is damaged: separate the pair again.\n" in capsys.readouterr().err


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"lamps": 3}', '{"lamps": []}', "\xff"])
def test_another_manifest_is_told(
    text: str, results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / "manifest.json").write_text(text)
    assert run(["report", str(results)]) == 2
    said = capsys.readouterr().err
    assert f"manifest in {results} is not that of a separation" in said


@pytest.mark.parametrize(
    "changed",
    [
        {"inputs": ["a.dng", "b.dng"]},
        {"inputs": {"no_flash": "a.dng", "flash": "b.dng"}},
        {"lamps": [LAMP | {"cct_k": "warm"}]},
        {"lamps": [LAMP | {"cct_k": 10**400}]},
        {"lamps": [LAMP | {"srgb": None}]},
        {"filled": "little"},
    ],
)
def test_a_manifest_that_was_changed_by_hand_is_told(
    changed: dict[str, Any], results: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (results / "manifest.json").write_text(json.dumps(MANIFEST | changed))
    assert run(["report", str(results)]) == 2
    assert f"manifest in {results} is not that of a separation" in capsys.readouterr().err
    assert not (results / "report.html").exists()


def test_no_warning_is_said_as_well(results: Path) -> None:
    calm = copy.deepcopy(MANIFEST) | {"warnings": []}
    (results / "manifest.json").write_text(json.dumps(calm))
    assert run(["report", str(results)]) == 0
    assert "No warnings." in Page((results / "report.html").read_text()).texts


def test_figures_of_a_camera_are_short_and_those_of_lamps_explained(results: Path) -> None:
    manifest = copy.deepcopy(MANIFEST)
    manifest["inputs"]["flash"] |= {"exposure_time_s": 1 / 30, "iso": 102400.0}
    (results / "manifest.json").write_text(json.dumps(manifest))

    assert run(["report", str(results)]) == 0

    text = " ".join(Page((results / "report.html").read_text()).texts)
    assert "exposure_time_s 0.0333333" in text
    assert "iso 102400," in text
    for word in ("Temperature:", "Duv:", "Family:", "Confidence:", "Light separated:"):
        assert word in text
    assert "filled in" not in text  # which layers of the method paper are not
