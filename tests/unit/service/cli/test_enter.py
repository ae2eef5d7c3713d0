"""Presses of Enter on a terminal, and lines of a program on a pipe."""

from __future__ import annotations

import os
import pty
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.cli.enter import await_enter, forget_typed, pause


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Its end to write to; stdin is the other."""
    reader, writer = os.pipe()
    with os.fdopen(reader) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield writer


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Where to type; stdin is the terminal."""
    keyboard, screen = pty.openpty()
    with os.fdopen(screen) as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        yield keyboard
    os.close(keyboard)


def test_lines_that_come_at_once_are_presses_each(pipe: int) -> None:
    os.write(pipe, b"\nyes\n")
    assert [await_enter(60), await_enter(60), await_enter(0)] == [True, True, False]
    os.write(pipe, b"\n")
    forget_typed()  # a program has not typed ahead
    assert await_enter(60)
    os.close(pipe)
    assert not await_enter()


def test_a_last_line_without_an_end_is_a_press(pipe: int) -> None:
    os.write(pipe, b"yes")
    os.close(pipe)
    assert [await_enter(), await_enter()] == [True, False]


def test_what_was_typed_before_the_question_is_no_answer(terminal: int) -> None:
    os.write(terminal, b"\n\n")
    assert await_enter(60)
    forget_typed()
    assert not await_enter(0)
    os.write(terminal, b"\n")
    assert await_enter(60)


def test_the_end_of_typing_is_no_press(terminal: int) -> None:
    os.write(terminal, b"\n\x04")
    assert [await_enter(60), await_enter(60)] == [True, False]


def test_a_pause_ends_with_what_is_typed_and_drops_the_rest(terminal: int) -> None:
    os.write(terminal, b"\n\n")
    pause(0.1)
    assert not await_enter(0)
    os.write(terminal, b"\nyes\n\x04")
    with pytest.raises(EOFError):
        pause(60)


def test_a_pause_leaves_the_lines_of_a_program_and_ends_after_them(
    pipe: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    class AsleepError(Exception):
        pass

    def sleep(seconds: float) -> None:
        raise AsleepError(round(seconds))

    os.write(pipe, b"\n")
    os.close(pipe)
    with monkeypatch.context() as patched, pytest.raises(AsleepError, match="60"):
        patched.setattr("service.cli.enter.time.sleep", sleep)
        pause(60)
    assert await_enter(60)
    with pytest.raises(EOFError):
        pause(60)


def test_a_pause_without_a_terminal_or_a_program_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr("sys.stdin", nothing)
        pause(0.01)
