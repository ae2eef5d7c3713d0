"""Whether what cannot be done is said: scenes made for each cause, and the warnings they get.

Writes docs/warnings.md, for the development and the report scenes.
"""

from __future__ import annotations

import statistics
import sys
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import get_args

from pipeline.run_warnings import Code
from tests.evaluation.conditions import Condition
from tests.evaluation.environment import settle
from tests.evaluation.figures import codes
from tests.evaluation.results import Result, run_scene
from tests.evaluation.scenes import Scene, scenes
from tests.evaluation.spectra import Split
from tests.evaluation.tables import Rows, markdown

_DOC = Path(__file__).parents[2] / "docs" / "warnings.md"
_HEAD = Path(__file__).with_name("warnings_head.md")
_WORKERS = 2
_LEAST_SHOWN, _MOST_FALSE = 0.9, 0.05


@dataclass(frozen=True)
class Case:
    """Scenes of one cause. group: of scenes.GROUPS. expected: the warning, None for clean scenes.

    keep: which scenes of the group show the cause. most: of them to take, from the first.
    """

    text: str
    group: str
    condition: Condition
    expected: Code | None
    keep: Callable[[Scene], bool] = lambda _: True
    most: int = 2

    def scenes(self, split: Split) -> list[Scene]:
        """Return the scenes of one half."""
        return [scene for scene in scenes(self.group, split) if self.keep(scene)][: self.most]


def _plain(scene: Scene) -> bool:
    return scene.angle_deg >= 10.0


def _alike(scene: Scene) -> bool:
    return scene.angle_deg < 5.5


def _bounced(scene: Scene) -> bool:
    return scene.geometry.depth is None


def _shiny(scene: Scene) -> bool:
    return scene.geometry.roughness == 0.1


_AUTO = Condition(lights="auto")
_NOISY = Condition(lights="auto", files="noisy")
_TOLD_NOISY = Condition(files="noisy")
_WEAK = Condition(lights="auto", files="noisy", flash_strength=1 / 32)
_MISSED = Condition(lights=1)
_WRONG_CAMERA = Condition(lights="auto", camera="Sigma SD1 Merrill")
_WRONG_RATIO = Condition(lights="auto", exposure_ratio=1.5)
_SHAKEN = Condition(lights="auto", files="noisy", shake_px=4.0)
_UNSTEADY = Condition(lights="auto", files="noisy", lamp_change=0.2)
_BANDED = Condition(lights="auto", files="noisy", bands=0.2)
_VIGNETTED = Condition(lights="auto", files="noisy", vignetting=0.3)
_JPEG = Condition(lights="auto", files="jpeg")
_WALKED = Condition(lights="auto", files="noisy", walk=0.05)
_MAPPED = Condition(lights="auto", files="jpeg", mapping=0.3)
_FOR_BULBS = Condition(lights="auto", files="jpeg", balance="bulbs")

CASES = (
    Case("one lamp", "one", _AUTO, None, most=3),
    Case("two lamps, 10° or more apart", "two", _AUTO, None, _plain, 3),
    Case("two lamps, sensor noise", "two", _NOISY, None, _plain, 3),
    Case("three lamps", "three", _AUTO, None, most=3),
    Case("objects before black, sensor noise", "smooth-two", _NOISY, None, most=3),
    Case("four lamps", "four", _AUTO, Code.FOUR_OR_MORE),
    Case("lamps 1° to 5° apart", "angle", Condition(), Code.LAMPS_ALIKE, _alike, 3),
    Case("the same, sensor noise", "angle", _TOLD_NOISY, Code.LAMPS_ALIKE, _alike),
    Case("light of endless bounces", "bounces", _AUTO, Code.REFLECTIONS, _bounced),
    Case("plastic of roughness 0.1", "roughness", _AUTO, Code.REFLECTIONS, _shiny),
    Case("two lamps, never alone", "panels-two", _AUTO, Code.NO_PURE_LIGHT),
    Case("three lamps, never alone", "panels-three", _AUTO, Code.NO_PURE_LIGHT),
    Case("a flash of 1/32 of the lamps, sensor noise", "two", _WEAK, Code.FLASH_TOO_WEAK),
    Case("one lamp asked for of two", "two", _MISSED, Code.UNEXPLAINED, _plain),
    Case("another camera named", "two", _WRONG_CAMERA, Code.CAMERA_DOUBTFUL),
    Case("a wrong exposure ratio", "two", _WRONG_RATIO, Code.EXPOSURE_MISMATCH),
    Case("shaken by 4 px, sensor noise", "two", _SHAKEN, Code.BLURRED, most=3),
    Case("a lamp 20 % brighter with the flash, sensor noise", "two", _UNSTEADY, Code.LIGHT_CHANGED),
    Case("bands of lamps that flicker, sensor noise", "two", _BANDED, Code.FLICKER, most=3),
    Case("darker corners with the flash, sensor noise", "two", _VIGNETTED, Code.VIGNETTING, most=3),
    Case("a person walks by 5 % of the width, sensor noise", "two", _WALKED, Code.MOVED, most=3),
    Case("JPEG", "two", _JPEG, Code.RENDERED_SRGB),
    Case("JPEG, locally tone mapped", "two", _MAPPED, Code.LOCAL_TONE_MAPPING, _plain, 3),
    Case("JPEG balanced for bulbs", "two", _FOR_BULBS, Code.FLASH_BLUE),
)

