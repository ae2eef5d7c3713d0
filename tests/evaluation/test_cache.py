from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from tests.evaluation import cache, render
from tests.evaluation.geometry import Geometry, Lamp, Shape
from tests.evaluation.patterns import Pattern
from tests.evaluation.transport import BandTransport, Transport

SIZE = (16, 12)
BALL = Shape("sphere", (0, 0.4, 0), (0.4, 0.4, 0.4), Pattern("plain", (0,)))
SCENE = Geometry((BALL,), (Lamp((1, 2, 2)),))
WHITE = np.ones((1, len(WAVELENGTHS_NM)))
LIGHT = np.ones((len(WAVELENGTHS_NM), 3))


@pytest.fixture(autouse=True)
def empty(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


def no_rendering(*_: object) -> Transport:
    raise AssertionError("rendered again")


@pytest.mark.parametrize("depth", [2, 3])
def test_what_is_read_is_what_was_rendered(monkeypatch: pytest.MonkeyPatch, depth: int) -> None:
    scene = replace(SCENE, depth=depth)
    first = cache.transport(scene, WHITE, SIZE).picture(0, LIGHT, WHITE)
    monkeypatch.setattr(render, "render", no_rendering)

    again = cache.transport(scene, WHITE, SIZE).picture(0, LIGHT, WHITE)

    np.testing.assert_array_equal(first, again)
    assert first.max() > 1


def test_gloss_is_kept() -> None:
    scene = replace(SCENE, roughness=0.3)
    first = cache.transport(scene, WHITE, SIZE).picture(0, LIGHT, 0 * WHITE)
    again = cache.transport(scene, WHITE, SIZE).picture(0, LIGHT, 0 * WHITE)
    np.testing.assert_array_equal(first, again)
    assert first.max() > 0


def test_a_file_cut_short_is_rendered_anew() -> None:
    whole = cache.transport(SCENE, WHITE, SIZE).picture(0, LIGHT, WHITE)
    (path,) = cache.folder().iterdir()
    path.write_bytes(path.read_bytes()[:500])

    np.testing.assert_array_equal(
        cache.transport(SCENE, WHITE, SIZE).picture(0, LIGHT, WHITE), whole
    )
    assert [p.suffix for p in cache.folder().iterdir()] == [".npz"]


def test_another_scene_is_another_file_and_colours_matter_only_with_bounces() -> None:
    cache.transport(SCENE, WHITE, SIZE)
    cache.transport(SCENE, 0.5 * WHITE, SIZE)
    assert len(list(cache.folder().iterdir())) == 1

    cache.transport(replace(SCENE, lamps=(Lamp((0, 2, 2)),)), WHITE, SIZE)
    assert len(list(cache.folder().iterdir())) == 2

    bounces = replace(SCENE, depth=3)
    light, dark = (cache.transport(bounces, x * WHITE, SIZE) for x in (1, 0.5))
    assert len(list(cache.folder().iterdir())) == 4
    assert isinstance(light, BandTransport)
    assert isinstance(dark, BandTransport)
    assert dark.bands.max() == pytest.approx(light.bands.max() / 2, rel=1e-3)
