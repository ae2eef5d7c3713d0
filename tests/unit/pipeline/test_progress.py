from __future__ import annotations

import pytest

from pipeline.errors import Canceled
from pipeline.progress import STAGES, Progress


def test_reports_reach_the_caller_within_zero_and_one() -> None:
    seen: list[tuple[str, float]] = []
    progress = Progress(lambda stage, fraction: seen.append((stage, fraction)))

    for fraction in (-0.5, 0.0, 0.25, 1.0, 1.5):
        progress.report("align", fraction)

    assert seen == [("align", value) for value in (0.0, 0.0, 0.25, 1.0, 1.0)]


def test_a_canceled_run_stops_before_it_reports() -> None:
    seen: list[str] = []
    progress = Progress(lambda stage, _: seen.append(stage), lambda: True)

    with pytest.raises(Canceled, match=r"^The job was canceled\.$"):
        progress.report("decode", 0.0)

    assert seen == []


def test_ticks_go_from_start_to_end_and_no_farther() -> None:
    seen: list[tuple[str, float]] = []
    tick = Progress(lambda stage, fraction: seen.append((stage, fraction))).ticks(
        "lamps", 0.5, 1.0, 2
    )

    for _ in range(4):
        tick()

    assert seen == [("lamps", value) for value in (0.5, 0.75, 1.0, 1.0)]


def test_nobody_need_listen() -> None:
    assert [rows.stop for rows in Progress().strips("layers", 5, 2)] == [2, 4, 5]


@pytest.mark.parametrize(
    ("height", "rows", "expected"),
    [
        (10, 4, [(0, 4), (4, 8), (8, 10)]),
        (8, 4, [(0, 4), (4, 8)]),
        (3, 256, [(0, 3)]),
        (3, 1, [(0, 1), (1, 2), (2, 3)]),
    ],
)
def test_strips_cover_every_row_once(
    height: int, rows: int, expected: list[tuple[int, int]]
) -> None:
    strips = list(Progress().strips("layers", height, rows))

    assert [(strip.start, strip.stop) for strip in strips] == expected


def test_strips_report_their_part_of_the_stage() -> None:
    seen: list[tuple[str, float]] = []
    progress = Progress(lambda stage, fraction: seen.append((stage, fraction)))

    list(progress.strips("layers", 8, 2, start=0.2, end=0.6))

    assert [stage for stage, _ in seen] == ["layers"] * 5
    assert [fraction for _, fraction in seen] == pytest.approx([0.2, 0.3, 0.4, 0.5, 0.6])


@pytest.mark.parametrize("stop_after", [0, 1, 2])
def test_cancel_is_asked_before_every_strip(stop_after: int) -> None:
    done: list[slice] = []
    progress = Progress(canceled=lambda: len(done) == stop_after)

    with pytest.raises(Canceled):
        for rows in progress.strips("layers", 6, 2):
            done.append(rows)

    assert len(done) == stop_after


def test_stages_are_in_the_order_of_the_work() -> None:
    assert STAGES == ("decode", "align", "lamps", "layers", "encode")
