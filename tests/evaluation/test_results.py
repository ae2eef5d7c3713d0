from __future__ import annotations

import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pipeline
from pipeline.errors import UnusablePairError
from tests.evaluation import results, spectra
from tests.evaluation.cache import folder
from tests.evaluation.conditions import Condition, make_shot
from tests.evaluation.methods import METHODS, Answer
from tests.evaluation.results import run_scene
from tests.evaluation.scenes import Scene, scenes
from tests.evaluation.shots import Shot
from tests.evaluation.spectra import sensitivities

SMALL = Condition(size=(64, 48))


@pytest.fixture(autouse=True)
def own_results(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Keep the results of each test apart; what is rendered stays shared."""
    monkeypatch.setattr(results, "folder", lambda: tmp_path)


def scene() -> Scene:
    return scenes("two", "development")[0]


def test_a_result_says_what_a_method_did() -> None:
    (equal,) = run_scene(scene(), SMALL, ("equal",))

    assert (equal.scene, equal.method) == (scene().name, "equal")
    assert equal.lamps == equal.found == 2
    assert equal.snr_db is not None
    assert 0 < equal.snr_db < 12
    assert equal.error_deg is None
    assert equal.confidence is None


def test_a_result_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first = run_scene(scene(), SMALL, ("equal", "known"))
    monkeypatch.setattr(results, "make_shot", lambda *_: pytest.fail("photographed again"))

    assert run_scene(scene(), SMALL, ("known", "equal")) == first[::-1]


def test_another_condition_and_another_scene_are_other_results() -> None:
    one = run_scene(scene(), SMALL, ("equal",))
    dark = run_scene(scene(), replace(SMALL, files="noisy"), ("equal",))
    other = run_scene(replace(scene(), strengths=(1.0, 0.2)), SMALL, ("equal",))

    assert len({r[0].snr_db for r in (one, dark, other)}) == 3


def test_a_change_of_the_pipeline_asks_for_new_results_of_the_product_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def keys(product: str) -> dict[str, str]:
        monkeypatch.setattr(results, "_sources", lambda unused: "rest" if unused else product)
        return {method: results._key(scene(), SMALL, method) for method in METHODS}

    before, after = keys("as it was"), keys("changed")

    changed = {method for method in METHODS if before[method] != after[method]}
    assert changed == {"paper", "paper_pca", "paper_joint", "paper_shared", "best"}


def test_sources_are_those_of_the_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "decode").mkdir()
    for name in ("__init__.py", "count.py", "decode/tiff.py", "decode/table.csv"):
        (tmp_path / name).write_text("1")
    monkeypatch.setattr(pipeline, "__file__", str(tmp_path / "__init__.py"))

    def digest(*unused: str) -> str:
        results._sources.cache_clear()
        return results._sources(unused)

    first, whole = digest("count.py"), digest()
    (tmp_path / "count.py").write_text("2")
    assert digest("count.py") == first != whole != digest()
    (tmp_path / "decode" / "table.csv").write_text("2")
    assert digest("count.py") != first
    results._sources.cache_clear()


def test_sources_are_all_that_decides_a_result() -> None:
    stands_for = {"geometry", "grain", "meshes", "patterns", "render"}  # render.VERSION
    wanted, open_ones = set[Path](), [Path(results.__file__)]
    while open_ones:
        file = open_ones.pop()
        wanted.add(file)
        if file.parent.name != "definitions":  # which asks the pipeline for the rest
            found = {found for found in imported(file) if found.stem not in stands_for}
            open_ones += found - wanted

    assert {"capture", "scenes", "spectra", "pixels", "nnmf"} < {file.stem for file in wanted}
    assert wanted <= set(results._files(results._ESTIMATOR))


def imported(file: Path) -> set[Path]:
    """The modules of tests that a module names."""
    names = set[str]()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tests"):
            names |= {f"{node.module}", *(f"{node.module}.{one.name}" for one in node.names)}
    tests = Path(__file__).parents[2]
    paths = {tests / f"{name.replace('.', '/')}.py" for name in names}
    return {path for path in paths if path.is_file()}


@pytest.mark.parametrize("content", ["", "{", "[]", '{"scene": "x"}'])
def test_a_broken_file_is_computed_anew(tmp_path: Path, content: str) -> None:
    first = run_scene(scene(), SMALL, ("equal",))
    (path,) = (tmp_path / "results").iterdir()
    path.write_text(content)

    again = run_scene(scene(), SMALL, ("equal",))

    assert again[0].snr_db == first[0].snr_db
    assert json.loads(path.read_text())["method"] == "equal"


def test_two_runs_may_write_the_same_result_at_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (one,) = run_scene(scene(), SMALL, ("equal",))
    path, replaced = tmp_path / "results" / "same.json", Path.replace

    def overtaken(whole: Path, to: Path) -> Path:
        monkeypatch.setattr(Path, "replace", replaced)
        results._write(path, one)  # by the other run
        return replaced(whole, to)

    monkeypatch.setattr(Path, "replace", overtaken)
    results._write(path, one)

    assert results._read(path) == one
    assert [file.suffix for file in path.parent.iterdir()] == [".json"] * 2


def test_a_refusal_is_no_light_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Shot) -> Answer:
        raise UnusablePairError("The lamps are too alike.")

    monkeypatch.setitem(METHODS, "equal", refuse)

    (refused,) = run_scene(scene(), SMALL, ("equal",))

    assert (refused.snr_db, refused.found) == (0.0, 0)
    assert refused.refusal == "The lamps are too alike."


def test_exact_layers_have_a_finite_score(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(METHODS, "equal", lambda shot: Answer(shot.truth))

    assert run_scene(scene(), SMALL, ("equal",))[0].snr_db == 100.0


def test_layers_of_another_number_have_no_score(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(METHODS, "equal", lambda shot: Answer(shot.truth[:1], None, 0.7))

    (one,) = run_scene(scene(), SMALL, ("equal",))

    assert one.snr_db is None
    assert (one.found, one.lamps, one.confidence) == (1, 2, 0.7)


@pytest.mark.parametrize("of_white", [False, True])
def test_the_right_coefficients_have_no_error(
    of_white: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def right(shot: Shot) -> Answer:
        assert shot.coefficients is not None
        by_basis = shot.coefficients @ np.linalg.inv(shot.axes).T
        cards = shot.lamp_spectra @ shot.sensitivities.T if of_white else by_basis
        return Answer(shot.truth[::-1] * 0.9, 3 * cards[::-1], of_white=of_white)

    monkeypatch.setitem(METHODS, "equal", right)

    (one,) = run_scene(scene(), SMALL, ("equal",))

    assert one.snr_db == pytest.approx(20.0, abs=1e-3)
    assert one.error_deg == pytest.approx(0.0, abs=1e-6)


def test_what_is_told_and_what_is_not() -> None:
    told = make_shot(scene(), SMALL)
    jpeg = make_shot(scene(), replace(SMALL, files="jpeg", lights="auto"))
    contrast = make_shot(scene(), replace(SMALL, files="jpeg", lights="auto", contrast="strong"))
    wrong = make_shot(scene(), replace(SMALL, camera="Sigma SD1 Merrill", flash="led"))

    assert told.options == {
        "encoding": "linear",
        "camera": "Nikon D5100",
        "flash_spectrum": "xenon",
        "exposure_ratio": 1.0,
    }
    assert told.lights == 2
    assert "camera" not in jpeg.options
    assert jpeg.lights == "auto"
    assert jpeg.coefficients is None
    assert contrast.options == jpeg.options
    assert contrast.files != jpeg.files
    assert contrast.photograph.sum() == pytest.approx(contrast.truth.sum(), rel=0.1)
    assert (wrong.options["camera"], wrong.options["flash_spectrum"]) == (
        "Sigma SD1 Merrill",
        "led",
    )
    assert (wrong.truth == told.truth).all()


def test_a_camera_that_the_product_does_not_know_is_told_by_its_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    curves = sensitivities("Sigma SD1 Merrill")[::-1]
    monkeypatch.setitem(spectra._HANDED_OVER, "Sigma, turned round", curves)
    one = replace(scene(), camera="Sigma, turned round")

    told, untold = (make_shot(one, replace(SMALL, camera_told=t)) for t in (True, False))

    np.testing.assert_array_equal(told.options["camera"].r, curves[0])
    np.testing.assert_array_equal(told.options["camera"].b, curves[2])
    assert "camera" not in untold.options
    sigma = make_shot(replace(scene(), camera="Sigma SD1 Merrill"), SMALL)
    np.testing.assert_allclose(told.truth, sigma.truth[..., ::-1], rtol=1e-5)


def test_four_lamps_cannot_be_asked_for() -> None:
    with pytest.raises(ValueError, match="4 lamps"):
        make_shot(scenes("four", "development")[0], SMALL)


def test_renderings_are_kept_apart_from_results(tmp_path: Path) -> None:
    run_scene(scene(), SMALL, ("equal",))

    assert [path.name for path in tmp_path.iterdir()] == ["results"]
    assert folder().is_dir()
