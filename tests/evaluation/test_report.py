from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from pipeline.run_warnings import Code, RunWarning
from tests.evaluation import __main__ as program
from tests.evaluation import tables
from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.figures import Outcome, confusion, right, too_alike
from tests.evaluation.goals import Failure, failures, goals
from tests.evaluation.methods import METHODS
from tests.evaluation.report import write_report
from tests.evaluation.results import Result
from tests.evaluation.scenes import CAMERA, Scene, scenes
from tests.evaluation.white_balance import BALANCES

FIGURES = dict.fromkeys(METHODS, 10.0) | {
    "paper": 17.0,
    "paper_shared": 18.0,
    "best": 26.5,
    "best_3x3": 27.0,
    "tuned_3x3": 30.0,
    **dict.fromkeys(BALANCES, 35.0),
}

_FOUR = RunWarning(Code.FOUR_OR_MORE, "It looks like four lamps or more.").entry()
_ERRORS = {"paper": 1.5, "best": 1.5, **dict.fromkeys(BALANCES, 0.2)}


def result(scene: Scene, method: str, **changes: object) -> Result:
    count = len(scene.lamp_spectra)
    auto = Result(
        scene=scene.name,
        method=method,
        snr_db=FIGURES[method] if count < 4 else None,
        error_deg=_ERRORS.get(method),
        lamps=count,
        found=min(count, 3),
        confidence=0.95,
        warnings=(_FOUR,) if count > 3 else (),
        refusal="",
        cpu_s=FIGURES[method],
    )
    return replace(auto, **changes)  # type: ignore[arg-type]  # the test names real fields


@cache
def scenes_of(group: str) -> tuple[Scene, ...]:
    return tuple(scenes(group, "report"))


def good() -> Outcome:
    """What the report would be made of if every scene of a method were alike."""
    results: dict[str, list[Result]] = {}
    known: dict[str, Scene] = {}
    for name, experiment in EXPERIMENTS.items():
        own = scenes_of(experiment.group)
        known |= {scene.name: scene for scene in own}
        results[name] = [result(s, m) for s in own for m in experiment.methods]
    return Outcome(results, known)


def changed(outcome: Outcome, experiment: str, place: int, **changes: object) -> str:
    """Change the place-th result of `best`; returns the name of its scene."""
    of = outcome.results[experiment]
    at = [i for i, r in enumerate(of) if r.method == "best"][place]
    of[at] = replace(of[at], **changes)  # type: ignore[arg-type]  # the test names real fields
    return of[at].scene


