"""What is evaluated: groups of scenes, each under a condition, by some methods."""

from __future__ import annotations

from dataclasses import dataclass, field

from tests.evaluation.capture import Contrast
from tests.evaluation.conditions import Condition
from tests.evaluation.white_balance import BALANCES

BASES = ("paper_pca", "paper_joint")
ALL = (
    "equal",
    "nnmf",
    "von_kries",
    "paper",
    "paper_shared",
    "best",
    "known",
    "best_3x3",
    "tuned_3x3",
)
FEW = ("equal", "paper", "paper_shared", "best", "best_3x3")
OURS = ("best",)
OF_CAMERAS = ("equal", "paper", "best", "known", "best_3x3")
OF_CONTRASTS = ("equal", "best")
WHITE = tuple(BALANCES)
WHITE_OF_MORE = tuple(name for name in BALANCES if name != "hsu_2008")


@dataclass(frozen=True)
class Experiment:
    """Scenes of a group under a condition. group: one of scenes.GROUPS.

    methods: all of them ways to separate, or all of them ways to balance white.
    """

    group: str
    methods: tuple[str, ...] = FEW
    condition: Condition = field(default_factory=Condition)


def _noisy(exposure: float) -> Condition:
    return Condition(files="noisy", exposure=exposure)


_CONTRASTS: tuple[Contrast, ...] = ("s-curve", "strong")
_AUTO = Condition(lights="auto")
_AUTO_NOISY = Condition(lights="auto", files="noisy")

EXPERIMENTS: dict[str, Experiment] = {
    "two": Experiment("two", (*ALL, *BASES)),
    "three": Experiment("three", ALL),
    "broad-two": Experiment("broad-two", ALL),
    "broad-three": Experiment("broad-three", ALL),
    "angle": Experiment("angle"),
    "bounces": Experiment("bounces"),
    "roughness": Experiment("roughness"),
    "smooth-two": Experiment("smooth-two", ALL),
    "smooth-three": Experiment("smooth-three", ALL),
    "wall-two": Experiment("wall-two"),
    "wall-three": Experiment("wall-three"),
    "two-noise": Experiment("two", FEW, _noisy(1.0)),
    "two-noise-half": Experiment("two", FEW, _noisy(1 / 2)),
    "two-noise-quarter": Experiment("two", FEW, _noisy(1 / 4)),
    "two-noise-eighth": Experiment("two", FEW, _noisy(1 / 8)),
    "three-noise": Experiment("three", FEW, _noisy(1.0)),
    "three-noise-eighth": Experiment("three", FEW, _noisy(1 / 8)),
    "smooth-two-noise": Experiment("smooth-two", FEW, _noisy(1.0)),
    "smooth-three-noise": Experiment("smooth-three", FEW, _noisy(1.0)),
    "two-motion": Experiment("two", FEW, Condition(motion_px=2.0)),
    "three-motion": Experiment("three", FEW, Condition(motion_px=2.0)),
    "two-wrong-flash": Experiment("two", FEW, Condition(flash="led")),
    "two-wrong-camera": Experiment("two", FEW, Condition(camera="Sigma SD1 Merrill")),
    "two-untold-camera": Experiment("two", FEW, Condition(camera_told=False)),
    "three-untold-camera": Experiment("three", FEW, Condition(camera_told=False)),
    "two-jpeg": Experiment("two", FEW, Condition(files="jpeg")),
    "three-jpeg": Experiment("three", FEW, Condition(files="jpeg")),
    "two-jpeg-mapped": Experiment("two", FEW, Condition(files="jpeg", mapping=0.3)),
    "two-walk": Experiment("two", FEW, Condition(files="noisy", walk=0.05)),
    "three-walk": Experiment("three", FEW, Condition(files="noisy", walk=0.05)),
    "two-changed": Experiment("two", FEW, Condition(files="noisy", lamp_change=0.1)),
    **{
        f"{group}-jpeg-{contrast}": Experiment(
            group, OF_CONTRASTS, Condition(files="jpeg", contrast=contrast)
        )
        for contrast in _CONTRASTS
        for group in ("two", "three")
    },
    **{
        f"cameras-{lamps}{suffix}": Experiment(f"cameras-{lamps}", methods, condition)
        for lamps in ("two", "three")
        for suffix, methods, condition in (
            ("", OF_CAMERAS, Condition()),
            ("-untold", OURS, Condition(camera_told=False)),
            ("-jpeg", ("best", "best_3x3"), Condition(files="jpeg")),
        )
    },
    **{
        f"{group}-auto": Experiment(group, OURS, _AUTO)
        for group in ("one", "two", "three", "four", "broad-two", "broad-three")
    },
    **{
        f"{group}-auto-noise": Experiment(group, OURS, _AUTO_NOISY)
        for group in ("one", "two", "three", "four")
    },
    "white-two": Experiment("two", WHITE),
    "white-three": Experiment("three", WHITE_OF_MORE),
    "white-two-led": Experiment("two-led", WHITE),
    "white-two-noise": Experiment("two", WHITE, _noisy(1.0)),
}
"""By name. A name is that of the group, and of what differs from exact files of equal exposure,
taken from a tripod, with everything told."""
