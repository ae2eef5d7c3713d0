"""Render the transport of a geometry with Mitsuba 3.

Rays go through fixed points of every pixel and lamps are made of points, so that direct light has
no noise, and is the same at all wavelengths. Light that bounces is followed along random paths that
do not depend on colours; the grain they leave is smoothed and then is part of the truth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats, Floats32, Floats64
from pipeline.spectra.wavelengths import WAVELENGTHS_NM
from pipeline.vectors import unit
from tests.evaluation.geometry import Geometry, Lamp, Shape, View
from tests.evaluation.grain import smooth_bounces
from tests.evaluation.meshes import mesh_of
from tests.evaluation.patterns import Texels, paint
from tests.evaluation.transport import BANDS_NM, BandTransport, DirectTransport, Transport

VERSION = 2
"""Counts up when the same geometry renders differently."""

_FACTOR = 3  # sub-pixels per side
_LAMP_POINTS = 8
_PATHS = 64  # per pixel, with bounces; a power of 4
_LONGEST_PATH = 20  # segments; what is left then is below 0.1 % among surfaces of 70 %
_GOLDEN_ANGLE = np.pi * (3 - 5**0.5)
_GLASS = 1.49  # refractive index of plastic
_LAMP = {
    "type": "point",
    "position": [0.0, 9.0, 0.0],  # before it is moved to where a lamp is
    "intensity": {"type": "rgb", "value": [np.pi] * 3},
}
_DIRECT = {"type": "direct", "bsdf_samples": 0, "emitter_samples": 1, "hide_emitters": True}


def render(geometry: Geometry, palette: Floats64, size: tuple[int, int]) -> Transport:
    """Render every lamp of a geometry alone, with unit power.

    palette: (m, W) reflectances, used where light bounces. size: (width, height) in pixels.
    A lamp of unit power gives a perfect white that faces it at 1 m the value 1.
    """
    direct, shown = _direct(geometry, (size[0] * _FACTOR, size[1] * _FACTOR))
    return direct if geometry.depth == 2 else _bounces(geometry, palette, size, direct, shown)


@dataclass(frozen=True)
class Facing:
    """What pixels show. normals: (H, W, 3) unit, NaN where there is nothing or several things.

    places: (H, W, 3), metres. lit: bool (L, H, W), wholly lit by a lamp.
    """

    normals: Floats64
    places: Floats64
    lit: NDArray[np.bool_]


def render_facing(geometry: Geometry, size: tuple[int, int]) -> tuple[DirectTransport, Facing]:
    """Render direct light, and where surfaces face. size: (width, height) in pixels."""
    transport, shown = _direct(geometry, (size[0] * _FACTOR, size[1] * _FACTOR))

    def blocks(picture: Floats) -> Floats64:
        shape = (size[1], _FACTOR, size[0], _FACTOR, *picture.shape[2:])
        return picture.reshape(shape).astype(np.float64)

    one = (blocks(shown.shape).min(axis=(1, 3)) == blocks(shown.shape).max(axis=(1, 3))) & (
        blocks(shown.shape).min(axis=(1, 3)) > 0
    )
    normals = unit(blocks(shown.normals).mean(axis=(1, 3)))
    normals[~one] = np.nan
    lit = [blocks(light).min(axis=(1, 3)) > 0 for light in transport.diffuse]
    return transport, Facing(normals, blocks(shown.places).mean(axis=(1, 3)), np.array(lit) & one)


@dataclass(frozen=True)
class _Shown:
    """What sub-pixels show: texels, which shape (h, w), its normal and its place (h, w, 3)."""

    texels: Texels
    shape: Floats32
    normals: Floats32
    places: Floats32


def _direct(geometry: Geometry, size: tuple[int, int]) -> tuple[DirectTransport, _Shown]:
    """Red sees surfaces of reflectance 0, so their gloss alone, green those of reflectance 1."""
    white = _rgb([0.0, 1.0, 1.0])
    shapes = {
        name: _shape(name, shape, _surface(white, shape, geometry.roughness))
        for name, shape in _named(geometry)
    }
    centred = {"type": "stratified", "sample_count": 1, "jitter": False}
    sensor = _sensor(geometry.view, size, centred)
    scene = _load({**shapes, "sensor": sensor, "lamp": _LAMP, "integrator": _DIRECT})
    diffuse, gloss = [], []
    for lamp in geometry.lamps:
        points = _points(lamp, geometry.view)
        seen = np.mean([_moved(scene, point) for point in points], axis=0)
        diffuse.append(seen[..., 1] - seen[..., 0])
        gloss.append(seen[..., 0])
    aov = {"type": "aov", "aovs": "u:uv,n:sh_normal,i:shape_index,p:position"}
    plain = _load({**shapes, "sensor": sensor, "integrator": aov})
    what = _image(plain)
    texels = _texels(geometry, [shape.id() for shape in plain.shapes()], what[..., [0, 1, 5]])
    transport = DirectTransport(
        np.stack(diffuse),
        np.stack(gloss) if geometry.roughness is not None else None,
        texels.first,
        texels.second,
        texels.share,
        _FACTOR,
    )
    return transport, _Shown(texels, what[..., 5], what[..., 2:5], what[..., 6:9])


def _bounces(
    geometry: Geometry,
    palette: Floats64,
    size: tuple[int, int],
    direct: DirectTransport,
    shown: _Shown,
) -> BandTransport:
    """Add what paths of more than two segments bring, three bands in one rendering."""
    if geometry.roughness is not None:
        raise ValueError("bounces are rendered among matte surfaces alone")
    in_bands = np.array([np.interp(BANDS_NM, WAVELENGTHS_NM, colour) for colour in palette])
    each = np.eye(len(BANDS_NM))
    lit = [
        direct.picture(lamp, each, in_bands).transpose(2, 0, 1)
        for lamp in range(len(geometry.lamps))
    ]
    bare = replace(direct, diffuse=np.ones_like(direct.diffuse[:1]))
    reflectance = bare.picture(0, each, in_bands).transpose(2, 0, 1)
    depth = _LONGEST_PATH if geometry.depth is None else geometry.depth
    path = {"type": "path", "max_depth": depth, "rr_depth": 1000, "hide_emitters": True}
    bounced: list[list[Floats32]] = [[] for _lamp in geometry.lamps]
    # its rays through a pixel do not depend on the integrator, so that direct light cancels
    sampler = {"type": "ldsampler", "sample_count": _PATHS}
    sensor = _sensor(geometry.view, size, sampler)
    for start in range(0, len(BANDS_NM), 3):
        rgb = in_bands[:, start : start + 3]
        shapes = {
            name: _shape(name, shape, _surface(_painted(shape, rgb), shape, None))
            for name, shape in _named(geometry)
        }
        common = {**shapes, "sensor": sensor, "lamp": _LAMP}
        longer, two = (_load({**common, "integrator": kind}) for kind in (path, _DIRECT))
        for lamp, own in zip(geometry.lamps, bounced, strict=True):
            rest = _moved(longer, lamp.centre) - _moved(two, lamp.centre)
            own.extend(rest.transpose(2, 0, 1))
    blocks = shown.shape.reshape(size[1], _FACTOR, size[0], _FACTOR)
    one = blocks.min(axis=(1, 3)) == blocks.max(axis=(1, 3))
    surface = np.where(one, blocks[:, 0, :, 0], -1)
    normals = shown.normals[_FACTOR // 2 :: _FACTOR, _FACTOR // 2 :: _FACTOR]
    smooth = [smooth_bounces(np.array(own), reflectance, normals, surface) for own in bounced]
    return BandTransport(np.array(lit) + np.array(smooth))


def _named(geometry: Geometry) -> list[tuple[str, Shape]]:
    return [(f"shape{i}", shape) for i, shape in enumerate(geometry.shapes)]


def _texels(geometry: Geometry, ids: list[str], what: Floats32) -> Texels:
    """Find what each sub-pixel is made of.

    what: (h, w, 3) of u, v and the place in ids, from 1; 0 is nothing.
    """
    u, v, index = np.moveaxis(what.astype(np.float64), 2, 0)
    first = np.zeros(u.shape, np.int16)
    second, share = first.copy(), np.zeros(u.shape, np.float32)
    named = dict(_named(geometry))
    for place, name in enumerate(ids, start=1):
        own = index == place
        seen = paint(named[name].pattern).at(u[own], v[own])
        first[own], second[own], share[own] = seen.first, seen.second, seen.share
    return Texels(first, second, share)


def _points(lamp: Lamp, view: View) -> list[Floats64]:
    """Points of a round lamp that faces what the camera looks at."""
    centre = np.array(lamp.centre)
    if lamp.radius == 0:
        return [centre]
    towards = np.array(view.look_at) - centre
    towards /= np.linalg.norm(towards)
    side = np.cross(towards, (0.0, 1.0, 0.0) if abs(towards[1]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    up = np.cross(side, towards)
    n = np.arange(_LAMP_POINTS)
    radius, angle = lamp.radius * np.sqrt((n + 0.5) / _LAMP_POINTS), n * _GOLDEN_ANGLE
    return list(
        centre + np.outer(radius * np.cos(angle), side) + np.outer(radius * np.sin(angle), up)
    )


@cache
def _mitsuba() -> Any:
    import mitsuba as mi  # here, as it takes a second and a cached scene needs none of it

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    return mi


def _load(scene: dict[str, Any]) -> Any:
    # optimising would merge shapes of the same surface, which then cannot be told apart
    return _mitsuba().load_dict({"type": "scene", **scene}, optimize=False)


def _image(scene: Any) -> Floats32:
    return np.array(_mitsuba().render(scene, seed=0), np.float32)


def _moved(scene: Any, lamp: Any) -> Floats32:
    """Render with the lamp elsewhere."""
    parameters = _mitsuba().traverse(scene)
    parameters["lamp.position"] = _mitsuba().ScalarPoint3f(*map(float, lamp))
    parameters.update()
    return _image(scene)


def _rgb(values: list[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": values}


def _sensor(view: View, size: tuple[int, int], sampler: dict[str, Any]) -> dict[str, Any]:
    transform = _mitsuba().ScalarTransform4f
    pose = transform().look_at(
        origin=list(view.position), target=list(view.look_at), up=[0.0, 1.0, 0.0]
    )
    return {
        "type": "perspective",
        "fov": view.fov_deg,
        "fov_axis": "x",
        "to_world": pose @ transform().rotate([0, 0, 1], view.roll_deg),
        "film": {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": sampler,
    }


def _surface(colour: dict[str, Any], shape: Shape, roughness: float | None) -> dict[str, Any]:
    if roughness is None or not shape.plastic:
        return {"type": "diffuse", "reflectance": colour}
    return {
        "type": "roughplastic",
        "diffuse_reflectance": colour,
        "alpha": roughness,
        "int_ior": _GLASS,
        "nonlinear": False,  # what lies under the gloss stays linear in the reflectance
    }


def _painted(shape: Shape, palette: Floats64) -> dict[str, Any]:
    """Texture of a shape's pattern. palette: (m, 3)."""
    texels = paint(shape.pattern)
    share = texels.share[..., None]
    colours = (1 - share) * palette[texels.first] + share * palette[texels.second]
    return {
        "type": "bitmap",
        "bitmap": _mitsuba().Bitmap(np.ascontiguousarray(colours, np.float32)),
        "raw": True,
        "filter_type": "nearest",
    }


