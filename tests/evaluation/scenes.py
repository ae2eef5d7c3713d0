"""The scenes of the evaluation: groups as data, and what a camera sees of them.

Development scenes are for building the method, report scenes for the figures; they share no
geometry, no lamp and no reflectance.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.images.frames import Image
from pipeline.spectra.lights import find_light
from tests.evaluation import cache
from tests.evaluation.geometry import Geometry
from tests.evaluation.layouts import LIGHT, PALETTE, Layout, make_geometry, moved, with_somebody
from tests.evaluation.spectra import (
    Lamps,
    Split,
    angle_deg,
    coefficients,
    flash_spectrum,
    lamps,
    reflectances,
    sensitivities,
)

SIZE = (256, 192)
CAMERA, FLASH = "Nikon D5100", "xenon"

OTHER_CAMERAS: dict[Split, tuple[str, ...]] = {
    "development": (
        "Canon EOS 5D Mark II",
        "Fujifilm X-T3",
        "Hasselblad L1D-20c",
        "Sony ILCE-7M3",
    ),
    "report": ("Canon EOS 600D", "Fujifilm GFX 100", "Panasonic DC-GX9", "Sony ILCE-9"),
}
"""Cameras of other makers, not packaged (see spectra.sensitivities); the halves share none."""

NEUTRAL = "D65"
"""The light that pictures are balanced for."""

SWEEP_DEG = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0)
DEPTHS: tuple[int | None, ...] = (2, 3, 4, 6, None)
ROUGHNESSES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)

WHITE_LEVEL = 0.9
"""What the 99.9th percentile of the brightest channel is exposed to."""

_LIGHT_WALL = 0.3
_MUTED_WALL = 0.3
_TRIES = 100_000
_WIDEST_BARE_DEG = 40.0  # few measured lamps are further apart
_SHADES = 8
_ROOMS = 6  # that other cameras take
_PERSON = -0.2  # where somebody who walks stands first, in widths from the picture's middle


@dataclass(frozen=True)
class Scene:
    """A scene before it is photographed.

    name: its own in all groups. lamp_spectra: (N, W), each summing to 1. lamp_names: of the table,
    or how they were made. strengths: (N,) mean of each lamp's picture relative to the others'.
    palette: (m, W) reflectances. camera, flash: names as in spectra.
    """

    name: str
    group: str
    split: Split
    geometry: Geometry
    palette: Floats64
    lamp_spectra: Floats64
    lamp_names: tuple[str, ...]
    strengths: tuple[float, ...]
    camera: str = CAMERA
    flash: str = FLASH

    @property
    def angle_deg(self) -> float:
        """Least angle between two lamps' coefficient vectors, 0 with one lamp.

        It is CAMERA's, by which lamps are chosen, whichever takes the picture.
        """
        return min(
            (angle_deg(a, b, CAMERA) for a, b in combinations(self.lamp_spectra, 2)),
            default=0.0,
        )


@dataclass(frozen=True)
class RenderedScene:
    """What a camera without noise sees, in linear camera RGB, 1.0 the white level.

    lamps: float32 (N, H, W, 3), each lamp alone: the truth. flash: (H, W, 3), the flash alone.
    flash_frame: (H, W, 3) flash and lamps as the flash photograph shows them, from where the hand
    had moved to by then. Values may exceed 1 in a highlight.
    """

    scene: Scene
    lamps: Floats32
    flash: Image
    flash_frame: Image

    @property
    def no_flash_frame(self) -> Image:
        """All lamps together, (H, W, 3)."""
        return np.asarray(self.lamps.sum(axis=0))


def render_scene(
    scene: Scene,
    size: tuple[int, int] = SIZE,
    motion_px: float = 0.0,
    flash_strength: float = 1.0,
    walk: float = 0.0,
) -> RenderedScene:
    """Photograph a scene; renderings are cached.

    size: (width, height). motion_px: how far the hand turns between the photographs, in pixels at
    the middle of the picture; it rolls and wanders in proportion. flash_strength: of all lamps
    together, in the mean of green. walk: how far a person who stands there walks on between the
    photographs, in widths of the picture; there is none where it is 0.

    The exposure is such that the 99.9th percentile of the brightest channel of both together is
    0.9.
    """
    spectra = sensitivities(scene.camera), flash_spectrum(scene.flash)
    return render_seen(scene, *spectra, size, motion_px, flash_strength, walk)


def render_seen(
    scene: Scene,
    s: Floats64,
    flash: Floats64,
    size: tuple[int, int] = SIZE,
    motion_px: float = 0.0,
    flash_strength: float = 1.0,
    walk: float = 0.0,
) -> RenderedScene:
    """Photograph a scene with another camera, of sensitivities (3, W), and flash (W,)."""
    spectra = [*scene.lamp_spectra, flash]
    responses = [spectrum[:, None] * s.T for spectrum in spectra]
    first = later = scene.geometry
    if walk:
        first, later = (with_somebody(later, place) for place in (_PERSON, _PERSON + walk))
    pictures = _pictures(scene, first, responses, size)
    strengths = np.array([*scene.strengths, flash_strength * sum(scene.strengths)])
    means = np.array([picture[..., 1].mean() for picture in pictures])
    if not (means > 0).all():
        raise ValueError(f"a lamp of {scene.name} lights nothing that the camera sees")
    scales = strengths / means
    both = sum(scale * picture for scale, picture in zip(scales, pictures, strict=True))
    scales *= WHITE_LEVEL / np.percentile(np.max(both, axis=2), 99.9)
    lit = np.stack([s * p for s, p in zip(scales, pictures, strict=True)]).astype(np.float32)
    frame = lit.sum(axis=0)
    if motion_px:
        seed = int.from_bytes(hashlib.sha256(scene.name.encode()).digest()[:4])
        later = moved(later, motion_px / size[0], seed)
    if later is not first:
        pictures = _pictures(scene, later, responses, size)
        frame = sum(s * p for s, p in zip(scales, pictures, strict=True)).astype(np.float32)
    return RenderedScene(scene, lit[:-1], lit[-1], frame)


def render_neutral(scene: Scene, size: tuple[int, int] = SIZE) -> Image:
    """Show a scene as if every lamp shone like NEUTRAL; see neutral_seen."""
    lit = render_scene(scene, size).lamps
    return neutral_seen(scene, sensitivities(scene.camera), lit, size)


def neutral_seen(scene: Scene, s: Floats64, lit: Floats32, size: tuple[int, int] = SIZE) -> Image:
    """Show a scene to a camera (3, W) as if every lamp shone like NEUTRAL, as bright as it is.

    lit: (N, H, W, 3), what the camera sees of each lamp, from render_seen.

    A lamp keeps its green response on a white card. (H, W, 3) linear camera RGB, on the scale of
    render_scene.
    """
    neutral = find_light(NEUTRAL)
    whites = np.array([s[1] @ lamp for lamp in scene.lamp_spectra]) / (s[1] @ neutral)
    seen = [lamp[:, None] * s.T for lamp in scene.lamp_spectra]
    shown = _changed(scene, lit, seen, [white * neutral[:, None] * s.T for white in whites], size)
    return np.asarray(sum(shown), dtype=np.float32)


def render_response(scene: Scene, camera: str, size: tuple[int, int] = SIZE) -> Floats32:
    """Show every lamp of a scene alone as another camera sees it, (N, H, W, 3), its linear RGB.

    The camera is exposed so that a white card in daylight, D65, gives it the same green. The scale
    is that of render_scene.
    """
    s, other = sensitivities(scene.camera), sensitivities(camera)
    daylight = find_light("D65")
    other = other * (s[1] @ daylight) / (other[1] @ daylight)
    seen, shown = ([lamp[:, None] * one.T for lamp in scene.lamp_spectra] for one in (s, other))
    lit = render_scene(scene, size).lamps
    return np.asarray(_changed(scene, lit, seen, shown, size), dtype=np.float32)


def scenes(group: str, split: Split) -> list[Scene]:
    """Return the scenes of one of GROUPS."""
    return GROUPS[group](group, split)


def _changed(
    scene: Scene,
    lit: Floats32,
    seen: list[Floats64],
    shown: list[Floats64],
    size: tuple[int, int],
) -> list[Image]:
    """Pictures of the lamps by other responses (W, 3), on the scale of lit (N, H, W, 3)."""
    before, after = (_pictures(scene, scene.geometry, one, size) for one in (seen, shown))
    return [
        one[..., 1].mean() / old[..., 1].mean() * new
        for one, old, new in zip(lit, before, after, strict=True)
    ]


def _pictures(
    scene: Scene, geometry: Geometry, responses: list[Floats64], size: tuple[int, int]
) -> list[Image]:
    transport = cache.transport(geometry, scene.palette, size)
    return [
        transport.picture(lamp, response, scene.palette) for lamp, response in enumerate(responses)
    ]


def _make(
    group: str,
    split: Split,
    number: int,
    layout: Layout,
    count: int,
    choose: Callable[[Lamps, np.random.Generator], tuple[Floats64, tuple[str, ...]]],
) -> Scene:
    """Make a scene; its seed depends on its group, half and number alone."""
    name = f"{group}-{split}-{number:02d}"
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4])
    random = np.random.default_rng(seed)
    table = reflectances(split)
    mean = table.mean(axis=1)
    light = np.flatnonzero((mean > _LIGHT_WALL) & (table.std(axis=1) < _MUTED_WALL * mean))
    colours = [
        *random.choice(light, LIGHT, replace=False),
        *random.choice(len(table), PALETTE - LIGHT, replace=False),
    ]
    spectra, names = choose(lamps(split), random)
    strengths = tuple(float(s) for s in random.uniform(0.6, 1.4, count))
    geometry = make_geometry(layout, seed, count)
    return Scene(name, group, split, geometry, table[colours], spectra, names, strengths)


def _apart(
    count: int, least_deg: float, broad: bool = False
) -> Callable[[Lamps, np.random.Generator], tuple[Floats64, tuple[str, ...]]]:
    """Choose lamps at random, each pair at least so many degrees apart."""

    def choose(own: Lamps, random: np.random.Generator) -> tuple[Floats64, tuple[str, ...]]:
        candidates = np.flatnonzero(own.broad) if broad else np.arange(len(own.names))
        near = _cosines(own.spectra) > np.cos(np.radians(least_deg))
        for _try in range(_TRIES):
            chosen = random.choice(candidates, count, replace=False)
            if not any(near[i, j] for i, j in combinations(chosen, 2)):
                return own.spectra[chosen], tuple(own.names[i] for i in chosen)
        raise ValueError(f"no {count} lamps are {least_deg}° apart")

    return choose


def _cosines(spectra: Floats64) -> Floats64:
    """Cosines (n, n) of the angles between lamps' coefficient vectors."""
    found = coefficients(spectra, CAMERA)
    return np.asarray(found @ found.T)


