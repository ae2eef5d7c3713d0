from __future__ import annotations

import subprocess

import pytest

from tests.bench.usage import Usage, cpu_of, medians, python, run


def test_memory_of_a_process_is_seen() -> None:
    held = bytearray(100_000_000)  # by the process that measures, which must not count

    small = run(python("-c", "pass"))
    large = run(python("-c", "import sys; bytearray(int(sys.argv[1]))", "200000000"))

    assert small.peak_mb < 60
    assert large.peak_mb - small.peak_mb == pytest.approx(len(held) * 2 / 2**20, abs=5)


def test_waiting_is_no_work() -> None:
    """A process that sleeps takes wall time and next to no CPU."""
    asleep = python("-S", "-c", "import time; time.sleep(1)")

    used = run(asleep)

    assert used.wall_s >= 1
    assert used.cpu_s < used.wall_s


def test_a_command_that_fails_is_told_with_what_it_said() -> None:
    with pytest.raises(subprocess.CalledProcessError) as error:
        run(python("-c", "import sys; sys.exit('no such pair')"))

    assert error.value.stderr.strip() == "no such pair"


def test_medians_are_of_each_figure() -> None:
    found = medians([Usage(1, 9, 5), Usage(2, 7, 6), Usage(3, 8, 4)])

    assert found == Usage(2, 8, 5)


def test_calls_are_made_by_turns_after_a_first_one() -> None:
    made: list[str] = []

    found = cpu_of({"a": lambda: made.append("a"), "b": lambda: made.append("b")}, rounds=2)

    assert made == ["a", "b", "a", "b", "a", "b"]
    assert found.keys() == {"a", "b"}
