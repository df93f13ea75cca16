"""A design study in pictures: which designs are valid, and how good the best of them are.

The paper's figures 5 (the invalid set after the first step) and 6 (the second step) in form.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.cell.design import MEASURES
from qparm.design.space import unit_of
from qparm.view.style import GAP, REACHED, SELF_MOTION, new_figure, plain, save

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.design.study import DesignStudy

__all__ = ["STUDY_PICTURES", "draw_study"]

STUDY_PICTURES = ("designs.png", "front.png", "map.png", "first_step.png", "second_step.png")

_VALID, _INVALID, _FRONT = REACHED, "#b8bec4", SELF_MOTION
_FOLLOWED = "beyond the budget: border followed"
_END = "end of the border followed"
# More variables than this are not drawn against one another.
_MOST_VARIABLES = 6


def draw_study(study: DesignStudy, folder: Path) -> None:
    """Draw ``designs.png``, and ``front.png`` where there are two objectives; of the paper's method its two steps."""
    _draw_designs(study, folder / "designs.png")
    if len(study.objectives) > 1 and study.front:
        _draw_front(study, folder / "front.png")
    if study.method == "grid" and len(study.space.keys) == 2:
        _draw_map(study, folder / "map.png")
    if study.second_step is not None and len(study.space.keys) == 2:
        _draw_first_step(study, folder / "first_step.png")
        _draw_second_step(study, folder / "second_step.png")


def _scaled(study: DesignStudy) -> tuple[NDArray[np.float64], list[str], NDArray[np.float64]]:
    """Return designs in the units people read, (N, d), labels, and the factors."""
    units = [unit_of(dimension) for dimension in study.space.dimensions]
    factors = np.array([factor for factor, _ in units])
    labels = [f"{plain(name)} ({unit})" for name, (_, unit) in zip(study.space.names, units, strict=True)]
    return np.array([one.x for one in study.evaluations]) * factors, labels, factors


def _valid(study: DesignStudy) -> NDArray[np.bool_]:
    return np.array([study.valid(one) is True for one in study.evaluations])


def _draw_designs(study: DesignStudy, file: Path) -> None:
    """Draw all designs, every variable against every other, the front and the cell's own design marked."""
    X, labels, _ = _scaled(study)
    d = min(X.shape[1], _MOST_VARIABLES)
    if d == 1:
        figure = new_figure(7, 5)
        axis: Any = figure.add_subplot()
        heights = 1e3 * np.array([one.measures.get("length", np.nan) for one in study.evaluations])
        _scatter(axis, study, X[:, 0], heights, 1e3 * study.own.measures.get("length", np.nan), 0)
        axis.set_xlabel(labels[0])
        axis.set_ylabel("total length (mm)")
        _legend_below(figure, axis)
    else:
        figure = new_figure(3.2 * (d - 1) + 3.0, 2.8 * (d - 1) + 2.8)
        axes = figure.subplots(d - 1, d - 1, squeeze=False)
        for i in range(1, d):
            for j in range(d - 1):
                axis = axes[i - 1, j]
                if j >= i:
                    axis.set_visible(False)
                    continue
                _scatter(axis, study, X[:, j], X[:, i], None, j, i)
                axis.set_xlabel(labels[j])
                axis.set_ylabel(labels[i])
        _legend_below(figure, axes[0, 0])
    valid = _valid(study)
    searched = study.stages[0][1]
    title = f"{plain(study.space.cell.name)}: {valid[:searched].sum()} of {searched} designs valid"
    figure.suptitle(title, fontsize=10)
    save(figure, file)


def _legend_below(figure: Any, axis: Any) -> None:
    """Explain the marks beneath the pictures, where that hides no design."""
    figure.legend(*axis.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7, frameon=False)


def _unbeaten(study: DesignStudy) -> str:
    return "no design of the swarm's own beats these" if study.method == "seed" else "no design beats these"


def _own_search(study: DesignStudy) -> str:
    return " of the swarm's own search" if study.method == "seed" else ""


def _apart(study: DesignStudy) -> list[int]:
    """Return the best designs that the search itself did not find."""
    return [place for place in study.best if place not in study.front]


