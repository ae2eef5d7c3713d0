from __future__ import annotations

import hashlib
import re
from pathlib import Path

import httpx
import pytest

import service
from drivers.camera import RAW_KINDS
from pipeline.calibration.find_marks import MARKS
from pipeline.calibration.options import FILES
from pipeline.mixes.mix_files import ENCODINGS
from pipeline.output_names import OUTPUT_NAMES

FOLDER = Path(service.__path__[0]) / "page"
MODULES = sorted(path.name for path in FOLDER.glob("*.js"))


def test_the_page_may_load_nothing_from_elsewhere(http: httpx.Client) -> None:
    page = http.get("/")
    assert page.status_code == 200
    assert page.headers["content-type"].startswith("text/html")
    policy = dict(
        part.split(" ", 1) for part in page.headers["content-security-policy"].split("; ")
    )
    assert policy["default-src"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == policy["base-uri"] == "'none'"
    assert not any("unsafe" in sources or "http" in sources for sources in policy.values())
    assert not re.search(r"<style|style=|\son\w+=|<script(?![^>]*\ssrc=)", page.text)


def test_everything_that_the_page_names_is_there(http: httpx.Client) -> None:
    named = set(re.findall(r'"(/page/[^"]+)"', http.get("/").text))
    assert {"/page/app.js", "/page/style.css", "/page/icon.svg"} <= named
    for name in MODULES:
        text = http.get(f"/page/{name}").text
        named |= {f"/page/{found}" for found in re.findall(r'["(]\./([\w.]+)"', text)}
        assert not re.search(r"https?://(?!www\.w3\.org)", text), name
    for path in named:
        answer = http.get(path)
        assert answer.status_code == 200, path
        assert answer.headers["x-content-type-options"] == "nosniff"
    assert {f"/page/{name}" for name in MODULES} == {path for path in named if path.endswith("js")}


def test_a_browser_asks_again_whether_a_file_has_changed(http: httpx.Client) -> None:
    first = http.get("/page/app.js")
    assert first.headers["content-type"].startswith("text/javascript")
    assert first.headers["cache-control"] == "no-cache"
    etag = first.headers["etag"]
    assert etag == f'"{hashlib.sha256(first.content).hexdigest()}"'  # whatever its time is
    for known in (etag, f'"other", W/{etag}'):  # the second is what is left of it by proxies
        same = http.get("/page/app.js", headers={"If-None-Match": known})
        assert (same.status_code, same.content) == (304, b"")
        assert same.headers["etag"] == etag
        assert same.headers["cache-control"] == "no-cache"
    other = http.get("/page/app.js", headers={"If-None-Match": http.get("/").headers["etag"]})
    assert (other.status_code, other.content) == (200, first.content)
    head = http.head("/page/app.js")
    assert head.headers["content-length"] == str(len(first.content))


@pytest.mark.parametrize("path", ["/page/", "/page/nothing.js", "/page/..%2fsettings.py", "/pag"])
def test_there_is_nothing_else(http: httpx.Client, path: str) -> None:
    answer = http.get(path)
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


def test_photographs_of_every_camera_can_be_chosen() -> None:
    """Those of which systems do not know that they are pictures."""
    kinds = re.search(r'"image/\*,([^"]+)"', (FOLDER / "add.js").read_text(encoding="utf-8"))
    assert kinds is not None
    raw = {f".{kind}" for kind in RAW_KINDS}
    assert {*raw, ".exr", ".heic", ".heif", ".hif"} <= {*kinds[1].split(",")}


def test_every_file_of_a_result_has_words() -> None:
    """Those of single lamps have a pattern."""
    text = (FOLDER / "files.js").read_text(encoding="utf-8")
    words = dict(re.findall(r'"([\w.]+)": "([^"]+)"', text))
    mixes = [f"mix.{ending}" for ending, *_ in ENCODINGS.values()]
    names = {"manifest.json", MARKS, *OUTPUT_NAMES, *FILES.values(), *mixes}
    assert words.keys() == names - {"lamps.tif", "lamps.jpg", "response_lamps.jpg"}
    assert words["marks.jpg"] == "Where the calibration was measured"
