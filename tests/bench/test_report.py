from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from tests.bench.report import draw_profile, report


@pytest.fixture
def figures() -> dict[str, Any]:
    def job(cpu_s: float) -> dict[str, Any]:
        return {
            "cpu_s": cpu_s,
            "wall_s": 5.0,
            "peak_mb": 700.0,
            "floor_ratio": 1.5,
            "stages_cpu_s": {"decode": 0.5, "layers": cpu_s - 0.5},
            "floor_cpu_s": {"decode": 0.25, "layers": 1.0},
        }

    return {
        "kernel": {"memcpy_ratio": 12.5, "numpy_speedup": 6.0, "solve_speedup": 29.0},
        "jobs": {"jpeg12_n2": job(2.9), "raw24_n3": job(7.5), "jpeg48_n2": job(9.0)},
        "align": {
            "cpu_s": 1.0,
            "error_px": 0.0213,
            "hugin_cpu_ratio": None,
            "hugin_error_px": None,
        },
        "start": {
            "first_byte_s": 0.03,
            "worst_first_byte_s": 0.4,
            "cpu_s": 0.024,
            "bare_wall_s": 0.02,
            "bare_cpu_s": 0.016,
        },
        "quality": {
            "best": {"two_db": 29.54, "three_db": 20.3, "cpu_ratio": 1.0},
            "fast": {"two_db": 28.0, "three_db": 18.7, "cpu_ratio": 0.456},
        },
        "normals": {"cpu_s": 61.0, "without_cpu_s": 9.96},
        "growth": {"pixels4_cpu_ratio": 4.0, "parallel2_speedup": 1.7, "parallel2_cpu_ratio": 1.05},
    }


def test_the_page_says_what_is_met(figures: dict[str, Any]) -> None:
    lines = report(figures).splitlines()

    def cells(start: str) -> list[str]:
        row = next(line for line in lines if line.startswith(f"| {start} |"))
        return [cell.strip() for cell in row.strip("|").split("|")][1:]

    assert cells("jpeg12_n2: CPU, s") == ["2.9", "≤ 3", "yes"]
    assert cells("jpeg12_n2: peak memory, MiB") == ["700", "≤ 512", "**no**"]
    assert cells("jpeg12_n2: CPU over the floor's") == ["1.5", "≤ 1.5", "yes"]
    assert cells("raw12_n3, with normals: CPU, s") == ["61", "≤ 60", "**no**"]
    assert cells("raw24_n3: CPU, s") == ["7.5", "≤ 7", "**no**"]
    assert cells("raw24_n3: peak memory, MiB") == ["700", "≤ 1126", "yes"]
    assert cells("raw24_n3: CPU over the floor's") == ["1.5", "≤ 1.5", "yes"]
    assert cells("per-pixel work: CPU over a copy of its bytes") == ["12.5", "≤ 12", "**no**"]
    assert cells("per-pixel work: times faster than NumPy") == ["6", "≥ 6", "yes"]
    assert cells("… than numpy.linalg.solve") == ["29", "≥ 30", "**no**"]
    assert cells("task: start to first byte of work, s") == ["0.03", "≤ 0.3", "yes"]
    assert cells("… the slowest, s") == ["0.4", "≤ 0.3", "**no**"]
    assert cells("… over a bare Python's whole run") == ["1.5", "", ""]
    assert cells("task: CPU of start and end, s") == ["0.024", "", ""]
    assert cells("… over a bare Python's") == ["1.5", "", ""]
    assert cells("four times the pixels: CPU") == ["4", "≤ 4.4", "yes"]
    assert cells("two jobs at once: throughput") == ["1.70", "", ""]
    assert cells("alignment: error at the corners, px") == ["0.021", "", ""]
    assert cells("alignment beside align_image_stack") == ["not installed", "", ""]
    assert cells("… CPU over one after the other") == ["1.05", "", ""]
    assert cells("best") == ["29.5", "20.3", "1.00"]
    assert cells("fast") == ["28.0", "18.7", "0.46"]
    assert cells("jpeg48_n2") == ["48", "2", "9.0", "5.0", "700", "1.5"]
    assert cells("raw24_n3, floor") == ["", "0.25", "", "", "1.00", ""]


def test_another_program_that_is_there_is_shown(figures: dict[str, Any]) -> None:
    figures["align"] |= {"hugin_cpu_ratio": 21.0, "hugin_error_px": 0.12}

    page = report(figures)

    assert "| align_image_stack: CPU over ours | 21 | ≥ 20 | yes |" in page
    assert "| align_image_stack: error at the corners, px | 0.120 |" in page
    figures["align"] |= {"hugin_cpu_ratio": 19.0, "hugin_error_px": None}
    page = report(figures)
    assert "| align_image_stack: CPU over ours | 19 | ≥ 20 | **no** |" in page
    assert "| align_image_stack: error at the corners, px | none found |" in page


def test_the_picture_has_a_bar_for_each_job(figures: dict[str, Any], tmp_path: Path) -> None:
    draw_profile(figures["jobs"], tmp_path / "profile.png")

    with Image.open(tmp_path / "profile.png") as picture:
        assert picture.width == 800
        colours = picture.convert("RGB").getcolors(1 << 20) or []
    # decode and layers, the second and fifth colour of the plots
    assert {(255, 127, 14), (148, 103, 189)} <= {colour for _, colour in colours}
