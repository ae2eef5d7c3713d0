"""Plots of the report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from tests.evaluation.figures import Outcome, angle, depth, roughness
from tests.evaluation.scenes import Scene

_STYLES: dict[str, tuple[str, str]] = {
    "paper": ("published method", "tab:orange"),
    "paper_shared": ("published, shared out", "tab:olive"),
    "best": ("best", "tab:blue"),
    "known": ("lamps known", "tab:green"),
    "best_3x3": ("best 3×3 per lamp", "tab:gray"),
    "paper_pca": ("PCA", "tab:red"),
    "paper_joint": ("joint", "tab:purple"),
    "von_kries": ("von Kries", "tab:brown"),
}
LOWEST_DB = -10.0
"""Of the scenes for each basis: what is worse is drawn there."""

_COMPARED = ("paper", "best", "best_3x3")
_EXPOSURES = {"": 1.0, "-half": 1 / 2, "-quarter": 1 / 4, "-eighth": 1 / 8}


def draw_plots(outcome: Outcome, folder: Path) -> None:
    """Write evaluation_*.png into the folder; equal results give equal files."""
    folder.mkdir(parents=True, exist_ok=True)
    _save(_bases(outcome), folder / "evaluation_bases.png")
    _save(_angles(outcome), folder / "evaluation_angle.png")
    _save(_three(outcome), folder / "evaluation_three.png")
    for name, along, label in (
        ("bounces", depth, "longest path, segments (∞: all light)"),
        ("roughness", roughness, "roughness α"),
    ):
        _save(_curves(outcome, name, along, label), folder / f"evaluation_{name}.png")
    _save(_noise(outcome), folder / "evaluation_noise.png")


def _bases(outcome: Outcome) -> Figure:
    order = outcome.snr("two", "paper")
    ranked = sorted(order, key=lambda scene: -order[scene])
    figure, (axes,) = _canvas("scenes with two lamps, by weighted PCA", "joint SNR, dB")
    for method in ("paper_pca", "paper_joint", "paper"):
        values = outcome.snr("two", method)
        label = "weighted PCA" if method == "paper" else _STYLES[method][0]
        axes.plot(
            [max(values[scene], LOWEST_DB) for scene in ranked],
            "o-",
            ms=3,
            color=_STYLES[method][1],
            label=label,
        )
    axes.set_ylim(bottom=LOWEST_DB - 1)
    axes.legend(fontsize=8)
    return figure


def _angles(outcome: Outcome) -> Figure:
    figure, (left, right) = _canvas("angle between the lamps, °", "joint SNR, dB", panels=2)
    for method in _COMPARED:
        label, colour = _STYLES[method]
        kind: dict[str, Any] = {"ms": 3, "color": colour, "label": label}
        snr = outcome.curve(outcome.snr("angle", method), angle)
        left.plot(list(snr), list(snr.values()), "o-", **kind)
        errors = outcome.curve(outcome.errors("angle", method), angle)
        if errors:
            right.plot(list(errors), list(errors.values()), "o-", **kind)
    right.set_ylabel("error of the coefficients, °")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xticks([1, 2, 5, 10, 20, 60], labels=["1", "2", "5", "10", "20", "60"])
        axes.legend(fontsize=6)
    return figure


def _three(outcome: Outcome) -> Figure:
    figure, (axes,) = _canvas("scenes with three lamps, sorted for each method", "joint SNR, dB")
    for method in ("von_kries", "paper", "paper_shared", "best", "best_3x3"):
        label, colour = _STYLES[method]
        values = sorted(outcome.snr("three", method).values(), reverse=True)
        axes.plot(values, "o-", ms=3, color=colour, label=label)
    axes.legend(fontsize=7)
    return figure


def _curves(outcome: Outcome, name: str, along: Callable[[Scene], float], label: str) -> Figure:
    figure, (axes,) = _canvas(label, "joint SNR, dB")
    for method in ("paper", "paper_shared", "best", "best_3x3"):
        curve = outcome.curve(outcome.snr(name, method), along)
        text, colour = _STYLES[method]
        axes.plot(list(curve.values()), "o-", ms=3, color=colour, label=text)
        axes.set_xticks(
            range(len(curve)), labels=["∞" if at == float("inf") else f"{at:g}" for at in curve]
        )
    axes.legend(fontsize=7)
    return figure


def _noise(outcome: Outcome) -> Figure:
    figure, panels = _canvas("exposure", "joint SNR, dB", panels=2)
    for axes, group in zip(panels, ("two", "three"), strict=True):
        for method in _COMPARED:
            label, colour = _STYLES[method]
            taken = [s for s in _EXPOSURES if f"{group}-noise{s}" in outcome.results]
            values = [outcome.median(f"{group}-noise{suffix}", method) for suffix in taken]
            places = [list(_EXPOSURES).index(suffix) for suffix in taken]
            axes.plot(places, values, "o-", ms=3, color=colour, label=label)
            clean = outcome.median(group, method)
            axes.axhline(clean, color=colour, lw=0.8, ls=":")
        axes.set_xticks(range(len(_EXPOSURES)), labels=["1", "1/2", "1/4", "1/8"])
        axes.set_title(f"{group} lamps (dotted: no noise)", fontsize=8)
        axes.legend(fontsize=7)
    return figure


def _canvas(xlabel: str, ylabel: str, panels: int = 1) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(4.0 * panels + 0.8, 3.0), dpi=80, layout="constrained")
    grid = figure.subplots(1, panels, squeeze=False)
    axes = list(grid[0])
    for one in axes:
        one.set_xlabel(xlabel)
        one.grid(alpha=0.3)
    axes[0].set_ylabel(ylabel)
    return figure, axes


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, metadata={"Software": None})  # nothing that differs between installations
