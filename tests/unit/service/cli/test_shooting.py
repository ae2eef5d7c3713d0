from __future__ import annotations

from datetime import UTC, datetime
from itertools import islice
from types import SimpleNamespace

import pytest

import drivers
from pipeline.errors import OptionError
from service.cli import shooting
from service.cli.shooting import ending, new_shot, paced, wanted_settings


@pytest.mark.parametrize(
    ("typed", "value"),
    [
        ("200", 200),
        (" 200 ", 200),
        ("2e2", 200),
        ("5.6", 5.6),
        ("1/60", 1 / 60),
        ("10/5", 2),
        ("0.5/2", "0.5/2"),
        ("high", "high"),
        ("", ""),
        ("1=2", "1=2"),
        ("1/0", "1/0"),
        ("nan", "nan"),
        ("-inf", "-inf"),
        ("1e400", "1e400"),
        (f"{10**400}/1", f"{10**400}/1"),
    ],
)
def test_a_setting_is_a_number_or_else_a_word(typed: str, value: drivers.SettingValue) -> None:
    (read,) = wanted_settings([f"iso={typed}"], None).values()
    assert (type(read), read) == (type(value), value)


def test_the_last_of_two_values_counts() -> None:
    read = wanted_settings(["iso=200", "f_number=8", "iso=400"], None)
    assert read == {drivers.SettingName.ISO: 400, drivers.SettingName.F_NUMBER: 8}
    assert wanted_settings(None, None) == {}


@pytest.mark.parametrize("typed", ["iso", "=200", "ISO=200", " iso=200", "colour=red"])
def test_a_name_that_there_is_not_is_told_with_those_that_there_are(typed: str) -> None:
    with pytest.raises(OptionError) as told:
        wanted_settings([typed], None)
    start, names = str(told.value).split(": write NAME=VALUE, where NAME is one of ")
    assert start == f"--set {typed}"
    assert set(names.removesuffix(".").split(", ")) == set(drivers.SettingName) - {"flash"}


class _Clock:
    """Time that passes only while somebody waits."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        passing = SimpleNamespace(monotonic=lambda: self.now, sleep=self.sleep)
        monkeypatch.setattr(shooting, "time", passing)

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0
        self.now += seconds


@pytest.mark.parametrize(
    ("takes", "begun"),
    [
        ([0, 0, 0, 0], [0, 10, 20, 30]),
        ([4, 9, 0, 0], [0, 10, 20, 30]),
        ([25, 0, 3, 0], [0, 25, 35, 45]),  # what was missed is not made up for
    ],
)
def test_pairs_begin_at_even_distances(
    takes: list[float], begun: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, told = _Clock(monkeypatch), []
    for number in paced(4, 10.0):
        told.append((number, clock.now - 1000.0))
        clock.sleep(takes[number - 1])
    assert told == list(enumerate(begun, 1))


@pytest.mark.parametrize(("count", "numbers"), [(0, []), (2, [1, 2]), (None, [1, 2, 3, 4, 5])])
def test_pairs_are_as_many_as_were_asked_for_or_have_no_end(
    count: int | None, numbers: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = _Clock(monkeypatch)
    assert list(islice(paced(count, 0.0), 5)) == numbers
    assert clock.now == 1000.0


def test_a_shot_is_named_by_its_time_in_utc(monkeypatch: pytest.MonkeyPatch) -> None:
    class Then(datetime):
        @classmethod
        def now(cls, tz: object = None) -> Then:
            assert tz is UTC
            return cls(2024, 2, 29, 3, 4, 5, 6_999)

    monkeypatch.setattr(shooting, "datetime", Then)
    assert new_shot() == "20240229T030405-006Z"


def test_files_end_as_their_kind_is_called() -> None:
    assert [ending(kind) for kind in ("jpeg", "dng", "cr3")] == ["jpg", "dng", "cr3"]