def test_equal_results_give_equal_files_that_hold_every_figure(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    outcome = good()
    scene = changed(outcome, "two", 3, snr_db=12.34567)

    for folder in ("a", "b"):
        write_report(outcome, tmp_path / folder)

    digests = [
        {
            path.relative_to(tmp_path / folder).as_posix(): hashlib.sha256(
                path.read_bytes()
            ).hexdigest()
            for path in (tmp_path / folder).rglob("*")
            if path.is_file()
        }
        for folder in ("a", "b")
    ]
    assert digests[0] == digests[1]
    assert sum(name.endswith(".png") for name in digests[0]) == 6
    assert all(path.stat().st_size < 90_000 for path in tmp_path.rglob("*.png"))
    values = json.loads((tmp_path / "a" / "evaluation.json").read_text())
    assert list(values["experiments"]) == list(EXPERIMENTS)
    figures = values["experiments"]["two"]["results"][scene]
    layers = {method: FIGURES[method] for method in EXPERIMENTS["two"].methods}
    assert figures["snr_db"] == layers | {"best": 12.35}
    assert figures["coefficient_error_deg"] == {"paper": 1.5, "best": 1.5}
    balanced = values["experiments"]["white-two"]["results"][scene]
    assert balanced["colour_error_deg"] == dict.fromkeys(BALANCES, 0.2)
    assert balanced["snr_db"] == dict.fromkeys(BALANCES, 35.0)
    assert values["scenes"][scene]["lamps"] == list(outcome.scenes[scene].lamp_names)
    four = values["experiments"]["four-auto"]["results"]["four-report-00"]
    assert {"found": {"best": 3}, "confidence": {"best": 0.95}}.items() <= four.items()
    assert four["four_or_more"] == {"best": True}
    two = values["experiments"]["two-auto"]["results"]
    assert not any("four_or_more" in one for one in two.values())
    assert "snr_db" not in four
    text = (tmp_path / "a" / "evaluation.md").read_text()
    assert text.startswith("# Evaluation\n")
    assert f"| two | {scene} | 4.7 dB below the published method, 12.3 dB |" in text
    assert "| best_1 | 0.20° / 35.0 dB |" in text
    assert "| white balance, two lamps: colour, ° | 0.20 | ≤ 0.35 | yes |" in text
    assert "for three bases, not below -10 dB](images/evaluation_bases.png)" in text
    for name in [line.split("](")[1][:-1] for line in text.splitlines() if line[:2] == "!["]:
        assert (tmp_path / "a" / name).is_file()


def test_rooms_by_other_cameras_are_a_row_each() -> None:
    outcome = good()
    canon = [r for r in outcome.results["cameras-two"] if "Canon" in r.scene and r.method == "best"]
    for place, value in enumerate((20.0, 21.0, 16.0, 22.0, 23.0, 24.0)):
        at = outcome.results["cameras-two"].index(canon[place])
        outcome.results["cameras-two"][at] = replace(canon[place], snr_db=value)
    dark = changed(outcome, "cameras-two-jpeg", 0, snr_db=0.0, refusal="Too dark.")

    rows = tables.cameras(outcome, "two", failures(outcome))

    assert rows[0] == [
        "camera",
        "scenes",
        *("equal", "paper", "best", "known", "best_3x3"),
        *("best, untold", "best, jpeg", "best_3x3, jpeg"),
        "failures",
    ]
    assert dark == "two-report-00"
    few = ["10.0 / 10.0", "17.0 / 17.0"]
    rest = ["10.0 / 10.0", "27.0 / 27.0", "26.5 / 26.5", "26.5 / 26.5", "27.0 / 27.0"]
    jpeg = [*rest[:3], "26.5 / 0.0", rest[4]]
    assert rows[1] == ["Nikon D5100", "6", *few, "26.5 / 26.5", *jpeg, "1"]
    assert rows[2] == ["Canon EOS 600D", "6", *few, "21.5 / 16.0", *rest, "1"]
    assert [row[0] for row in rows[3:-1]] == ["Fujifilm GFX 100", "Panasonic DC-GX9", "Sony ILCE-9"]
    assert rows[-1] == ["the others", "24", *few, "26.5 / 16.0", *rest, "1"]


def test_cameras_that_are_not_at_hand_keep_what_the_report_has_of_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tests.evaluation.report.draw_plots", lambda *_: None)  # which takes long
    whole, poor = good(), good()
    refused = changed(whole, "cameras-three", 8, snr_db=0.0, found=0, refusal="Too dark.")
    assert outcome_without_others(poor) == 48
    write_report(poor, tmp_path)
    assert "| Nikon D5100 | 6 |" not in (tmp_path / "evaluation.md").read_text()
    write_report(whole, tmp_path)
    written = (tmp_path / "evaluation.json").read_bytes()

    write_report(poor, tmp_path)

    assert (tmp_path / "evaluation.json").read_bytes() == written
    text = (tmp_path / "evaluation.md").read_text()
    assert text.count("| Sony ILCE-9 | 6 |") == 2
    assert f"| cameras-three | {refused} | refused: Too dark. |" in text


def outcome_without_others(outcome: Outcome) -> int:
    """Take what the D5100 did not photograph out of an outcome; returns how many scenes that is."""
    gone = {name for name, scene in outcome.scenes.items() if scene.camera != CAMERA}
    for name, results in outcome.results.items():
        outcome.results[name] = [r for r in results if r.scene not in gone]
    for name in gone:
        del outcome.scenes[name]
    return len(gone)


def test_goals_are_met_by_good_results_and_missed_by_bad_ones() -> None:
    outcome = good()
    met = {goal.text: goal.met for goal in goals(outcome)}
    for place in range(22):
        changed(outcome, "two", place, snr_db=FIGURES["paper"] + 1)
    missed = {goal.text: goal for goal in goals(outcome)}

    assert met["two lamps: median, dB"]
    assert met["two lamps: over the published method, dB"]
    assert met["two lamps: below the best 3×3 per lamp, dB"]
    assert not met["two broad-band lamps: median, dB"]
    over = missed["two lamps: over the published method, dB"]
    assert (over.figure, over.met) == (1.0, False)
    below = missed["two lamps: below the best 3×3 per lamp, dB"]
    assert below.figure == 9.0
    assert not below.met


def test_a_scene_below_the_published_method_is_a_failure() -> None:
    outcome = good()
    just = changed(outcome, "three", 1, snr_db=FIGURES["paper"] - 0.4)
    worse = changed(outcome, "three", 2, snr_db=FIGURES["paper"] - 0.6)

    found = failures(outcome)

    assert Failure("three", worse, "0.6 dB below the published method, 16.4 dB") in found
    assert just not in [one.scene for one in found]


def test_a_refusal_and_a_wrong_number_are_failures() -> None:
    outcome = good()
    refused = changed(outcome, "two-noise", 0, snr_db=0.0, refusal="Too dark.")
    wrong = changed(outcome, "two-auto", 5, found=1, snr_db=None)
    blind = changed(outcome, "four-auto", 2, warnings=())
    seeing_more = changed(outcome, "three-auto", 1, warnings=(_FOUR,))
    dark = changed(outcome, "two-auto", 6, found=0, snr_db=0.0, refusal="Too dark.")

    found = failures(outcome)

    assert Failure("two-noise", refused, "refused: Too dark.") in found
    assert Failure("two-auto", wrong, "1 lamps found of 2, confidence 0.95") in found
    assert Failure("four-auto", blind, "3 lamps found of 4, confidence 0.95") in found
    more = "four or more lamps found of 3, confidence 0.95"
    assert Failure("three-auto", seeing_more, more) in found
    assert [one.text for one in found if (one.experiment, one.scene) == ("two-auto", dark)] == [
        "refused: Too dark."
    ]


@pytest.mark.parametrize(
    ("experiment", "least"), [("smooth-two", 14.0), ("bounces", 17.5), ("roughness", 22.0)]
)
def test_some_kinds_of_scenes_have_a_least_figure(experiment: str, least: float) -> None:
    outcome = good()
    for place in range(len(scenes_of(experiment))):
        changed(outcome, experiment, place, snr_db=least - 0.1)

    listed = {one.scene for one in failures(outcome) if f"where {least:g} are asked" in one.text}

    assert listed
    assert all(
        outcome.scenes[name].geometry.depth is None for name in listed if experiment == "bounces"
    )
    assert all(
        outcome.scenes[name].geometry.roughness == 0.1
        for name in listed
        if experiment == "roughness"
    )


def test_one_degree_is_a_failure_unless_it_is_said() -> None:
    silent, honest = good(), good()
    warning = RunWarning(Code.LAMPS_ALIKE, "Two lamps are alike.").entry()
    scene = changed(silent, "angle", 0, snr_db=3.0)
    changed(honest, "angle", 0, snr_db=3.0, warnings=(warning,))

    asked = Failure("angle", scene, "3.0 dB, where 9 are asked")
    assert asked in failures(silent)
    assert asked not in failures(honest)
    assert too_alike(honest.results["angle"][3])


def test_the_number_of_lamps_is_counted_by_answer() -> None:
    outcome = good()
    changed(outcome, "two-auto", 0, found=3, snr_db=None)
    changed(outcome, "two-auto", 1, warnings=(_FOUR,))
    changed(outcome, "one-auto", 0, found=0, refusal="Too dark.")

    table = confusion(outcome.counted("-auto"))

    assert table[2] == {"2": 32, "3": 1, "4 or more": 1}
    assert table[1] == {"1": 11, "refused": 1}
    assert table[4] == {"4 or more": 12}
    rows = tables.confusions(outcome.counted("-auto"))
    assert rows[0] == ["lamps", "1", "2", "3", "4 or more", "refused"]
    assert rows[2] == ["2", "0", "32", "1", "1", "0"]
    assert not any(right(r) for r in outcome.results["two-auto"][:2])


def test_confidence_is_held_against_what_is_right() -> None:
    base = result(scenes_of("two")[0], "best")
    sure = [replace(base, confidence=0.97, found=found) for found in (2, 2, 2, 1)]
    certain = [replace(base, confidence=1.0)]
    doubtful = [replace(base, confidence=0.5, found=1), replace(base, confidence=None)]

    rows = tables.calibration([*sure, *certain, *doubtful])

    assert rows[-1] == ["0.9 … 1", "5", "4", "80 %"]
    assert rows[2] == ["0.5 … 0.7", "1", "0", "0 %"]
    assert rows[1] == ["0 … 0.5", "0", "0", ""]


def test_costs_are_rounded_so_that_a_rerun_gives_the_same() -> None:
    scene = scenes_of("two")[0]
    seconds = {"equal": 0.1, "paper": 0.13, "best": 2.3, "known": 0.62}
    of = [result(scene, method, cpu_s=cpu) for method, cpu in seconds.items()]

    rows = tables.costs(Outcome({"two": of}, {scene.name: scene}), ("two",))

    assert rows == [
        ["method", "two"],
        ["equal", "1"],
        ["paper", "1"],
        ["best", "20"],
        ["known", "5"],
    ]


def test_the_summary_has_median_and_worst() -> None:
    own = scenes_of("two")[:3]
    values = (10.0, 21.26, 30.0)
    of = [result(s, "best", snr_db=v) for s, v in zip(own, values, strict=True)]
    of.append(result(scenes_of("four")[0], "best"))

    text = tables.aligned(tables.summary(Outcome({"two": of}, {s.name: s for s in own})))

    assert text.splitlines()[1].split() == ["two", "best", "3", "21.3", "10.0", "1.5"]


def test_markdown_is_a_table() -> None:
    assert tables.markdown([["a", "b"], ["1", "2"]]) == "| a | b |\n|---|---|\n| 1 | 2 |"


def test_a_part_of_the_evaluation_prints_a_table_and_writes_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []

    def run(groups: object, methods: object, split: object, tell: object) -> Outcome:
        asked.append((groups, methods, split))
        assert callable(tell)
        own = scenes_of("two")[:2]
        tell("two", [result(own[0], "paper"), result(own[0], "best", snr_db=None, found=1)])
        of = [result(s, m, snr_db=26.5) for s in own for m in ("paper", "best")]
        of[3] = replace(of[3], snr_db=20.5)
        return Outcome({"two": of}, {s.name: s for s in own})

    monkeypatch.setattr(program, "run", run)
    monkeypatch.setattr(program, "write_report", lambda *_: pytest.fail("wrote the report"))
    arguments = ["--set", "development", "--groups", "two", "--methods", "paper,best"]
    monkeypatch.setattr("sys.argv", ["evaluation", *arguments])

    program.main()

    assert asked == [(("two",), ("paper", "best"), "development")]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "two  two-report-00  paper 17.0  best 1 of 2"
    assert "two    two-report-01  6.0 dB below the published method, 20.5 dB" in lines
    assert lines[-1].split() == ["two", "best", "2", "23.5", "20.5", "1.5"]


def test_everything_on_report_scenes_writes_the_report(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(program, "run", lambda *_: good())
    monkeypatch.setattr(program, "_DOCS", tmp_path)
    monkeypatch.setattr("sys.argv", ["evaluation"])

    program.main()

    assert {path.name for path in tmp_path.iterdir()} == {
        "evaluation.json",
        "evaluation.md",
        "images",
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--groups", "two,tow"], "tow: there are two, three"),
        (["--methods", "bets"], "bets: there are equal, nnmf"),
        (["--set", "acceptance"], "invalid choice"),
    ],
)
def test_a_mistyped_name_is_answered_with_those_there_are(
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("sys.argv", ["evaluation", *arguments])

    with pytest.raises(SystemExit):
        program.main()

    assert message in capsys.readouterr().err