def _shape(name: str, shape: Shape, surface: dict[str, Any]) -> Any:
    transform = _mitsuba().ScalarTransform4f
    placed = (
        transform()
        .translate(list(shape.centre))
        .rotate([0, 1, 0], shape.turn_deg)
        .rotate([1, 0, 0], shape.tilt_deg)
        .scale(list(shape.size))
    )
    if shape.kind == "sphere":  # its poles are on z; upright they lie on y
        placed = placed @ transform().rotate([1, 0, 0], -90)
    simple = {"plane": "rectangle", "box": "cube", "sphere": "sphere"}
    if shape.kind in simple:
        return {"type": simple[shape.kind], "to_world": placed, "bsdf": surface}
    return _mesh(name, shape, np.array(placed.matrix, np.float64), surface)


def _mesh(name: str, shape: Shape, matrix: Floats64, surface: dict[str, Any]) -> Any:
    mi = _mitsuba()
    data = mesh_of(shape.kind, shape.seed)
    points = data.points @ matrix[:3, :3].T + matrix[:3, 3]
    normals = data.normals @ np.linalg.inv(matrix[:3, :3])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    properties = mi.Properties()
    properties.set_id(name)
    properties["bsdf"] = mi.load_dict(surface)
    mesh = mi.Mesh(
        name,
        len(points),
        len(data.faces),
        props=properties,
        has_vertex_normals=True,
        has_vertex_texcoords=True,
    )
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    parameters["vertex_normals"] = normals.astype(np.float32).ravel()
    parameters["vertex_texcoords"] = data.uv.astype(np.float32).ravel()
    parameters["faces"] = data.faces.ravel()
    parameters.update()
    return mesh
