from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats64
from pipeline.calibration import matt_sphere as module
from pipeline.calibration.lamps_estimate import LampsEstimate
from pipeline.calibration.matt_sphere import matt_lamps
from pipeline.calibration.sphere_fit import SphereFit, SphereLight
from pipeline.errors import OptionError, UnusablePairError
from pipeline.images.noise import Noise
from pipeline.options import Circle, LampCount
from pipeline.pair.pair import Pair
from pipeline.vectors import unit
from tests.targets import CIRCLE, FOCAL_PX, Shot, photograph_sphere

THREE = unit(np.array([(-0.9, 0.3, 0.2), (0.2, 0.7, 0.6), (0.7, -0.5, 0.4)]))
COLOURS = np.array([(0.3, 0.2, 0.1), (0.25, 0.2, 0.12), (0.2, 0.25, 0.15)])
FLASH = np.array([0.8, 1.0, 0.6])
MARKED = Circle(**CIRCLE)


def _errors(found: LampsEstimate, directions: Floats64) -> tuple[Floats64, tuple[int, ...]]:
    """Angles in degrees in the best order, and which lamp found is each."""
    angles = np.degrees(np.arccos(np.clip(directions @ found.directions.T, -1, 1)))
    rows = np.arange(len(directions))
    order = min(permutations(rows), key=lambda order: angles[rows, list(order)].sum())
    return angles[rows, list(order)], tuple(int(i) for i in order)


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("count", [1, 2, 3])
def test_exact_light_gives_exact_lamps(pair_of: Callable[..., Pair], count: int) -> None:
    pair = pair_of(photograph_sphere(THREE[:count], COLOURS[:count]))
    found = matt_lamps(pair, MARKED, "auto", FOCAL_PX)
    assert len(found.directions) == count
    errors, order = _errors(found, THREE[:count])
    assert errors == pytest.approx(0, abs=0.1)
    # the strongest green comes first
    assert (np.diff(found.colours[:, 1]) <= 1e-9).all()
    ratio = found.colours[list(order)] / COLOURS[:count]
    assert ratio / ratio[0, 0] == pytest.approx(np.ones((count, 3)), rel=0.01)
    assert found.misfit is not None and found.misfit < 0.002
    assert found.flash_aside_deg is not None and found.flash_aside_deg < 0.1


@pytest.mark.usefixtures("coarse")
def test_an_outline_marked_aside_is_mended(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS))
    true = matt_lamps(pair, MARKED, 3, FOCAL_PX).circle
    aside = Circle(x=MARKED.x + 1.5, y=MARKED.y - 1, radius=MARKED.radius - 1.2)
    found = matt_lamps(pair, aside, 3, FOCAL_PX)
    assert _errors(found, THREE)[0] == pytest.approx(0, abs=0.2)
    for name in ("x", "y", "radius"):
        assert getattr(found.circle, name) == pytest.approx(getattr(true, name), abs=0.05)


@pytest.mark.usefixtures("coarse")
def test_a_flash_beside_the_lens_is_seen_and_allowed_for(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS, flash_at=(0.1, 0.0)))
    found = matt_lamps(pair, MARKED, 3, FOCAL_PX)
    assert found.flash_aside_deg == pytest.approx(np.degrees(np.arctan(0.1)), abs=0.1)
    assert _errors(found, THREE)[0] == pytest.approx(0, abs=0.1)


def test_noise_and_uneven_paint_cost_little(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS, noise=1.0, paint=0.05))
    found = matt_lamps(pair, MARKED, "auto", FOCAL_PX)
    errors, order = _errors(found, THREE)
    assert errors.max() < 0.6
    deviations = found.deviations_deg[list(order)]
    assert (errors < 5 * deviations + 0.05).all()
    assert (deviations < 1).all()


