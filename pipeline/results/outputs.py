"""From pictures to files, and what the manifest says of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from pipeline.arrays import Floats32, Floats64
from pipeline.colour.spaces import XYZ_TO_REC2020, XYZ_TO_SRGB
from pipeline.encode.coded_normals import CodedNormals
from pipeline.encode.exr import ExrFile, write_exr
from pipeline.encode.files import describe
from pipeline.encode.jpeg import JpegFile, write_jpeg
from pipeline.encode.mesh import make_mesh
from pipeline.encode.png import NormalsPng, write_png8
from pipeline.encode.preview import PreviewFile, thumbnail
from pipeline.encode.texture import Texture
from pipeline.encode.tiff import GrayTiffFile, TiffFile
from pipeline.encode.writer import Writer
from pipeline.estimate import Estimate
from pipeline.images.frames import Image, Matrix, Photograph
from pipeline.light.model import Response
from pipeline.photometric_stereo.facing import CONVENTIONS
from pipeline.pictures.clipped import shown_layers
from pipeline.pictures.gamma_diagram import draw_gamma_diagram
from pipeline.pictures.residual_map import draw_residual_map, relative_residual
from pipeline.pictures.shown import shown_gain
from pipeline.pictures.white_balance import whites_of
from pipeline.progress import Progress
from pipeline.result_names import lamp_name
from pipeline.results.pictures import Pictures
from pipeline.spectra.cameras import Camera
from pipeline.spectra.lights import lamp_spectra

if TYPE_CHECKING:
    from pipeline.photometric_stereo.solve import Surface

_CAMERA_RGB = "linear camera RGB, 1.0 = white level of the no-flash photograph"
_FAINTEST = 1e-6  # a lamp's light all over the picture, so that its colour is that of some lamp
_SRGB = ("8-bit sRGB curve", "sRGB")
_REC2020 = ("16-bit linear", "Rec. 2020")


@dataclass(frozen=True)
class _Output:
    """A file, its encoding, its colour space, and what completes it."""

    path: Path
    encoding: str
    colour_space: str
    complete: Callable[[], None]


class Outputs:
    """The wanted files of a run, written while their pictures are computed.

    As a context it leaves no file behind where the run does not come to its end.
    """

    def __init__(
        self,
        photograph: Photograph,
        clipping: float,
        small: Pictures,
        estimate: Estimate,
        wanted: frozenset[str],
        directory: Path,
        convention: Literal["gl", "dx"] = "gl",
    ) -> None:
        """Open the files.

        photograph: (H, W, 3), the no-flash photograph, on whose scale layers are shown. clipping:
        the value at which it is clipped, infinite where it is not. small: of overview, which says
        how bright the other pictures are shown. wanted: names out of OUTPUT_NAMES; those of what
        there is not are passed over. directory: where, it exists. convention: of the normals that
        are written. Raises OptionError for a picture that a wanted format cannot hold, OSError.
        """
        self._convention = convention
        self._size = photograph.shape[1], photograph.shape[0]
        self._estimate = estimate
        self._model = estimate.model
        self._wanted = wanted
        self._directory = directory
        self._takers: list[Callable[[Pictures], None]] = []
        self._outputs: list[_Output] = []
        try:
            self._open(photograph, clipping, small)
        except BaseException:
            self._remove()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        if kind is not None:
            self._remove()

    def _remove(self) -> None:
        for output in self._outputs:
            output.path.unlink(missing_ok=True)

    def add(self, pictures: Pictures) -> None:
        """Take the next rows. Raises OSError."""
        for take in self._takers:
            take(pictures)

    def finish(self, entries: list[dict[str, Any]], progress: Progress) -> list[dict[str, Any]]:
        """Complete the files; returns their entries for the manifest.

        entries: of the lamps, for the labels of gamma.png. Raises Canceled between files, OSError.
        """
        self._open_diagrams(entries)
        described = []
        for index, output in enumerate(self._outputs):
            progress.report("encode", index / len(self._outputs))
            output.complete()
            described.append(describe(output.path, output.encoding, output.colour_space))
        return described

    def _open(self, photograph: Photograph, clipping: float, small: Pictures) -> None:
        """Open the files in the order in which the manifest lists them."""
        facing, changes = self._estimate.facing, self._estimate.changes
        surface = None if facing is None else facing.surface
        self._open_layers(photograph)
        self._open_balanced(small)
        if changes is not None and self._model.response is not None:
            self._open_response(small, changes, self._model.response)
        if facing is not None:
            self._open_normals()
        if surface is not None:
            self._open_surface(small, surface)
        self._open_confidences(surface is not None)
        self._open_previews(photograph, clipping, small)

    def _stream(
        self,
        name: str,
        kind: tuple[str, str],
        writer: Callable[[Path], Writer],
        rows: Callable[[Pictures], Any],
    ) -> None:
        """Write a file from what `rows` picks out of every strip."""
        self._at_last(name, kind, lambda _: opened.close())  # first: opening may fail half way
        opened = writer(self._directory / name)
        self._takers.append(lambda pictures: opened.write(rows(pictures)))

    def _show(self, name: str, to_srgb: Matrix, rows: Callable[[Pictures], Any]) -> None:
        """Write a JPEG from what `rows` picks out of every strip."""
        self._stream(name, _SRGB, partial(JpegFile, size=self._size, to_srgb=to_srgb), rows)

    def _at_last(self, name: str, kind: tuple[str, str], write: Callable[[Path], None]) -> None:
        path = self._directory / name
        self._outputs.append(_Output(path, *kind, lambda: write(path)))

    def _open_layers(self, photograph: Photograph) -> None:
        size, wanted, camera_to_xyz = self._size, self._wanted, self._model.camera_to_xyz
        if "layers.exr" in wanted:
            exr = partial(ExrFile, size=size, half=True)
            kind = ("16-bit float", _CAMERA_RGB)
            self._stream("layers.exr", kind, exr, lambda pictures: _with_sum(pictures.layers))
        to_rec2020 = _fitting(XYZ_TO_REC2020 @ camera_to_xyz, _brightest(self._model.camera))
        to_srgb = _as_shown(photograph, XYZ_TO_SRGB @ camera_to_xyz)
        for lamp in range(len(self._estimate.lamps)):
            if "lamps.tif" in wanted:
                tiff = partial(TiffFile, size=size, to_rec2020=to_rec2020)
                self._stream(f"{lamp_name(lamp)}.tif", _REC2020, tiff, partial(_layer, lamp))
            if "lamps.jpg" in wanted:
                self._show(f"{lamp_name(lamp)}.jpg", to_srgb, partial(_shown_layer, lamp))
        if "layers.psd" in wanted:
            # imported only here: few ask for it
            from pipeline.encode.psd import PsdFile

            psd = partial(
                PsdFile, size=size, lamps=len(self._estimate.lamps), to_rec2020=to_rec2020
            )
            self._stream("layers.psd", _REC2020, psd, lambda pictures: pictures.layers)

    def _open_balanced(self, small: Pictures) -> None:
        wanted, neutral = self._wanted, self._model.neutral_to_xyz
        both = (_balanced_1, _balanced_2)
        for number, rows in enumerate(both, 1):
            name = f"white_balanced_{number}.jpg"
            if name in wanted:
                self._show(name, _as_shown(rows(small), XYZ_TO_SRGB @ neutral), rows)
        to_rec2020 = _fitting(XYZ_TO_REC2020 @ neutral, np.ones((1, 3)))
        tiff = partial(TiffFile, size=self._size, to_rec2020=to_rec2020)
        for number, rows in enumerate(both, 1):
            if f"white_balanced_{number}.tif" in wanted:
                self._stream(f"white_balanced_{number}.tif", _REC2020, tiff, rows)
        if "white_balanced.exr" in wanted:
            kind = ("16-bit float", f"{_CAMERA_RGB}, as under the neutral light")
            exr = partial(ExrFile, size=self._size, half=True)
            self._stream("white_balanced.exr", kind, exr, _both_balanced)

    def _open_response(self, small: Pictures, changes: Floats64, response: Response) -> None:
        """Through the other camera, the layers on the scale of the photograph."""
        if self._wanted & {"response.jpg", "response_lamps.jpg"}:
            to_srgb = _as_shown(small.response, XYZ_TO_SRGB @ response.camera_to_xyz)
            if "response.jpg" in self._wanted:
                self._show("response.jpg", to_srgb, lambda pictures: pictures.response)
            if "response_lamps.jpg" in self._wanted:
                for lamp, change in enumerate(changes):
                    layer = partial(_shown_layer, lamp)
                    self._show(f"response_{lamp_name(lamp)}.jpg", to_srgb @ change, layer)
        if "response.exr" in self._wanted:
            kind = (
                "16-bit float",
                "linear RGB of the other camera, exposed to the same green of D65",
            )
            exr = partial(ExrFile, size=self._size, half=True)
            self._stream(
                "response.exr",
                kind,
                exr,
                lambda pictures: _with_sum(_seen(pictures.layers, changes)),
            )

    def _open_normals(self) -> None:
        if "normals.png" in self._wanted:
            kind = (
                "16-bit, (n + 1)/2 · 65535, 0 = unknown",
                f"unit normals, {CONVENTIONS[self._convention]}",
            )
            png = partial(NormalsPng, size=self._size)
            self._stream("normals.png", kind, png, self._normals)
        if "normals.exr" in self._wanted:
            kind = ("32-bit float, NaN = unknown", f"unit normals, {CONVENTIONS[self._convention]}")
            exr = partial(ExrFile, size=self._size)
            self._stream("normals.exr", kind, exr, lambda rows: {"RGB": self._normals(rows)})

    def _normals(self, pictures: Pictures) -> Image | None:
        """Normals in the convention asked for."""
        if pictures.normals is None or self._convention == "gl":
            return pictures.normals
        return pictures.normals * np.array([1, -1, 1], np.float32)

    def _open_surface(self, small: Pictures, surface: Surface) -> None:
        from pipeline.photometric_stereo.detail import surface_depth  # few ask for it

        size = self._size[::-1]
        if "depth.exr" in self._wanted:
            kind = (
                "32-bit float, along the camera's axis, 1 in the median, NaN = unknown",
                "none",
            )
            self._at_last(
                "depth.exr", kind, lambda path: write_exr(path, {"Z": surface_depth(surface, size)})
            )
        if "surface.glb" not in self._wanted:
            return
        to_srgb = _as_shown(small.white_balanced_1, XYZ_TO_SRGB @ self._model.neutral_to_xyz)
        normals = CodedNormals((*size, 3))
        texture = Texture(self._size, to_srgb)

        def keep(pictures: Pictures) -> None:
            if pictures.normals is not None and pictures.white_balanced_1 is not None:
                normals.add(pictures.normals)
                texture.write(pictures.white_balanced_1)

        self._takers.append(keep)
        kind = (
            "glTF 2.0 binary, camera in the origin, x right, y up, z to the viewer, depth 1 in the "
            "median",
            "sRGB",
        )

        def write(path: Path) -> None:
            # imported only here: it takes longer than the rest of the writing
            from pipeline.encode.glb import write_glb

            mesh = make_mesh(surface_depth(surface, size), normals, surface.focal_px)
            write_glb(path, mesh, texture.close())

        self._at_last("surface.glb", kind, write)

    def _open_confidences(self, with_surface: bool) -> None:
        grey = partial(GrayTiffFile, size=self._size)
        if "confidence.tif" in self._wanted:
            kind = ("16-bit linear, 65535 = separated, 0 = could not be", "none")
            self._stream("confidence.tif", kind, grey, lambda pictures: pictures.confidence)
        if "normals_confidence.tif" in self._wanted and with_surface:
            kind = (
                "16-bit linear, 65535 = the normal can be trusted, 0 = it cannot, or there is none",
                "none",
            )
            self._stream(
                "normals_confidence.tif", kind, grey, lambda pictures: pictures.normals_confidence
            )

    def _open_previews(self, photograph: Photograph, clipping: float, small: Pictures) -> None:
        if "preview.exr" in self._wanted:
            kind = ("16-bit float", f"{_CAMERA_RGB}; Y: 1 = separated, 0 = could not be")
            preview = partial(PreviewFile, size=self._size)
            self._stream("preview.exr", kind, preview, _layers_and_confidence)
        if "thumbnail.jpg" in self._wanted:
            shown = self._with_white_highlights(thumbnail(photograph), clipping, small)
            to_srgb = _as_shown(photograph, XYZ_TO_SRGB @ self._model.camera_to_xyz)
            self._at_last("thumbnail.jpg", _SRGB, lambda path: write_jpeg(path, shown, to_srgb))

    def _with_white_highlights(self, picture: Image, clipping: float, small: Pictures) -> Image:
        """A photograph as it is shown: clipped light has the colour of all lamps together."""
        whites = whites_of(self._estimate.lamps, self._model)
        strengths = np.maximum(small.layers[..., 1].sum(axis=(1, 2)), _FAINTEST)
        white = strengths @ (whites / whites[:, 1:2])
        return np.asarray(shown_layers(picture[None], white[None], clipping)[0])

    def _open_diagrams(self, entries: list[dict[str, Any]]) -> None:
        reduced, lamps = self._estimate.reduced, self._estimate.lamps
        kind = ("8-bit", "sRGB")
        if "gamma.png" in self._wanted:
            labels = [_label(one) for one in entries]
            diagram = draw_gamma_diagram(reduced, lamps, self._model, labels)
            self._at_last("gamma.png", kind, lambda path: write_png8(path, diagram))
        if "residual.png" in self._wanted:
            residual = draw_residual_map(relative_residual(reduced, lamps))
            self._at_last("residual.png", kind, lambda path: write_png8(path, residual))


def _as_shown(picture: Photograph | None, to_srgb: Matrix) -> Matrix:
    """Make bright parts of a picture white, none of a picture that is not there."""
    return to_srgb if picture is None else shown_gain(picture, to_srgb) * to_srgb


def _layer(lamp: int, pictures: Pictures) -> Image:
    return np.asarray(pictures.layers[lamp])


def _shown_layer(lamp: int, pictures: Pictures) -> Image:
    return np.asarray(pictures.shown_layers[lamp])


def _balanced_1(pictures: Pictures) -> Image | None:
    return pictures.white_balanced_1


def _balanced_2(pictures: Pictures) -> Image | None:
    return pictures.white_balanced_2


def _both_balanced(pictures: Pictures) -> dict[str, Image | None]:
    return {"RGB": pictures.white_balanced_1, "any": pictures.white_balanced_2}


def _seen(layers: Floats32, changes: Floats64) -> Floats32:
    """Layers through the other camera (N, h, W, 3)."""
    return np.stack(
        [layer @ change.T.astype(np.float32) for layer, change in zip(layers, changes, strict=True)]
    )


def _with_sum(layers: Floats32) -> dict[str, Image]:
    """Layers and their sum by the names of their channels."""
    named = {lamp_name(index): layer for index, layer in enumerate(layers)}
    return named | {"RGB": layers.sum(axis=0)}


def _fitting(to_rec2020: Matrix, brightest: Matrix) -> Matrix:
    """Make what the brightest colours (n, 3) become fit: else the brightest light is cut off."""
    return np.asarray(to_rec2020 / max(1.0, float((brightest @ to_rec2020.T).max())))


def _brightest(camera: Camera) -> Matrix:
    """Camera RGB (n, 3) of the sensor's white, and of a white card as bright as it holds by lamp.

    Warm lamps fill the red channel alone, which may become more than the sensor's white does.
    """
    cards = lamp_spectra() @ camera.sensitivities.T
    return np.vstack([np.ones(3), cards / cards.max(axis=1, keepdims=True)])


def _layers_and_confidence(pictures: Pictures) -> dict[str, Floats32]:
    named = {lamp_name(index): layer for index, layer in enumerate(pictures.shown_layers)}
    return named | {"Y": pictures.confidence}


def _label(entry: dict[str, Any]) -> str:
    kelvin = "" if entry["cct_k"] is None else f", {entry['cct_k']} K"
    return f"{entry['name']}, {entry['family']} {entry['family_confidence']:.0%}{kelvin}"
