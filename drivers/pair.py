"""Whether two photographs are a pair: all equal but the flash."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from drivers.camera import Camera, SettingName, SettingValue
from drivers.errors import NoFlashError, PairVerificationError
from drivers.shot import Shot

_BRIGHTER = 1.02
"""How much brighter the flash makes a photograph at least, where EXIF does not tell of it."""

_NOISE = 1e-4
"""By how much at least, where 1 is white: noise in the dark does less."""


@dataclass(frozen=True)
class CapturedPair:
    """The two photographs.

    settings: what stood in the camera for both, to be given to the capture of another pair.
    """

    no_flash: Shot
    flash: Shot
    settings: Mapping[SettingName, SettingValue] = field(default_factory=dict, compare=False)

    def delete_from(self, camera: Camera, best_alone: bool = False) -> None:
        """Delete the photographs from the camera's card. Raises what Camera.delete raises.

        best_alone: leave the JPEG of RAW + JPEG there, as where only the best file was stored.
        """
        for shot in (self.no_flash, self.flash):
            for item in shot.stored:
                if not best_alone or item.kind == shot.best_kind:
                    camera.delete(item.handle)


def verify(pair: CapturedPair, brightness: Callable[[bytes], float] | None) -> None:
    """Check that the flash alone differs.

    brightness: tells how bright a photograph is, linear, 1 where it is white, for a flash that
    the camera does not know of. Raises PairVerificationError, NoFlashError.
    """
    if pair.no_flash.files.keys() != pair.flash.files.keys():
        raise PairVerificationError(
            "The two photographs came as files of different kinds: take the pair again."
        )
    without, with_flash = pair.no_flash.exposure, pair.flash.exposure
    if without.flash_fired:
        raise PairVerificationError(
            "The flash fired in the photograph that was to be without it: switch it to manual and "
            "take the pair again."
        )
    for name, first, second in (
        ("exposure time", without.time_s, with_flash.time_s),
        ("f-number", without.f_number, with_flash.f_number),
        ("ISO", without.iso, with_flash.iso),
    ):
        if first != second:  # of an aperture both may lack it: a manual lens keeps its own
            told, then = ("none told" if one is None else one for one in (first, second))
            raise PairVerificationError(
                f"The two photographs differ in {name} ({told} and {then}): set the camera to "
                "manual exposure and take the pair again."
            )
    if with_flash.flash_fired:
        return
    if brightness is None:
        raise NoFlashError(
            "The flash did not fire: put it up, let it charge and take the pair again."
        )
    _require_lit(brightness(pair.no_flash.best), brightness(pair.flash.best))


def _require_lit(without: float, with_flash: float) -> None:
    if _is_brighter(with_flash, without):
        return
    if _is_brighter(without, with_flash):
        raise NoFlashError(
            "The photograph that was to be without the flash is the brighter one: check whether "
            "on and off of the flash are swapped, or other light has changed, and take the pair "
            "again."
        )
    raise NoFlashError(
        "The flash did not fire, or fired in both photographs: check it, its switch and the lens "
        "cap, let it charge and take the pair again."
    )


def _is_brighter(one: float, other: float) -> bool:
    return one > _BRIGHTER * other and one > other + _NOISE