def test_paint_of_two_greys_is_told_from_shading(pair_of: Callable[..., Pair]) -> None:
    shot = photograph_sphere(THREE[:2], COLOURS[:2])
    stripes = np.where(np.arange(360) // 4 % 2, 1.0, 0.93)[None, :, None]
    painted = pair_of(
        shot,
        no_flash=(shot.frames[0] * stripes).astype(np.float32),
        flash=(shot.frames[1] * stripes).astype(np.float32),
    )
    found = matt_lamps(painted, MARKED, 2, FOCAL_PX)
    assert _errors(found, THREE[:2])[0].max() < 0.3


@pytest.mark.usefixtures("coarse")
def test_lamps_too_alike_are_refused(pair_of: Callable[..., Pair]) -> None:
    close = unit(np.array([(0.30, 0.2, 1.0), (0.33, 0.22, 1.0)]))
    pair = pair_of(photograph_sphere(close, COLOURS[:1].repeat(2, axis=0), noise=1.0))
    with pytest.raises(UnusablePairError, match="lamps cannot be told apart"):
        matt_lamps(pair, MARKED, 2, FOCAL_PX)


@pytest.mark.usefixtures("coarse")
def test_light_that_no_distant_lamps_give_is_refused(pair_of: Callable[..., Pair]) -> None:
    shot = photograph_sphere(THREE[:2], COLOURS[:2])
    y, x = np.mgrid[:240, :360]
    blotches = (1 + 0.6 * np.sin(x / 6.0) * np.sin(y / 7.0))[..., None]
    frames = shot.frames[0] * blotches, shot.frames[0] * blotches + shot.frames[1]
    pair = pair_of(shot, no_flash=frames[0].astype(np.float32), flash=frames[1].astype(np.float32))
    with pytest.raises(UnusablePairError, match="Distant lamps do not explain"):
        matt_lamps(pair, MARKED, "auto", FOCAL_PX)


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    ("circle", "error", "words"),
    [
        (Circle(x=60, y=60, radius=40), UnusablePairError, "not the outline of a matt sphere"),
        (Circle(x=20, y=60, radius=40), OptionError, "not wholly inside the photograph"),
        (Circle(x=196, y=112, radius=11), OptionError, "radius of only 11 pixels"),
    ],
)
def test_circles_without_a_sphere_are_refused(
    pair_of: Callable[..., Pair], circle: Circle, error: type[Exception], words: str
) -> None:
    pair = pair_of(photograph_sphere(THREE, COLOURS))
    with pytest.raises(error, match=words):
        matt_lamps(pair, circle, 3, FOCAL_PX)


def test_a_clipped_sphere_is_refused(pair_of: Callable[..., Pair]) -> None:
    clipped: Any = np.zeros((240, 360), bool)
    clipped[:100] = True
    pair = pair_of(photograph_sphere(THREE, COLOURS), unusable=clipped)
    with pytest.raises(UnusablePairError, match="sphere is clipped"):
        matt_lamps(pair, MARKED, 3, FOCAL_PX)


@pytest.mark.usefixtures("coarse")
def test_pixels_clipped_all_over_the_sphere_are_refused(pair_of: Callable[..., Pair]) -> None:
    """A ninth of them, and one in every block."""
    clipped: Any = np.zeros((240, 360), bool)
    clipped[1::3, 1::3] = True
    pair = pair_of(photograph_sphere(THREE, COLOURS), unusable=clipped)
    with pytest.raises(UnusablePairError, match="sphere is clipped"):
        matt_lamps(pair, MARKED, 3, FOCAL_PX)


def _fit(count: int, **more: Any) -> SphereFit:
    """Lamps of which each is stronger than the one before, and nothing against them."""
    given: dict[str, Any] = {
        "directions": THREE[:count],
        "colours": np.outer(1.0 + np.arange(count), [0.5, 1.0, 0.25]),
        "deviations_deg": 0.5 + np.arange(count),
        "moved": np.array([0.01, -0.02, 0.03]),
        "flash_aside_deg": 1.5,
        "cost": 0.5,
        "misfit": 0.01,
        "flash_misfit": 0.01,
    }
    return SphereFit(**{**given, **more})


@pytest.fixture
def dim(pair_of: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Pair]:
    """A picture (240, 360) whose light is its place, of which the flash has twice as much.

    One lamp more explains nothing more of it.
    """
    monkeypatch.setattr(module, "fit_one_more", lambda _, fit: fit)

    def build(**more: Any) -> Pair:
        x, y = np.meshgrid(np.arange(360) + 0.5, np.arange(240) + 0.5)
        places = np.stack([x, y, x + y], axis=2)
        noise = Noise(np.zeros(3), np.ones(3))
        shot = Shot((places, 3 * places), (b"", b""))
        return pair_of(shot, no_flash_noise=noise, flash_noise=noise, **more)

    return build


