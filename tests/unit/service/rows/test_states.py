from __future__ import annotations

import pytest

from service.rows.states import ENDED, HELD, NEXT, State, before

ALLOWED = {
    ("queued", "running"),
    ("queued", "canceled"),
    ("queued", "failed"),
    ("running", "queued"),
    ("running", "canceling"),
    ("running", "waiting_for_operator"),
    ("waiting_for_operator", "running"),
    ("waiting_for_operator", "queued"),
    ("waiting_for_operator", "canceling"),
    ("waiting_for_operator", "failed"),
    ("running", "succeeded"),
    ("running", "failed"),
    ("canceling", "canceled"),
    ("succeeded", "expired"),
    ("failed", "expired"),
    ("canceled", "expired"),
}


@pytest.mark.parametrize("later", State)
@pytest.mark.parametrize("earlier", State)
def test_a_state_follows_another_only_where_the_table_says_so(earlier: State, later: State) -> None:
    allowed = (earlier.value, later.value) in ALLOWED
    assert (later in NEXT[earlier]) == allowed
    assert (earlier in before(later)) == allowed


def test_nothing_but_its_removal_follows_an_end() -> None:
    assert {later for state in ENDED for later in NEXT[state]} == {"expired"}
    assert set(ENDED) == {"succeeded", "failed", "canceled", "expired"}
    assert set(HELD) | {"queued"} == set(State) - set(ENDED)


def test_every_state_is_reached_from_the_first() -> None:
    reached = [State.QUEUED]
    for state in reached:
        reached += [later for later in NEXT[state] if later not in reached]
    assert set(reached) == set(State)
