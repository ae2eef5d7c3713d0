"""Levels of black and white of a DNG, as its tags tell them for each photosite and colour.

LibRaw keeps whole numbers, a mean of what rows and columns add, and one white for all colours.
Source: DNG specification 1.7.1 (BlackLevel, BlackLevelRepeatDim, BlackLevelDeltaH and V,
WhiteLevel, ActiveArea, MaskedAreas).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tifffile import TiffPage, TiffTag

from pipeline.arrays import Floats64
from pipeline.decode.samples import UnsuitableError
from pipeline.decode.tiff import (
    ACTIVE_AREA,
    BLACK_REPEATS,
    CFA,
    FLOATS,
    LOSSY_JPEG,
    WHITE_LEVEL,
    dng_page,
)

BLACK_LEVEL = 50714
_BY_COLUMN, _BY_ROW = 50715, 50716
_MASKED_AREAS = 50830
_IN_THE_FIRST = (BLACK_REPEATS, BLACK_LEVEL, WHITE_LEVEL)
_RATIONALS = {5: "u4", 10: "i4"}
_LOSSY_WHITES = (255, 65535)
"""Those of 8 bits, and of what LibRaw makes of them."""
_ANEW = "save it anew as a DNG, or as a TIFF of 16 bits."


@dataclass(frozen=True)
class Levels:
    """Levels of a picture of integers.

    origin: (top, left) of the active area, where all of black begins. black: (rows, columns,
    samples), which repeats. by_row, by_column: added to it. white: of each sample.
    """

    origin: tuple[int, int]
    black: Floats64
    by_row: Floats64
    by_column: Floats64
    white: Floats64

    def over(self, top: int, left: int, height: int, width: int) -> Floats64:
        """Black (height, width, samples) of a part of the picture with its margins."""
        y = top - self.origin[0] + np.arange(height)
        x = left - self.origin[1] + np.arange(width)
        repeated = self.black[np.ix_(y % self.black.shape[0], x % self.black.shape[1])]
        added = np.add.outer(
            self.by_row[y % len(self.by_row)], self.by_column[x % len(self.by_column)]
        )
        return np.asarray(repeated + added[..., None])

    def most_black(self) -> Floats64:
        """Largest level of black of each sample, from which white is measured."""
        most = self.black.max(axis=(0, 1)) + self.by_row.max() + self.by_column.max()
        return np.asarray(most)

    @property
    def varies(self) -> bool:
        """Whether rows or columns differ by more than what repeats."""
        return bool(np.ptp(self.by_row) > 0 or np.ptp(self.by_column) > 0)

    def repeats_from(self, top: int, left: int) -> bool:
        """Whether what repeats begins at a place of the picture with its margins."""
        rows, columns, _ = self.black.shape
        begins = (top - self.origin[0]) % rows == 0 and (left - self.origin[1]) % columns == 0
        return bool(begins)


def dng_levels(data: bytes) -> Levels | None:
    """Levels of the full picture of a DNG of integers.

    None for any other file, and for one with masked photosites, of which LibRaw measures black.
    Raises UnsuitableError for levels that say nothing of the values, and for those of floats and
    of lossy DNGs that LibRaw does not follow.
    """
    try:
        with dng_page(data) as page:
            return None if page is None else _checked(page)
    except UnsuitableError:
        raise
    except Exception:  # not a TIFF, or a damaged one, for LibRaw to judge
        return None


def numbers(page: TiffPage, code: int, usual: float) -> Floats64:
    """Values of a tag, fractions or not, in a row; the usual one where there is no such tag."""
    tag = _tag(page, code)
    if tag is None:
        return np.array([usual], np.float64)
    if tag.dtype not in _RATIONALS:
        return np.atleast_1d(np.asarray(tag.value, np.float64))
    file = page.parent.filehandle
    file.seek(tag.valueoffset)  # of long ones tifffile gives the first half
    kind = f"{page.parent.byteorder}{_RATIONALS[tag.dtype]}"
    parts = np.frombuffer(file.read(8 * tag.count), kind).astype(np.float64)
    return np.asarray(parts[0::2] / parts[1::2])


def _tag(page: TiffPage, code: int) -> TiffTag | None:
    """Tag of a picture, or the first directory's, to which some write levels; as LibRaw has it."""
    tag = page.tags.get(code)
    elsewhere = tag is None and code in _IN_THE_FIRST
    return page.parent.pages.first.tags.get(code) if elsewhere else tag