Found = dict[Split, list[tuple[Case, list[Result]]]]


def main() -> None:
    """Run all cases on both halves and write the document."""
    found = run()
    text = "\n\n".join([_HEAD.read_text(encoding="utf-8").rstrip(), *sections(found)]) + "\n"
    _DOC.write_text(text, encoding="utf-8")


def run() -> Found:
    """Results of every case, in the order of CASES."""
    settle()
    found: Found = {}
    with ProcessPoolExecutor(_WORKERS, mp_context=get_context("spawn")) as pool:
        waiting = {
            split: [
                (case, [pool.submit(run_scene, s, case.condition, ("best",)) for s in chosen])
                for case in CASES
                if (chosen := case.scenes(split))
            ]
            for split in get_args(Split)
        }
        for split, cases in waiting.items():
            found[split] = []
            for case, futures in cases:
                results = [future.result()[0] for future in futures]
                found[split].append((case, results))
                told = ", ".join(f"{code} {n}" for code, n in _counts(results).items())
                sys.stdout.write(f"{split}  {case.text} ({len(results)}): {told}\n")
                sys.stdout.flush()
    return found


def sections(found: Found) -> list[str]:
    """Parts of the document: what is asked, a table for each half, how far expected SNR is off."""
    parts = [markdown(_asked(found))]
    for split, cases in found.items():
        wrong = "; ".join(missed(cases)) or "nothing"
        parts += [f"## {split.capitalize()} scenes", markdown(table(cases))]
        parts += [f"Not as it should be: {wrong}."]
    parts += ["## Expected SNR of lamps that are alike", markdown(expectations(found))]
    return parts


def table(cases: list[tuple[Case, list[Result]]]) -> Rows:
    """A row for each case: how many of its scenes get which warning; the expected one is bold."""
    columns = [
        code for code in Code if any(code in codes(one) for _, results in cases for one in results)
    ]
    rows = [["scenes", "number", *(f"`{code}`" for code in columns), "none", "refused"]]
    for case, results in cases:
        counts = _counts(results)
        cells = []
        for code in columns:
            number = str(counts[code]) if counts[code] else ""
            cells.append(f"**{number or 0}**" if code == case.expected else number)
        silent = sum(not one.warnings and not one.refusal for one in results)
        refused = sum(bool(one.refusal) for one in results)
        own = [str(n) if n else "" for n in (silent, refused)]
        rows.append([case.text, str(len(results)), *cells, *own])
    return rows


def shown(cases: list[tuple[Case, list[Result]]], code: Code) -> tuple[int, int]:
    """How many of the scenes made for a warning get it or are refused, and how many there are."""
    own = [one for case, results in cases if case.expected == code for one in results]
    return sum(code in codes(one) or bool(one.refusal) for one in own), len(own)


def false_on_clean(cases: list[tuple[Case, list[Result]]]) -> tuple[int, int]:
    """How many of the clean scenes get any warning, and how many there are."""
    own = [one for case, results in cases if case.expected is None for one in results]
    return sum(bool(one.warnings or one.refusal) for one in own), len(own)


def missed(cases: list[tuple[Case, list[Result]]]) -> list[str]:
    """Scenes whose warning is missing, and clean ones with a warning."""
    out = []
    for case, results in cases:
        for one in results:
            if case.expected is None and (one.warnings or one.refusal):
                out.append(f"{one.scene} gets {', '.join(sorted(codes(one))) or 'refused'}")
            elif case.expected and case.expected not in codes(one) and not one.refusal:
                out.append(f"{one.scene} lacks {case.expected}")
    return out


def expectations(found: Found) -> Rows:
    """Expected and true joint SNR in dB of lamps that are alike, medians by half."""
    rows = [["scenes", "number", "expected, dB", "true, dB", "off by, dB: median / most"]]
    for split, cases in found.items():
        pairs = [
            (warning["figures"]["expected_snr_db"], one.snr_db)
            for _, results in cases
            for one in results
            for warning in one.warnings
            if warning["code"] == Code.LAMPS_ALIKE and one.snr_db is not None
        ]
        if pairs:
            off = [abs(expected - true) for expected, true in pairs]
            middle = [statistics.median(column) for column in zip(*pairs, strict=True)]
            cells = [f"{value:.1f}" for value in middle]
            most = f"{statistics.median(off):.1f} / {max(off):.1f}"
            rows.append([split, str(len(pairs)), *cells, most])
    return rows


def _asked(found: Found) -> Rows:
    rows = [["asked", *found]]
    for code in dict.fromkeys(case.expected for case in CASES if case.expected):
        cells = []
        for cases in found.values():
            number, of = shown(cases, code)
            cells.append(_verdict(number, of, number >= _LEAST_SHOWN * of))
        rows.append([f"`{code}` on its scenes, ≥ {_LEAST_SHOWN:.0%}", *cells])
    cells = []
    for cases in found.values():
        number, of = false_on_clean(cases)
        cells.append(_verdict(number, of, number <= _MOST_FALSE * of))
    rows.append([f"any warning on clean scenes, ≤ {_MOST_FALSE:.0%}", *cells])
    return rows


def _verdict(number: int, of: int, met: bool) -> str:
    return f"{number} of {of}{'' if met else ', **not met**'}"


def _counts(results: list[Result]) -> Counter[str]:
    return Counter(code for one in results for code in sorted(codes(one)))


if __name__ == "__main__":
    main()
