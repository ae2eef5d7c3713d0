"""What a camera's rendering to sRGB made of a pair: found, and taken off both photographs.

In the order in which cameras do it: white balance, local tone mapping, a contrast, sRGB's curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipeline.images.frames import Frame, Mask, Photograph
from pipeline.pair.balance_change import BalanceChange
from pipeline.pair.exposure import ExposureRatio
from pipeline.pair.find_balance_change import find_balance_change, settle_balance_change
from pipeline.pair.find_local_tone_mapping import find_local_tone_mapping
from pipeline.pair.find_ratio_and_balance import find_ratio_and_balance
from pipeline.pair.find_rendered_ratio import find_rendered_ratio
from pipeline.pair.find_tone_curve import find_tone_curve
from pipeline.pair.local_tone_mapping import LocalToneMapping
from pipeline.pair.one_surface import PairBlocks, average_pair, find_neighbours
from pipeline.pair.tone_curve import ToneCurve


@dataclass(frozen=True)
class Rendering:
    """What is to be taken off, None where nothing was found.

    tone: the contrast on top of sRGB's curve. mapping, balance: of the flash photograph alone.
    ratio: of the exposures, where nobody knew it and the pair told it.
    """

    tone: ToneCurve | None = None
    mapping: LocalToneMapping | None = None
    balance: BalanceChange | None = None
    ratio: ExposureRatio | None = None

    def off_no_flash(self, frame: Frame) -> Frame:
        """The photograph without the flash, in light."""
        return frame if self.tone is None else self.tone.frame(frame)

    def off_flash(self, frame: Frame, laid: Photograph) -> tuple[Frame, Photograph]:
        """The flash photograph in light, and as it was laid on the other, mapped and balanced so.

        laid: (H, W, 3); is written over unless it is the frame's own. The frame's noise goes along,
        and its pixels stay as far as they are not those laid.
        """
        own = laid is not frame.pixels
        if self.tone is not None:
            frame = self.tone.frame(frame)
            laid = self.tone.photograph(laid, own=True) if own else frame.pixels
        for change in (self.mapping, self.balance):
            if change is not None:
                compression = frame.compression and change.noise(frame.compression)
                frame = replace(frame, compression=compression)
                laid = change.photograph(laid, own=laid is not frame.pixels)
        return frame, laid


def find_rendering(
    no_flash: Frame, flash: Frame, laid: Photograph, unusable: Mask, ratio: ExposureRatio
) -> Rendering:
    """Ask a pair what its camera made of it.

    laid: the flash photograph (H, W, 3) as it lies on the other. unusable: (H, W), of either.
    ratio: where nobody knows it, it and a contrast are looked for, as the others look like one.
    """
    blocks = average_pair(no_flash.pixels, laid, unusable)
    known, balances_differ = ratio.source != "assumed", _balances_may_differ(no_flash, flash)
    shown, balance = (None, None) if known else _find_ratio(blocks, balances_differ)
    found = None if shown is None else ExposureRatio(ratio.value * shown, "pixels")
    neighbours = find_neighbours(blocks, (found or ratio).value)
    if neighbours is None:
        return Rendering(ratio=found)
    balances_differ = known and balances_differ
    balance = find_balance_change(neighbours) if balances_differ else balance
    mapping = find_local_tone_mapping(blocks, neighbours, balance) if known else None
    if mapping is not None:
        neighbours = neighbours.brightened_by(mapping.logs)
        balance = find_balance_change(neighbours) if balances_differ else None
    tone = find_tone_curve(neighbours, balance, known or found is not None)
    if balance is not None:
        balance, tone = settle_balance_change(neighbours, balance, tone)
    return Rendering(tone, mapping, balance, found)


def _find_ratio(
    blocks: PairBlocks, balances_differ: bool
) -> tuple[float | None, BalanceChange | None]:
    """The ratio of a pair whose exposures nobody knows, and a balance that differs as well.

    None for exposures and for balances that are taken to be equal.
    """
    alone = find_rendered_ratio(blocks)
    both = find_ratio_and_balance(blocks, alone) if balances_differ else None
    if both is None:
        return alone, None
    ratio, balance = both
    return (ratio if ratio != 1.0 else None), balance


def _balances_may_differ(no_flash: Frame, flash: Frame) -> bool:
    """Whether the camera may have balanced the white of either photograph by itself."""
    return no_flash.auto_white_balance is not False or flash.auto_white_balance is not False
