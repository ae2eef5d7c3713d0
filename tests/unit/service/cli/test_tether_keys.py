"""A service that wants a key; it comes from the environment or a file, and stays hidden."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest

from service.api.context import Context
from service.rows import keys
from service.sending import sender


def test_a_key_that_may_submit_is_enough(
    tether: Callable[..., int],
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with context.engine.begin() as connection:
        key = keys.create(connection, "agent", {keys.Scope.SUBMIT}, keys.Quotas(), None)
    monkeypatch.setenv("LIGHTLAYERS_KEY", key)
    assert tether(lines="\n") == 0
    said = capsys.readouterr()
    assert key.rpartition("_")[2] not in said.out + said.err


def test_without_one_all_pairs_wait(
    tether: Callable[..., int],
    context: Context,
    waiting: Callable[[], int],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with context.engine.begin() as connection:
        keys.create(connection, "somebody", {keys.Scope.SUBMIT}, keys.Quotas(), None)
    held = threading.Event()
    hold_up = sender.Sender._hold_up

    def noted(own: sender.Sender, reason: str) -> None:
        hold_up(own, reason)
        held.set()

    def interrupted(_own: sender.Sender) -> None:
        assert held.wait(60)
        raise KeyboardInterrupt

    monkeypatch.setattr(sender.Sender, "_hold_up", noted)
    monkeypatch.setattr(sender.Sender, "finish", interrupted)
    assert tether(lines="\n") == 130
    assert "This service needs a key" in capsys.readouterr().err
    assert waiting() == 1
