"""Runs experiments, two scenes at a time."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

from tests.evaluation.experiments import EXPERIMENTS
from tests.evaluation.results import Result, run_scene
from tests.evaluation.scenes import scenes
from tests.evaluation.spectra import Split

_WORKERS = 2


def run(
    names: tuple[str, ...],
    methods: tuple[str, ...],
    split: Split,
    tell: Callable[[str, list[Result]], None],
) -> dict[str, list[Result]]:
    """Run experiments by name, with those of their methods that are among the given ones.

    tell: called with the experiment's name and the results of each scene as they come.
    Returns for each experiment its results, in the order of scenes and methods, however they came.
    """
    # before a worker loads numpy: its threads would wait for each other
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    done: dict[str, dict[int, list[Result]]] = {name: {} for name in names}
    with ProcessPoolExecutor(_WORKERS, mp_context=get_context("spawn")) as pool:
        waiting = {}
        for name in names:
            experiment = EXPERIMENTS[name]
            chosen = tuple(method for method in experiment.methods if method in methods)
            for number, scene in enumerate(scenes(experiment.group, split)):
                future = pool.submit(run_scene, scene, experiment.condition, chosen)
                waiting[future] = name, number
        try:
            for future in as_completed(waiting):
                name, number = waiting[future]
                done[name][number] = future.result()
                tell(name, done[name][number])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return {
        name: [result for _, results in sorted(of.items()) for result in results]
        for name, of in done.items()
    }