def _group(
    count: int,
    lamp_count: int,
    least_deg: float,
    layout: Layout = "room",
    broad: bool = False,
    flash: str = FLASH,
) -> Callable[[str, Split], list[Scene]]:
    def make(group: str, split: Split) -> list[Scene]:
        choose = _apart(lamp_count, least_deg, broad)
        made = [_make(group, split, n, layout, lamp_count, choose) for n in range(count)]
        return [replace(scene, flash=flash) for scene in made]

    return make


def _sweep(group: str, split: Split) -> list[Scene]:
    """Four rooms, each with pairs of lamps at every angle of SWEEP_DEG."""
    out = []
    for n in range(4):
        for angle in SWEEP_DEG:
            base = _make(group, split, n, "room", 2, _at_angle(angle))
            out.append(replace(base, name=f"{base.name}-{angle:g}deg"))
    return out


def _at_angle(
    wanted_deg: float,
) -> Callable[[Lamps, np.random.Generator], tuple[Floats64, tuple[str, ...]]]:
    """Choose a pair wider apart, and mix of the one into the other until the angle is right.

    Where no measured pair is as wide, both get the coloured shades that part them most.
    """

    def choose(own: Lamps, random: np.random.Generator) -> tuple[Floats64, tuple[str, ...]]:
        if wanted_deg > _WIDEST_BARE_DEG:
            own = _shaded(own)
        wide = np.argwhere(_cosines(own.spectra) < np.cos(np.radians(wanted_deg)))
        i, j = wide[random.integers(len(wide))]
        a, b = own.spectra[i], own.spectra[j]
        low, high = 0.0, 1.0
        for _halving in range(50):
            share = (low + high) / 2
            mixed = (1 - share) * a + share * b
            low, high = (share, high) if angle_deg(a, mixed, CAMERA) < wanted_deg else (low, share)
        names = (own.names[i], f"{share:.0%} {own.names[j]}, {1 - share:.0%} {own.names[i]}")
        return np.stack([a, mixed]), names

    return choose