def _scatter(
    axis: Any,
    study: DesignStudy,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    own_y: float | None,
    j: int,
    i: int = 0,
) -> None:
    valid, front = _valid(study), np.array(study.front, dtype=int)
    _, _, factors = _scaled(study)
    own = np.array(study.own.x) * factors
    searched = np.arange(len(x)) < study.stages[0][1]
    if not searched.all():
        # beyond the budget, crowded along a line: not what the search looked at
        axis.plot(x[~searched], y[~searched], ".", color=_INVALID, markersize=2, alpha=0.4, label=_FOLLOWED)
    axis.plot(x[searched & ~valid], y[searched & ~valid], "x", color=_INVALID, markersize=4, label="not valid")
    axis.plot(x[searched & valid], y[searched & valid], "o", color=_VALID, markersize=3.5, label="valid")
    axis.plot(x[front], y[front], "o", color=_FRONT, markersize=5, label=_unbeaten(study))
    apart = _apart(study)
    if apart:
        axis.plot(x[apart], y[apart], "^", color=_FRONT, markersize=7, fillstyle="none", label=_END)
    if study.chosen is not None:
        axis.plot(
            x[study.chosen], y[study.chosen], "D", color="black", markersize=7, fillstyle="none", label="recommended"
        )
    axis.plot(own[j], own[i] if own_y is None else own_y, "*", color=GAP, markersize=12, label="the cell's own")
    _frame(axis, study, j, i if own_y is None else None, factors)


def _frame(axis: Any, study: DesignStudy, j: int, i: int | None, factors: NDArray[np.float64]) -> None:
    """Draw the ends of the ranges."""
    for k, line in ((j, axis.axvline), (i, axis.axhline)):
        if k is not None:
            variable = study.problem.variables[k]
            for end in (variable.lower, variable.upper):
                line(end * factors[k], color="#888888", linewidth=0.7, linestyle=":")


def _draw_front(study: DesignStudy, file: Path) -> None:
    figure = new_figure(7.5, 5.5)
    _front_axis(figure.add_subplot(), study)
    what = f"{len(study.front)} designs that no other beats{_own_search(study)}"
    figure.suptitle(f"{plain(study.space.cell.name)}: {what}", fontsize=10)
    save(figure, file)


def _front_axis(axis: Any, study: DesignStudy) -> None:
    """Draw the first two objectives of all valid designs, the front joined, own and recommended design marked."""
    names = study.objectives[:2]
    scales = [unit_of(MEASURES[name].dimension) for name in names]

    def at(places: Any) -> NDArray[np.float64]:
        known = [one for one in places if one.valid and all(name in one.measures for name in names)]
        values = [[one.measures[name] * scale for name, (scale, _) in zip(names, scales, strict=True)] for one in known]
        return np.array(values).reshape(-1, 2)

    valid = [one for one, good in zip(study.evaluations, _valid(study), strict=True) if good]
    axis.plot(*at(valid).T, "o", color=_VALID, markersize=3.5, label="valid")
    front = at([study.evaluations[k] for k in study.front])
    axis.plot(*front.T, "-o", color=_FRONT, markersize=5, linewidth=1, label=_unbeaten(study))
    apart = at([study.evaluations[k] for k in _apart(study)])
    if len(apart):
        axis.plot(*apart.T, "^", color=_FRONT, markersize=7, fillstyle="none", label=_END)
    if study.chosen is not None:
        chosen = at([study.evaluations[study.chosen]])
        axis.plot(*chosen.T, "D", color="black", markersize=8, fillstyle="none", label="recommended")
    own = f"the cell's own: {plain(study.space.shown(study.own.x))}"
    axis.plot(*at([study.own]).T, "*", color=GAP, markersize=12, label=own)
    for name, (_, unit), label in zip(names, scales, (axis.set_xlabel, axis.set_ylabel), strict=True):
        better = "" if MEASURES[name].sense > 0 else ", more is better"
        label(f"{MEASURES[name].words}{f' ({unit})' if unit else ''}{better}")
    axis.legend(fontsize=8)


