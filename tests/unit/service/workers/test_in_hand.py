from __future__ import annotations

import threading

from service.workers.in_hand import InHand


def test_an_entry_is_worked_on_once_at_a_time_and_others_beside_it() -> None:
    in_hand = InHand()
    told: list[str] = []

    def again() -> None:
        with in_hand.alone("a"):
            told.append("again")

    second = threading.Thread(target=again)
    with in_hand.alone("a"):
        second.start()
        with in_hand.alone("b"):
            assert in_hand.entries() == {"a", "b"}
        second.join(timeout=0.2)
        assert told == []
    second.join()
    assert told == ["again"]
    assert in_hand.entries() == set()


def test_a_stop_waits_for_a_step_that_has_begun() -> None:
    in_hand = InHand()
    stopping = threading.Thread(target=in_hand.stop, args=(60,))
    with in_hand.step():
        stopping.start()
        in_hand.pause(60)  # which ends as it is told to stop
        assert in_hand.is_stopping()
        stopping.join(timeout=0.2)
        assert stopping.is_alive()
    stopping.join(timeout=60)
    assert not stopping.is_alive()


def test_a_stop_waits_no_longer_than_it_may() -> None:
    in_hand = InHand()
    with in_hand.step():
        in_hand.stop(0.01)
    assert in_hand.is_stopping()


def test_no_step_begins_after_a_stop() -> None:
    in_hand = InHand()
    in_hand.stop(0)
    begun: list[bool] = []

    def work() -> None:
        with in_hand.step():
            begun.append(True)

    late = threading.Thread(target=work, daemon=True)  # it never returns
    late.start()
    late.join(timeout=0.2)
    assert late.is_alive()
    assert begun == []
