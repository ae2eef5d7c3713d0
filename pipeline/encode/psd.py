"""Photoshop files with a layer for each lamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from psd_tools.constants import BlendMode, ChannelID, ColorMode, Compression, Resource, Tag
from psd_tools.psd.document import PSD
from psd_tools.psd.header import FileHeader
from psd_tools.psd.image_data import ImageData
from psd_tools.psd.image_resources import ImageResource, ImageResources
from psd_tools.psd.layer_and_mask import (
    ChannelData,
    ChannelDataList,
    ChannelImageData,
    ChannelInfo,
    GlobalLayerMaskInfo,
    LayerAndMaskInformation,
    LayerInfo,
    LayerInfoBlock,
    LayerRecord,
    LayerRecords,
)
from psd_tools.psd.tagged_blocks import TaggedBlock, TaggedBlocks

from pipeline.arrays import Floats32
from pipeline.colour.icc import linear_rec2020_profile
from pipeline.encode.psd_size import check_psd_size
from pipeline.encode.tiff import codes_of
from pipeline.images.frames import Matrix, numbers_of
from pipeline.result_names import lamp_name

_DEPTH = 16
_WHITE = 65535


class PsdFile:
    """A Photoshop file with a layer per lamp, 16-bit linear Rec. 2020 with its ICC profile.

    The layers above the first are blended by "Linear Dodge (Add)", so that all together are the
    photograph, which is also what programs without layers show. The file is written whole at the
    end; until then its pixels are kept.
    """

    def __init__(self, path: Path, size: tuple[int, int], lamps: int, to_rec2020: Matrix) -> None:
        """size: (width, height). to_rec2020: matrix (3, 3) from a pixel to linear Rec. 2020.

        Raises OptionError for a picture larger than the format holds.
        """
        check_psd_size(size, lamps)
        width, height = size
        self._path = path
        self._matrix = numbers_of(to_rec2020)
        self._layers = np.empty((lamps, 3, height, width), ">u2")
        self._next = 0

    def write(self, layers: Floats32) -> None:
        """Take the next rows (N, h, W, 3), 1.0 = white; what lies outside 0 to 1 is cut off."""
        rows = slice(self._next, self._next + layers.shape[1])
        for kept, layer in zip(self._layers, layers, strict=True):
            kept[:, rows] = np.moveaxis(codes_of(layer, self._matrix), -1, 0)
        self._next = rows.stop

    def close(self) -> None:
        """Write the file. Raises OSError."""
        _, channels, height, width = self._layers.shape
        header = FileHeader(
            channels=channels, height=height, width=width, depth=_DEPTH, color_mode=ColorMode.RGB
        )
        resources = ImageResources.new()
        profile = ImageResource(key=Resource.ICC_PROFILE.value, data=linear_rec2020_profile())
        resources[Resource.ICC_PROFILE] = profile
        # The bottom one replaces what is below it; the others are light added to it.
        modes = [BlendMode.NORMAL] + [BlendMode.LINEAR_DODGE] * (len(self._layers) - 1)
        made = [
            _layer(lamp_name(lamp), planes, mode)
            for lamp, (planes, mode) in enumerate(zip(self._layers, modes, strict=True))
        ]
        blocks = TaggedBlocks()
        # Layers of 16 bits are kept beside the place where those of 8 bits are.
        blocks[Tag.LAYER_16] = TaggedBlock(
            key=Tag.LAYER_16,
            data=LayerInfoBlock(
                layer_count=len(made),
                layer_records=LayerRecords([record for record, _ in made]),
                channel_image_data=ChannelImageData([data for _, data in made]),
            ),
        )
        layers = LayerAndMaskInformation(
            layer_info=LayerInfo(),
            global_layer_mask_info=GlobalLayerMaskInfo(),
            tagged_blocks=blocks,
        )
        whole = ImageData(Compression.RAW)
        whole.set_data([plane.tobytes() for plane in self._sum()], header)
        document = PSD(
            header=header,
            image_resources=resources,
            layer_and_mask_information=layers,
            image_data=whole,
        )
        with self._path.open("wb") as file:
            document.write(file)

    def _sum(self) -> NDArray[np.uint16]:
        total = self._layers[0].astype(np.uint32)
        for layer in self._layers[1:]:
            total += layer
        return np.asarray(np.minimum(total, _WHITE), dtype=">u2")


def _layer(
    name: str, planes: NDArray[np.uint16], mode: BlendMode
) -> tuple[LayerRecord, ChannelDataList]:
    _, height, width = planes.shape
    infos, datas = [], ChannelDataList()
    for number, plane in enumerate(planes):
        data = ChannelData(Compression.RAW)
        length = data.set_data(plane.tobytes(), width, height, _DEPTH)
        infos.append(ChannelInfo(ChannelID(number), length + 2))  # and the kind of compression
        datas.append(data)
    blocks = TaggedBlocks()
    blocks.set_data(Tag.UNICODE_LAYER_NAME, name)
    record = LayerRecord(
        top=0,
        left=0,
        bottom=height,
        right=width,
        channel_info=infos,
        blend_mode=mode,
        name=name,
        tagged_blocks=blocks,
    )
    return record, datas
