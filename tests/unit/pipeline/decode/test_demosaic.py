"""Three channels of a mosaic."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.arrays import Floats64
from pipeline.decode import demosaic as demosaicing
from pipeline.decode.demosaic import is_bayer
from pipeline.decode.samples import upright
from pipeline.images.frames import Image
from tests.definitions.mosaics import demosaiced

BLACK = np.array([[600.0, 610.0], [620.0, 640.0]])
WHITE = 15292.0
PHASES = [[[0, 1], [1, 2]], [[1, 0], [2, 1]], [[1, 2], [0, 1]], [[2, 1], [1, 0]]]
Colours = NDArray[np.int64]


def demosaic(mosaic: NDArray[np.uint16], colours: Colours, black: Floats64, white: float) -> Image:
    """The light that comes out."""
    return demosaicing.demosaic(mosaic, colours, black, white)[:]


def measured(scene: Floats64, colours: Colours) -> NDArray[np.uint16]:
    """What photosites of these colours give for a scene (H, W, 3), white at 1."""
    places = np.ix_(*(np.arange(size) % 2 for size in scene.shape[:2]))
    channel = colours[places]
    light = np.take_along_axis(scene, channel[..., None], axis=2)[..., 0]
    return np.asarray(np.rint(BLACK[places] + light * WHITE), np.uint16)


def light_of(mosaic: NDArray[np.uint16]) -> Floats64:
    places = np.ix_(*(np.arange(size) % 2 for size in mosaic.shape))
    return np.asarray((mosaic - BLACK[places]) / WHITE)


def textured(height: int, width: int, seed: int = 0) -> Floats64:
    """Spots of any brightness, some black, some white, in channels of different balance."""
    random = np.random.default_rng(seed)
    coarse = random.uniform(-0.05, 1.4, (height // 3 + 1, width // 3 + 1, 1))
    spots = coarse.repeat(3, 0).repeat(3, 1)[:height, :width]
    colours = random.uniform(0.8, 1.2, (height, width, 3)) * [0.4, 0.9, 0.6]
    return np.asarray(np.maximum(spots * colours, -0.03))


@pytest.fixture(params=PHASES, ids=["rggb", "grbg", "gbrg", "bggr"])
def colours(request: pytest.FixtureRequest) -> Colours:
    return np.array(request.param)


@pytest.mark.parametrize(
    "size", [(2, 2), (3, 2), (5, 4), (17, 40), (64, 64), (257, 261), (40, 530)]
)
def test_it_computes_what_the_definition_says(colours: Colours, size: tuple[int, int]) -> None:
    mosaic = measured(textured(*size), colours)

    pixels = demosaic(mosaic, colours, BLACK, WHITE)

    assert pixels.dtype == np.float32
    np.testing.assert_allclose(pixels, demosaiced(light_of(mosaic), colours), atol=2e-5)


def test_what_was_measured_stays(colours: Colours) -> None:
    mosaic = measured(textured(30, 37), colours)

    pixels = demosaic(mosaic, colours, BLACK, WHITE)

    channel = colours[np.ix_(np.arange(30) % 2, np.arange(37) % 2)]
    kept = np.take_along_axis(pixels, channel[..., None], axis=2)[..., 0]
    np.testing.assert_allclose(kept, np.minimum(light_of(mosaic), 1), atol=1e-7)
    assert kept.min() < 0


@pytest.mark.parametrize("white", [200.0, 4095.0, 15871.0, 65535.0])
@pytest.mark.parametrize("black", [0.0, 64.0, 512.0])
def test_sensors_of_any_depth_keep_what_they_measured(white: float, black: float) -> None:
    """Within half a step of 16 bits, or less; dark and bright photosites alike."""
    most = min(black + white, 65535.0)
    mosaic = np.random.default_rng(3).integers(0, int(most) + 1, (20, 20)).astype(np.uint16)
    mosaic[:2, :2], mosaic[2:4, 2:4] = 0, int(most)

    pixels = demosaic(mosaic, np.array(PHASES[0]), np.full((2, 2), black), white)

    reds, light = pixels[::2, ::2, 0], (mosaic[::2, ::2] - black) / white
    np.testing.assert_allclose(reds, light, atol=6e-8 if white < 2**15 else 8e-6)


@pytest.mark.parametrize("size", [(2, 2), (7, 5), (31, 300)])
def test_one_colour_stays_one_colour_up_to_the_border(
    colours: Colours, size: tuple[int, int]
) -> None:
    scene = np.full((*size, 3), [0.11, 0.52, 0.33])

    pixels = demosaic(measured(scene, colours), colours, BLACK, WHITE)

    np.testing.assert_allclose(pixels, scene, atol=0.7 / WHITE)  # rounded to whole numbers


def test_a_gradient_on_a_surface_of_one_colour_is_kept(colours: Colours) -> None:
    x, y = np.meshgrid(np.linspace(0.2, 0.9, 80), np.linspace(1, 0.5, 60))
    scene = (x * y)[..., None] * [0.4, 1.0, 0.6]

    pixels = demosaic(measured(scene, colours), colours, BLACK, WHITE)

    np.testing.assert_allclose(pixels[5:-5, 5:-5], scene[5:-5, 5:-5], atol=1e-4)


@pytest.mark.parametrize("turned", [False, True])
def test_stripes_are_followed(colours: Colours, turned: bool) -> None:
    """Stripes of two pixels, along which their brightness is constant, in one colour."""
    stripes = np.where(np.arange(64) // 2 % 2, 0.8, 0.3)[:, None] * np.ones(64)
    scene = (stripes.T if turned else stripes)[..., None] * [0.5, 1.0, 0.7]

    pixels = demosaic(measured(scene, colours), colours, BLACK, WHITE)

    error = np.square(pixels - scene)[6:-6, 6:-6].mean() / np.square(scene).mean()
    assert 10 * np.log10(error) < -28


def test_channels_of_another_balance_come_out_alike(colours: Colours) -> None:
    """No decision depends on which channel is brighter; what differs is near black."""
    scene = np.clip(textured(60, 60, 3), 0.2, 0.5)
    gains = np.array([1.0, 0.4, 0.7])

    one = demosaic(measured(scene, colours), colours, BLACK, WHITE)
    other = demosaic(measured(scene * gains, colours), colours, BLACK, WHITE)

    np.testing.assert_allclose(other / gains, one, atol=0.02)


def test_a_pair_keeps_its_ratio(colours: Colours) -> None:
    """A fine pattern under two lights of different colours: the pattern does not show in it."""
    pattern = np.random.default_rng(1).uniform(0.2, 0.9, (80, 80, 1))
    lights = np.array([[0.9, 0.6, 0.3], [0.4, 0.7, 0.8]])

    first, second = (
        demosaic(measured(pattern * light, colours), colours, BLACK, WHITE) for light in lights
    )

    ratio = (first / second)[4:-4, 4:-4]
    np.testing.assert_allclose(
        ratio, np.broadcast_to(lights[0] / lights[1], ratio.shape), rtol=0.25
    )


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_turned_mosaic_gives_the_turned_picture(colours: Colours, orientation: int) -> None:
    mosaic = measured(textured(50, 64), colours)
    turned = upright(colours, orientation), upright(BLACK, orientation)

    pixels = demosaic(upright(mosaic, orientation), *turned, WHITE)

    straight = demosaic(mosaic, colours, BLACK, WHITE)
    np.testing.assert_allclose(pixels, upright(straight, orientation), atol=2e-5)


def test_a_part_of_a_picture_gives_that_part(colours: Colours) -> None:
    """However it falls on tiles; but for the border, 9 pixels wide."""
    mosaic = measured(textured(300, 290), colours)

    whole = demosaic(mosaic, colours, BLACK, WHITE)
    part = demosaic(mosaic[20:, 30:], colours, BLACK, WHITE)

    np.testing.assert_array_equal(part[9:, 9:], whole[29:, 39:])


def test_nothing_is_above_white(colours: Colours) -> None:
    scene = np.full((20, 20, 3), 0.95)
    scene[8:12, 8:12] = 3.0

    pixels = demosaic(measured(scene, colours), colours, BLACK, WHITE)

    assert pixels.max() == 1
    assert pixels[9:11, 9:11].min() > 0.99


def test_black_is_black(colours: Colours) -> None:
    pixels = demosaic(measured(np.zeros((20, 30, 3)), colours), colours, BLACK, WHITE)

    assert np.abs(pixels).max() < 1e-6


def test_noise_around_black_stays_around_black(colours: Colours) -> None:
    noise = np.random.default_rng(0).normal(0, 3e-4, (100, 100, 3))

    pixels = demosaic(measured(noise, colours), colours, BLACK, WHITE)

    np.testing.assert_allclose(pixels.mean((0, 1)), 0, atol=3e-5)
    assert pixels.std() < 4e-4


@pytest.mark.parametrize("shape", [(1, 8), (8, 1), (0, 4), (8,), (4, 4, 3)])
def test_what_is_no_mosaic_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="no mosaic"):
        demosaic(np.zeros(shape, np.uint16), np.array(PHASES[0]), BLACK, WHITE)


@pytest.mark.parametrize(
    "colours",
    [
        [[0, 1], [2, 1]],
        [[1, 1], [0, 2]],
        [[0, 1], [1, 0]],
        [[0, 1], [1, 3]],
        [[0, 2], [1, 1]],
        [[0, 1, 1], [1, 2, 1], [1, 1, 0]],
    ],
)
def test_other_patterns_are_refused(colours: list[list[int]]) -> None:
    assert not is_bayer(np.array(colours))
    with pytest.raises(ValueError, match="no Bayer pattern"):
        demosaic(np.zeros((8, 8), np.uint16), np.array(colours), BLACK, WHITE)


def test_the_four_bayer_patterns_are_known(colours: Colours) -> None:
    assert is_bayer(colours)
