from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa
from prometheus_client import REGISTRY

from service import metrics, reference
from service.settings import Settings

_GUIDE = Path(__file__).parents[3] / "docs" / "operating.md"


def test_the_guide_has_every_setting_as_it_is() -> None:
    guide = _GUIDE.read_text()
    assert reference.table() in guide, "run: python -m service.reference, and paste it"


def test_every_setting_says_what_it_is() -> None:
    for name, field in Settings.model_fields.items():
        assert field.description and field.description.endswith("."), name


def test_the_guide_names_every_metric(engine: sa.Engine) -> None:
    guide = _GUIDE.read_text()
    families = [*REGISTRY.collect(), *metrics.Database(engine, 15).collect()]
    ours = {family.name for family in families if family.name.startswith("lightlayers_")}
    assert len(ours) == 9
    for name in ours:
        assert f"| `{name}" in guide