@pytest.mark.parametrize(
    ("costs", "count"),
    [
        ((1.0, np.nan, 0.5), 1),
        ((1.0, 0.98, 0.5), 1),
        ((1.0, 0.96, 0.94), 2),
        ((1.0, 0.96, 0.92), 3),
    ],
)
def test_lamps_are_counted_while_each_explains_more(
    dim: Callable[..., Pair],
    monkeypatch: pytest.MonkeyPatch,
    costs: tuple[float, ...],
    count: int,
) -> None:
    monkeypatch.setattr(module, "fit_lamps", lambda _, n: _fit(n, cost=costs[n - 1]))
    assert len(matt_lamps(dim(), MARKED, "auto", FOCAL_PX).directions) == count
    assert len(matt_lamps(dim(), MARKED, 2, FOCAL_PX).directions) == 2


FOUR = unit(np.array([(-0.9, 0.3, 0.3), (0.9, 0.3, 0.3), (0.1, 0.9, 0.4), (0.0, -0.8, 0.6)]))
FOUR_COLOURS = 0.7 * np.array([(0.3, 0.2, 0.1), (0.1, 0.2, 0.3), (0.2, 0.25, 0.1), (0.2, 0.2, 0.2)])


@pytest.mark.usefixtures("coarse")
def test_four_lamps_are_not_told_as_three(pair_of: Callable[..., Pair]) -> None:
    pair = pair_of(photograph_sphere(FOUR, FOUR_COLOURS))
    with pytest.raises(UnusablePairError, match="Four lamps or more light the sphere"):
        matt_lamps(pair, MARKED, "auto", FOCAL_PX)
    assert matt_lamps(pair, MARKED, 3, FOCAL_PX).one_more


@pytest.mark.usefixtures("coarse")
def test_one_lamp_more_than_were_told_is_noticed(pair_of: Callable[..., Pair]) -> None:
    """A weak one, without which the light is explained well enough to be believed."""
    colours = FOUR_COLOURS[1:3] * [[1.0], [0.05]]
    pair = pair_of(photograph_sphere(FOUR[1:3], colours, noise=1.0, paint=0.02))
    assert matt_lamps(pair, MARKED, 1, FOCAL_PX).one_more
    assert not matt_lamps(pair, MARKED, 2, FOCAL_PX).one_more


@pytest.mark.parametrize(("cost", "one_more"), [(0.489, True), (0.491, False), (np.nan, False)])
@pytest.mark.parametrize("told", [1, 2, 3, "auto"])
def test_one_lamp_more_counts_where_it_explains_much(
    dim: Callable[..., Pair],
    monkeypatch: pytest.MonkeyPatch,
    told: LampCount,
    cost: float,
    one_more: bool,
) -> None:
    """Where fewer than three are counted, one more has been tried."""
    monkeypatch.setattr(module, "fit_lamps", lambda _, n: _fit(n, cost=0.5))
    monkeypatch.setattr(module, "fit_one_more", lambda _, fit: _fit(len(fit.directions), cost=cost))
    found = matt_lamps(dim(), MARKED, told, FOCAL_PX)
    assert found.one_more == (one_more and told != "auto")


