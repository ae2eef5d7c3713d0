from __future__ import annotations

from pipeline.result_names import lamp_name, layer_channels


def test_lamps_are_counted_from_1() -> None:
    assert [lamp_name(lamp) for lamp in range(3)] == ["lamp1", "lamp2", "lamp3"]


def test_layers_have_the_channels_that_are_promised() -> None:
    """As docs/results.md says; programs of others look for them."""
    promised = ["lamp1.R", "lamp1.G", "lamp1.B", "lamp2.R", "lamp2.G", "lamp2.B"]
    assert layer_channels(2) == promised
