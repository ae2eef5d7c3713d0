from __future__ import annotations

import json
from pathlib import Path

from pipeline.run_warnings import Code, RunWarning


def test_an_entry_is_plain_json_with_rounded_figures() -> None:
    entry = RunWarning(Code.LAMPS_ALIKE, "Too alike.", {"angle_deg": 3.123456, "count": 2}).entry()

    assert json.loads(json.dumps(entry)) == {
        "code": "lamps_alike",
        "message": "Too alike.",
        "figures": {"angle_deg": 3.1235, "count": 2},
    }


def test_codes_are_words_and_no_two_are_alike() -> None:
    assert all(code.value == code.name.lower() for code in Code)
    assert len({code.value for code in Code}) == len(Code)


def test_every_code_is_in_the_guide() -> None:
    guide = (Path(__file__).parents[3] / "docs/results.md").read_text()
    assert [code.value for code in Code if f"`{code}`" not in guide] == []
