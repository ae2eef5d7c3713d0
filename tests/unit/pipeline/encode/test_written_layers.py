"""Layered files, read back by the library's other half; see the integration tests for programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from psd_tools import PSDImage
from psd_tools.constants import BlendMode, Resource

from pipeline.arrays import Floats32, Floats64
from pipeline.colour.icc import linear_rec2020_profile
from pipeline.encode.psd import PsdFile
from pipeline.errors import OptionError

SIZE = (20, 90)
TURNED = np.array([[0, 1, 0], [0, 0, 1], [0.5, 0, 0]])
"""Red takes green, green takes blue, blue takes half of red."""


@pytest.fixture
def layers() -> Floats32:
    """Three layers whose sum is brighter than white in places, some of it below black."""
    rng = np.random.default_rng(2)
    return rng.uniform(-0.05, 0.5, (3, *SIZE[::-1], 3)).astype(np.float32)


def _written(path: Path, layers: Floats32) -> PSDImage:
    file = PsdFile(path, SIZE, len(layers), TURNED)
    for top in range(0, SIZE[1], 40):
        file.write(layers[:, top : top + 40])
    file.close()
    return PSDImage.open(path)


def _codes(light: Floats32) -> Floats64:
    return np.asarray(np.clip(light @ TURNED.T, 0, 1) * 65535)


def test_every_lamp_is_a_layer_of_16_bits(tmp_path: Path, layers: Floats32) -> None:
    document = _written(tmp_path / "layers.psd", layers)
    assert (document.size, document.depth) == (SIZE, 16)
    assert [layer.name for layer in document] == ["lamp1", "lamp2", "lamp3"]
    added = BlendMode.LINEAR_DODGE
    assert [layer.blend_mode for layer in document] == [BlendMode.NORMAL, added, added]
    for shown, light in zip(document, layers, strict=True):
        assert (shown.size, shown.opacity, shown.visible) == (SIZE, 255, True)
        np.testing.assert_allclose(shown.numpy() * 65535, _codes(light), atol=0.6)


def test_without_layers_it_is_their_sum(tmp_path: Path, layers: Floats32) -> None:
    document = _written(tmp_path / "layers.psd", layers)
    whole = np.minimum(sum(_codes(light) for light in layers), 65535)
    assert (whole >= 65535).any()
    np.testing.assert_allclose(document.numpy() * 65535, whole, atol=2)


def test_its_values_are_linear_rec2020(tmp_path: Path, layers: Floats32) -> None:
    document = _written(tmp_path / "layers.psd", layers[:1])
    profile = document.image_resources.get_data(Resource.ICC_PROFILE)
    assert profile == linear_rec2020_profile()


@pytest.mark.parametrize("size", [(30_001, 5), (5, 30_001), (20_000, 10_000)])
def test_what_the_format_cannot_hold_is_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    with pytest.raises(OptionError, match=r"layers\.psd cannot hold 2 layers .* leave it out"):
        PsdFile(tmp_path / "layers.psd", size, 2, TURNED)
    assert list(tmp_path.iterdir()) == []