def _checked(page: TiffPage) -> Levels | None:
    levels = _levels(page)
    if not (levels.most_black() < levels.white).all():
        raise UnsuitableError(
            f"is a DNG whose white (WhiteLevel) is no brighter than black: {_ANEW}"
        )
    if page.sampleformat == FLOATS:
        _refuse_floats(page, levels)
    elif page.compression == LOSSY_JPEG:
        _refuse_lossy(levels)
    elif not (page.photometric == CFA and _MASKED_AREAS in page.tags):
        return levels
    return None


def _levels(page: TiffPage) -> Levels:
    samples = int(page.samplesperpixel)
    floats = page.sampleformat == FLOATS
    repeat = _tag(page, BLACK_REPEATS)
    rows, columns = (1, 1) if repeat is None else map(int, repeat.value)
    black = numbers(page, BLACK_LEVEL, 0)
    needed = rows * columns * samples
    if black.size not in (needed, rows * columns):  # the latter are for all samples
        raise UnsuitableError(
            f"is a DNG with {black.size} levels of black (BlackLevel) where there must be "
            f"{needed}: {_ANEW}"
        )
    white = numbers(page, WHITE_LEVEL, 1 if floats else 2**page.bitspersample - 1)[:samples]
    if white.size not in (1, samples):
        raise UnsuitableError(
            f"is a DNG with {white.size} levels of white (WhiteLevel) where there must be "
            f"{samples}: {_ANEW}"
        )
    area = page.tags.valueof(ACTIVE_AREA, (0, 0, page.imagelength, page.imagewidth))
    top, left, bottom, right = (int(side) for side in area)
    by_row, by_column = numbers(page, _BY_ROW, 0), numbers(page, _BY_COLUMN, 0)
    if by_row.size not in (1, bottom - top) or by_column.size not in (1, right - left):
        raise UnsuitableError(
            "is a DNG with levels of black for other rows or columns than it has "
            f"(BlackLevelDeltaV, BlackLevelDeltaH): {_ANEW}"
        )
    return Levels(
        origin=(top, left),
        black=np.broadcast_to(black.reshape(rows, columns, -1), (rows, columns, samples)),
        by_row=by_row,
        by_column=by_column,
        white=np.broadcast_to(white, samples),
    )


def _refuse_floats(page: TiffPage, levels: Levels) -> None:
    """Raise UnsuitableError where LibRaw would scale floats by other levels."""
    black = levels.black
    followed = not (levels.by_row.any() or levels.by_column.any()) and (black % 1 == 0).all()
    if page.photometric != CFA:
        alike = np.ptp(black) == 0 and np.ptp(levels.white) == 0
        told = numbers(page, BLACK_LEVEL, 0).size, numbers(page, WHITE_LEVEL, 0).size
        # of one level of black for all LibRaw takes it from several levels of white twice
        followed = followed and alike and (told[0] > 1 or told[1] == 1 or not black.any())
    if not followed:
        raise UnsuitableError(
            "is a DNG of floats whose levels of black or white (BlackLevel, WhiteLevel) are not "
            "read: save it as a TIFF or an OpenEXR of floats."
        )


def _refuse_lossy(levels: Levels) -> None:
    """Raise UnsuitableError where LibRaw, which passes levels of lossy DNGs over, needs them."""
    black = levels.black.any() or levels.by_row.any() or levels.by_column.any()
    if black or not np.isin(levels.white, _LOSSY_WHITES).all():
        raise UnsuitableError(
            "is a lossy DNG with levels of black or white (BlackLevel, WhiteLevel), which are not "
            "read: save it as a lossless DNG, or as a TIFF."
        )
