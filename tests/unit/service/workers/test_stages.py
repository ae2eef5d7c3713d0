from __future__ import annotations

import pytest
from prometheus_client import REGISTRY

from service.workers.stages import Stages


def _observed(stage: str) -> float:
    return REGISTRY.get_sample_value("lightlayers_stage_seconds_sum", {"stage": stage}) or 0.0


def test_each_stage_lasts_until_the_next_one_or_the_end() -> None:
    moments = iter([0.0, 1.0, 1.0, 3.0, 3.0, 3.5, 3.5, 7.25])
    before = _observed("decode")
    stages = Stages(lambda: next(moments))
    for stage in ("fetch", "decode", "decode", "store", "decode"):
        stages.enter(stage)
    assert stages.seconds == {"fetch": 1.0, "decode": 2.0, "store": 0.5}
    stages.end()
    assert stages.seconds == {"fetch": 1.0, "decode": 5.75, "store": 0.5}
    stages.end()  # once more is no end of anything
    assert stages.seconds["decode"] == 5.75
    assert _observed("decode") - before == pytest.approx(5.75)