def _draw_map(study: DesignStudy, file: Path) -> None:
    """Draw the whole map of two variables: the share of the surface that is missed, and lines of equal length."""
    searched = study.evaluations[: study.stages[0][1]]
    _, labels, factors = _scaled(study)
    X = np.array([one.x for one in searched]) * factors
    first, second = np.unique(X[:, 0]), np.unique(X[:, 1])
    if len(first) * len(second) != len(searched):
        return
    shape = len(first), len(second)
    missed = np.array([study.violation(one) for one in searched]).reshape(shape)
    length = 1e3 * np.array([one.measures.get("length", np.nan) for one in searched]).reshape(shape)
    figure = new_figure(8, 6)
    axis: Any = figure.add_subplot()
    shown = np.ma.masked_where(missed == 0, 100 * missed)
    mesh = axis.pcolormesh(first, second, shown.T, cmap=_missed_colours(), shading="nearest", vmin=0)
    axis.pcolormesh(
        first,
        second,
        np.ma.masked_where(missed > 0, np.ones(shape)).T,
        cmap="Blues",
        shading="nearest",
        vmin=0,
        vmax=2.5,
    )
    figure.colorbar(mesh, ax=axis, label="how far from covering the surface (% missed)")
    lines = axis.contour(first, second, length.T, levels=10, colors="#555555", linewidths=0.6)
    axis.clabel(lines, fmt="%.0f mm", fontsize=7)
    own = np.array(study.own.x) * factors
    axis.plot(*own, "*", color=GAP, markersize=13, label=f"the cell's own: {plain(study.space.shown(study.own.x))}")
    if study.least is not None:
        least = study.evaluations[study.least]
        axis.plot(
            *(np.array(least.x) * factors), "D", color="black", fillstyle="none",
            label=f"shortest: {plain(study.space.shown(least.x))}",
        )  # fmt: skip
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    # beside the map, where it hides no cell
    axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
    axis.set_title("blue: every point within reach; lines: total length", fontsize=9)
    figure.suptitle(plain(study.space.cell.name), fontsize=10)
    save(figure, file)


def _missed_colours() -> Any:
    """Return colours for what is missed, of which the lightest still tells a cell from white."""
    import matplotlib
    from matplotlib.colors import ListedColormap

    return ListedColormap(matplotlib.colormaps["Oranges"](np.linspace(0.35, 1.0, 256)))


def _draw_first_step(study: DesignStudy, file: Path) -> None:
    """Draw the invalid set after the first step and the range that it leads to: the paper's figure 5 in form."""
    step = study.second_step
    assert step is not None
    X, labels, factors = _scaled(study)
    valid = _valid(study)
    first = np.arange(len(X)) < step.first
    figure = new_figure(7, 5.5)
    axis: Any = figure.add_subplot()
    axis.plot(*X[first & ~valid].T, "x", color=GAP, markersize=5, label="not valid: the obstacles of both steps")
    axis.plot(*X[first & valid].T, "o", color=_VALID, markersize=3.5, label="valid")
    _box(axis, study, factors)
    _finish_step(axis, study, labels, factors)
    axis.set_title(f"first step: {step.first} designs", fontsize=9)
    save(figure, file)


def _draw_second_step(study: DesignStudy, file: Path) -> None:
    """Draw the second step's designs and the front, in variables and in objectives: the paper's figure 6 in form."""
    step = study.second_step
    assert step is not None
    X, labels, factors = _scaled(study)
    valid = _valid(study)
    searched = study.stages[0][1]
    second = (np.arange(len(X)) >= step.first) & (np.arange(len(X)) < searched)
    front = np.array(study.front, dtype=int)
    figure = new_figure(12, 5.2)
    axis: Any = figure.add_subplot(1, 2, 1)
    axis.plot(*X[second & ~valid].T, "x", color=_INVALID, markersize=5, label="not valid")
    axis.plot(*X[second & valid].T, "o", color=_VALID, markersize=3.5, label="valid")
    axis.plot(*X[front].T, "o", color=_FRONT, markersize=6, label=_unbeaten(study))
    apart = _apart(study)
    if apart:
        axis.plot(*X[apart].T, "^", color=_FRONT, markersize=7, fillstyle="none", label=_END)
    _box(axis, study, factors)
    _finish_step(axis, study, labels, factors)
    axis.set_title(f"second step: {int(second.sum())} designs", fontsize=9)
    _front_axis(figure.add_subplot(1, 2, 2), study)
    save(figure, file)


def _box(axis: Any, study: DesignStudy, factors: NDArray[np.float64]) -> None:
    from matplotlib.patches import Rectangle

    step = study.second_step
    assert step is not None
    low, high = np.array(step.lower) * factors, np.array(step.upper) * factors
    axis.add_patch(
        Rectangle(
            tuple(low), *(high - low), fill=False, edgecolor="black", linewidth=1, label="range of the second step"
        )
    )


def _finish_step(axis: Any, study: DesignStudy, labels: list[str], factors: NDArray[np.float64]) -> None:
    own = np.array(study.own.x) * factors
    axis.plot(*own, "*", color=GAP, markersize=12, label=f"the cell's own: {plain(study.space.shown(study.own.x))}")
    _frame(axis, study, 0, 1, factors)
    axis.set_xlabel(labels[0])
    axis.set_ylabel(labels[1])
    axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