def test_the_strongest_lamp_comes_first_with_all_that_is_its_own(
    dim: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    colours = np.array([[0.2, 0.5, 0.1], [0.9, 1.0, -0.1], [0.3, 0.7, 0.2]])
    monkeypatch.setattr(module, "fit_lamps", lambda _, n: _fit(n, colours=colours))
    found = matt_lamps(dim(), MARKED, 3, FOCAL_PX)
    assert found.directions == pytest.approx(THREE[[1, 2, 0]])
    assert found.deviations_deg == pytest.approx([1.5, 2.5, 0.5])
    assert found.colours == pytest.approx(np.maximum(colours[[1, 2, 0]], 0))
    outline = (found.circle.x, found.circle.y, found.circle.radius)
    assert outline == pytest.approx((196 + 0.62, 112 - 1.24, 62 + 1.86))
    assert (found.misfit, found.flash_aside_deg) == (0.01, 1.5)


@pytest.mark.parametrize(
    ("fine", "too_much", "words"),
    [
        ({"misfit": 0.079}, {"misfit": 0.081}, "do not explain 8% of the light"),
        ({"misfit": 0.079}, {"misfit": np.nan}, "do not explain nan% of the light"),
        ({"flash_misfit": 0.119}, {"flash_misfit": np.nan}, "not the outline of a matt sphere"),
        (
            {"moved": np.array([0.0, -0.099, 0.0])},
            {"moved": np.array([0.0, np.nan, 0.0])},
            "not the outline of a matt sphere",
        ),
        (
            {"deviations_deg": np.array([0.1, 2.9])},
            {"deviations_deg": np.array([0.1, np.nan])},
            "cannot be told apart",
        ),
        ({"flash_misfit": 0.119}, {"flash_misfit": 0.121}, "not the outline of a matt sphere"),
        (
            {"moved": np.array([0.0, -0.099, 0.0])},
            {"moved": np.array([0.0, -0.101, 0.0])},
            "not the outline of a matt sphere",
        ),
        (
            {"deviations_deg": np.array([0.1, 2.9])},
            {"deviations_deg": np.array([0.1, 3.1])},
            "cannot be told apart",
        ),
        (
            {"colours": np.array([[1, 1, 1], [-0.2, 0.1, -0.2]])},
            {"colours": np.array([[1, 1, 1], [-0.2, -0.1, -0.2]])},
            "cannot be told apart",
        ),
    ],
)
def test_fits_are_believed_up_to_a_limit(
    dim: Callable[..., Pair],
    monkeypatch: pytest.MonkeyPatch,
    fine: dict[str, Any],
    too_much: dict[str, Any],
    words: str,
) -> None:
    monkeypatch.setattr(module, "fit_lamps", lambda _, n: _fit(n, **fine))
    assert len(matt_lamps(dim(), MARKED, 2, FOCAL_PX).directions) == 2
    monkeypatch.setattr(module, "fit_lamps", lambda _, n: _fit(n, **too_much))
    with pytest.raises(UnusablePairError, match=words):
        matt_lamps(dim(), MARKED, 2, FOCAL_PX)


@pytest.mark.parametrize(("radius", "side"), [(12.0, 1), (62.0, 1), (100.0, 2)])
def test_the_inner_part_is_seen_in_blocks_where_it_is_large(
    dim: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch, radius: float, side: int
) -> None:
    """Each has the light of its place, four pixels a quarter of the noise; none is clipped."""
    unusable: Any = np.zeros((240, 360), bool)
    unusable[110, 180:190] = True
    seen: list[SphereLight] = []

    def fit(light: SphereLight, count: int) -> SphereFit:
        seen.append(light)
        return _fit(count)

    monkeypatch.setattr(module, "fit_lamps", fit)
    sphere = Circle(x=180, y=110, radius=radius)
    matt_lamps(dim(unusable=unusable), sphere, 1, FOCAL_PX)
    (light,) = seen
    places = np.stack([light.x, light.y], axis=1)
    assert light.lights.lamps[:, :2] == pytest.approx(places)
    assert light.lights.flash[:, :2] == pytest.approx(2 * places)
    assert light.lights.lamps_variance == pytest.approx(1 / side**2)
    assert light.lights.flash_variance == pytest.approx(2 / side**2)
    away = np.hypot(light.x - 180, light.y - 110)
    assert 0.8 * radius < away.max() <= 0.9 * radius
    assert len(light.x) == pytest.approx(np.pi * (0.9 * radius / side) ** 2 - 10, rel=0.04)
    assert not ((light.x > 180) & (light.x < 190) & (np.floor(light.y) == 110)).any()
    assert (light.circle, light.focal_px, light.size) == (sphere, FOCAL_PX, (360, 240))


@pytest.mark.parametrize(("share", "refused"), [(0.19, False), (0.21, True)])
def test_a_fifth_of_the_sphere_may_be_clipped(
    dim: Callable[..., Pair], monkeypatch: pytest.MonkeyPatch, share: float, refused: bool
) -> None:
    """Of its inner part, by an angle about its middle."""
    monkeypatch.setattr(module, "fit_lamps", lambda _, n: _fit(n))
    y, x = np.mgrid[:240, :360] + 0.5
    clipped = np.arctan2(y - MARKED.y, x - MARKED.x) < np.pi * (2 * share - 1)
    if refused:
        with pytest.raises(UnusablePairError, match="sphere is clipped"):
            matt_lamps(dim(unusable=clipped), MARKED, 1, FOCAL_PX)
    else:
        matt_lamps(dim(unusable=clipped), MARKED, 1, FOCAL_PX)


def test_a_sphere_of_less_than_twelve_pixels_is_refused(dim: Callable[..., Pair]) -> None:
    with pytest.raises(OptionError, match=r"radius of only 11\.9 pixels: it must have 12"):
        matt_lamps(dim(), Circle(x=180, y=110, radius=11.9), 1, FOCAL_PX)
