from __future__ import annotations

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.colour.curves import srgb_to_linear
from pipeline.images.coded_image import TableImage
from pipeline.images.frames import Frame
from pipeline.images.noise import Noise
from pipeline.pair.tone_curve import KNOTS, ToneCurve

HALVED_BELOW_WHITE = ToneCurve(np.log(np.where(KNOTS < 1, 0.5, 1.0)))
RISING = ToneCurve(np.linspace(-1.0, 0.0, len(KNOTS)))


def test_light_is_that_of_srgb_times_the_curve_at_its_code_value() -> None:
    codes = np.array([0.2, 0.25, 0.6, 1.0])

    light = RISING.light(srgb_to_linear(codes).astype(np.float32))

    assert light.dtype == np.float32
    np.testing.assert_allclose(light, srgb_to_linear(codes) * np.exp(codes - 1), rtol=1e-5)


@pytest.mark.parametrize(
    ("logs", "rises"),
    [
        (np.zeros(11), True),
        (np.linspace(-1.0, 0.0, 11), True),
        (-np.log(np.maximum(srgb_to_linear(KNOTS), 1e-3) / np.maximum(KNOTS, 0.05)), True),
        ((0.0, 0.0, 0.0, 0.0, -0.4, -0.4, -0.4, -0.4, -0.4, -0.4, 0.0), False),
        ((1.4, 1.4, 0.9, 0.3, -0.2, -0.6, -0.9, -0.9, -0.9, -0.7, 0.0), False),
    ],
)
def test_light_rises_at_least_in_proportion_to_code_values(logs: Floats64, rises: bool) -> None:
    assert ToneCurve(0.999 * np.array(logs)).rises is rises


def test_beyond_black_and_white_light_goes_on_in_proportion() -> None:
    light = RISING.light(np.array([-0.01, 0.0, 1.5], np.float32))

    np.testing.assert_allclose(light, [-0.01 * np.exp(-1), 0.0, 1.5], rtol=1e-6)


def test_code_values_and_floats_become_the_same_light() -> None:
    codes = np.random.default_rng(1).integers(0, 256, (70, 5, 3), dtype=np.uint8)
    table = srgb_to_linear(np.arange(256, dtype=np.float32) / 255)
    coded, floats = TableImage(codes, table), table[codes]

    of_codes, of_floats = RISING.photograph(coded), RISING.photograph(floats)

    assert isinstance(of_codes, TableImage)
    np.testing.assert_allclose(of_codes[:], RISING.light(floats), rtol=1e-6)
    np.testing.assert_allclose(of_floats[:], RISING.light(floats), rtol=2e-4)
    np.testing.assert_array_equal(floats, table[codes])


def test_floats_beyond_black_and_white_go_on_in_proportion() -> None:
    floats = np.tile(np.array([-0.01, 0.0, 1.5], np.float32), (2, 2, 1))

    light = RISING.photograph(floats)

    np.testing.assert_allclose(light[1, 1], [-0.01 * np.exp(-1), 0.0, 1.5], rtol=1e-5)


def test_pixels_of_ones_own_are_written_over() -> None:
    floats = np.full((3, 4, 3), 0.2, np.float32)

    light = RISING.photograph(floats, own=True)

    assert light is floats
    np.testing.assert_allclose(light, RISING.light(np.array([0.2], np.float32))[0], rtol=1e-4)


def test_the_noise_of_compression_is_brought_through_the_curve() -> None:
    """Where light is halved noise is a quarter in variance: half per light, a quarter of floor."""
    curve = ToneCurve(np.full(len(KNOTS), np.log(0.5)))

    noise = curve.noise(Noise(np.full(3, 2e-4), np.full(3, 1e-5), 4.0))

    np.testing.assert_allclose(noise.gain, 1e-4, rtol=1e-3)
    np.testing.assert_allclose(noise.floor, 0.25e-5, rtol=1e-2)
    assert noise.grain == 4.0


@pytest.mark.parametrize("known", [True, False])
def test_a_frame_keeps_all_but_its_light_and_noise(known: bool) -> None:
    noise = Noise(np.full(3, 2e-4), np.full(3, 1e-5)) if known else None
    frame = Frame(
        pixels=np.full((2, 2, 3), 0.3, np.float32),
        saturated=np.eye(2, dtype=bool),
        encoding="srgb",
        sha256="ab",
        compression=noise,
    )

    toned = HALVED_BELOW_WHITE.frame(frame)

    np.testing.assert_allclose(toned.pixels[:], 0.15, rtol=1e-6)
    assert toned.saturated is frame.saturated
    assert toned.encoding == "srgb"
    assert (toned.compression is not None) is known
    if toned.compression is not None:
        assert (toned.compression.gain < 2e-4).all()


def test_the_entry_tells_the_light_of_code_values() -> None:
    entry = HALVED_BELOW_WHITE.entry()

    assert entry["codes"] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    assert entry["light"][5] == pytest.approx(0.2140411 / 2, abs=1e-5)
    assert entry["light"][10] == 1.0
