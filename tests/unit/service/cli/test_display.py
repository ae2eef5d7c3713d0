from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from service.cli.display import duv_of, print_json, print_results, temperature_of

WHITE = {"cct_k": 3180, "duv": -0.0024}
FAR = {"cct_k": None, "duv": None}


@pytest.mark.parametrize(("indent", "lines"), [(2, 3), (None, 1)])
def test_json_has_names_as_they_are(
    indent: int | None, lines: int, capsys: pytest.CaptureFixture[str]
) -> None:
    print_json({"name": "Küche"}, indent)
    said = capsys.readouterr().out
    assert "Küche" in said
    assert json.loads(said) == {"name": "Küche"}
    assert len(said.splitlines()) == lines


def test_json_is_ascii_where_stdout_is_not_utf_8(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "latin-1"))
    print_json({"name": "Küche …"}, None)
    assert written.getvalue() == b'{"name": "K\\u00fcche \\u2026"}\n'


def test_json_goes_nowhere_where_stdout_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    print_json({"name": "Küche"})


def test_white_lights_have_a_temperature_and_a_distance_from_the_black_body() -> None:
    assert (temperature_of(WHITE), duv_of(WHITE)) == ("3180 K", "-0.002")


def test_lights_far_from_white_have_none() -> None:
    assert (temperature_of(FAR), duv_of(FAR)) == ("none", "none")
    assert temperature_of(FAR, "sodium") == "sodium"


LAMP: dict[str, Any] = {
    "name": "lamp1",
    "rgb": [1.0, 0.541, 0.322],
    "cct_k": 2350.4,
    "duv": -0.0071,
    "srgb": "#ffb066",
    "family": "incandescent",
    "family_confidence": 0.39,
    "confidence": 0.87,
}


@pytest.mark.parametrize("columns", [30, 40, 60, 69, 79, 80, 200])
def test_every_figure_of_a_lamp_is_shown_however_narrow_the_terminal(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))

    print_results({"lamps": [LAMP, LAMP], "files": [], "warnings": []}, Path("r"), False)

    said = capsys.readouterr().out
    for figure in ("lamp1", "██", "1.000 0.541 0.322", "2350 K", "-0.007", "0.39", "0.87"):
        assert said.count(figure) == 2, figure
    assert said.count("incandescent") == 2
    assert "…" not in said
    assert max(map(len, said.splitlines())) <= columns


def test_names_do_not_act_on_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    files = [{"name": "a\nb.tif"}]
    warning = {"message": "calib\x1b[31m.json, \x9b2J\u2028Küche — 写真"}

    print_results({"lamps": [LAMP], "files": files, "warnings": [warning]}, Path("r\x1b[2J"), False)

    *_, first, second, third = capsys.readouterr().out.split("\n")[:-1]
    assert first == "r\\x1b[2J/a\\nb.tif"
    assert second == "r\\x1b[2J/manifest.json"
    assert third == "Warning: calib\\x1b[31m.json, \\x9b2J\\u2028Küche — 写真"