def _shaded(own: Lamps) -> Lamps:
    """Lamps behind shades of the most saturated surfaces: their light reflected twice."""
    table = reflectances("development" if own is lamps("development") else "report")
    vivid = np.argsort(table.std(axis=1) / table.mean(axis=1))[-_SHADES:]
    lit = (own.spectra[:, None] * table[vivid] ** 2).reshape(-1, table.shape[1])
    names = tuple(f"{name}, shade {i}" for name in own.names for i in vivid)
    spectra = lit / lit.sum(axis=1, keepdims=True)
    return Lamps(names, spectra, np.repeat(own.broad, _SHADES))


def _depths(group: str, split: Split) -> list[Scene]:
    """Three corners, each with light of every number of bounces."""
    choose = _apart(2, 10.0)
    out = []
    for n in range(3):
        base = _make(group, split, n, "corner", 2, choose)
        for depth in DEPTHS:
            name = f"{base.name}-depth{'inf' if depth is None else depth}"
            out.append(replace(base, name=name, geometry=replace(base.geometry, depth=depth)))
    return out


def _roughnesses(group: str, split: Split) -> list[Scene]:
    """Three rooms seen from close, their things of plastic of every roughness."""
    choose = _apart(2, 10.0)
    out = []
    for n in range(3):
        base = _make(group, split, n, "close", 2, choose)
        for alpha in ROUGHNESSES:
            geometry = replace(base.geometry, roughness=alpha)
            out.append(replace(base, name=f"{base.name}-rough{alpha:g}", geometry=geometry))
    return out


