from __future__ import annotations

import io
import json
import sys

import pytest

from service.cli.display import duv_of, print_json, temperature_of

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
