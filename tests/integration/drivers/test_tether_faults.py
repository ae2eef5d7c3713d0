"""A short form of python -m tests.tether.faults."""

from __future__ import annotations

from tests.tether.faults import fault_sequences, mutate_initiators, mutate_packets


def test_random_faults_end_in_a_true_pair_or_an_error_of_the_drivers() -> None:
    told = fault_sequences(60, seed=2)
    assert told["pair"] > 20
    assert len(told) > 8


def test_mutated_packets_end_in_answers_or_errors_of_the_drivers() -> None:
    told = mutate_packets(300, seed=2)
    assert told["ProtocolError"] > 50


def test_mutated_packets_do_not_end_the_simulated_camera() -> None:
    mutate_initiators(120, seed=2)