def _cameras(of: str) -> Callable[[str, Split], list[Scene]]:
    """The first rooms of a group as they are, and as each of OTHER_CAMERAS takes them."""

    def make(group: str, split: Split) -> list[Scene]:
        rooms = scenes(of, split)[:_ROOMS]
        taken = [
            replace(room, name=f"{room.name}, {camera}", group=group, camera=camera)
            for camera in OTHER_CAMERAS[split]
            for room in rooms
        ]
        return [*rooms, *taken]

    return make


GROUPS: dict[str, Callable[[str, Split], list[Scene]]] = {
    "one": _group(12, 1, 0.0),
    "two": _group(22, 2, 5.0),
    "two-led": _group(12, 2, 5.0, flash="led"),
    "three": _group(26, 3, 20.0),
    "four": _group(12, 4, 12.0),
    "broad-two": _group(12, 2, 15.0, broad=True),
    "broad-three": _group(12, 3, 15.0, broad=True),
    "angle": _sweep,
    "bounces": _depths,
    "roughness": _roughnesses,
    "smooth-two": _group(8, 2, 10.0, "smooth"),
    "smooth-three": _group(6, 3, 15.0, "smooth"),
    "panels-two": _group(12, 2, 10.0, "panels"),
    "panels-three": _group(6, 3, 20.0, "panels"),
    "wall-two": _group(12, 2, 5.0, "wall"),
    "wall-three": _group(12, 3, 20.0, "wall"),
    "cameras-two": _cameras("two"),
    "cameras-three": _cameras("three"),
}
"""Groups of scenes. two, three: figures 2, 3 and 9 of Hui et al. 2018; angle: 4; bounces: 15;
roughness: 16; broad: lamps of broad spectra, as the source's own; led: the flash of a phone;
panels: no lamp is alone anywhere; wall: lamps stand before a wall, in the picture; cameras: rooms
of two and three by other cameras, too."""
