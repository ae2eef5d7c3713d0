"""Runs experiments, two scenes at a time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

from tests.evaluation.environment import settle
from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.figures import Outcome
from tests.evaluation.results import Result, run_scene
from tests.evaluation.scenes import Scene, scenes
from tests.evaluation.spectra import Split, at_hand, hand_over, sensitivities

_WORKERS = 2


def run(
    names: tuple[str, ...],
    methods: tuple[str, ...],
    split: Split,
    tell: Callable[[str, list[Result]], None],
) -> Outcome:
    """Run experiments by name, with those of their methods that are among the given ones.

    tell: called with the experiment's name and the results of each scene as they come.
    The results of each experiment are in the order of scenes and methods, however they came.
    Experiments with none of the methods are left out, and so are scenes whose camera is neither
    packaged nor in the folder of LIGHTLAYERS_SPECTRA.
    """
    chosen = {
        name: tuple(method for method in EXPERIMENTS[name].methods if method in methods)
        for name in names
    }
    done: dict[str, dict[int, list[Result]]] = {name: {} for name in names if chosen[name]}
    asked = {name: scenes(EXPERIMENTS[name].group, split) for name in done}
    cameras = {scene.camera for some in asked.values() for scene in some}
    curves = {camera: sensitivities(camera) for camera in cameras if at_hand(camera)}
    settle()  # from here on the folder of spectra is hidden
    known: dict[str, Scene] = {}
    with ProcessPoolExecutor(
        _WORKERS, get_context("spawn"), initializer=hand_over, initargs=(curves,)
    ) as pool:
        waiting = {}
        for name in done:
            experiment = EXPERIMENTS[name]
            own = [scene for scene in asked[name] if scene.camera in curves]
            for number, scene in enumerate(own):
                known[scene.name] = scene
                future = pool.submit(run_scene, scene, experiment.condition, chosen[name])
                waiting[future] = name, number
        try:
            for future in as_completed(waiting):
                name, number = waiting[future]
                done[name][number] = future.result()
                tell(name, done[name][number])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    results = {
        name: [result for _, results in sorted(of.items()) for result in results]
        for name, of in done.items()
    }
    return Outcome(results, known)
