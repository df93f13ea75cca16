"""Closed form, active set, QP solvers in slack and normal form, and cvxpy on families of steps, beside the truth.

    python -m comparisons.equivalence [--cell FILE] [--seed K] [--out FOLDER] [--quick]

The closed-form shortcut is off: each path solves every step, but the closed form only those where the truth has no
bound active. The families are those of comparisons/families.py. The true step is the active set solved in 80-bit
floats, solved again on that active set with 60 digits and accepted only if the KKT conditions hold there; a step
without one is counted as lost. Exit status 1 if an answer that qparm's KKT check accepts is off by more than 1e-8, if
the compiled active set is off by more than 1e-10 and ten times what one unit in the last place of J does to the truth.

Residuals (as in qpbenchmark, on the problem that the path was given; multipliers of the solver where it hands them
out, else those that belong to its primal answer):

    slack form    x = (y, w), P = I, A = [J S, lambda I], b = e - J c;  w = lambda z for the task's multiplier z
    normal form   x = y, P = (J S)'(J S) + lambda^2 I, q = -(J S)'(e - J c), bounds alone
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import qpsolvers
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

import qparm
from comparisons.cvxpy_step import CvxpyStep
from comparisons.families import BOUNDS, DAMPINGS, METHODS, Case, Truth, exact_step, step_cases
from comparisons.tables import save_table
from qparm.errors import KernelError
from qparm.ik import (
    StepProblem,
    active_set,
    chan_dubey_weights,
    check_optimality,
    clamping_weights,
    closed_form,
    make_solver,
    step_problem,
)

__all__ = ["Answer", "compare", "main", "paths", "save_figure"]

ACCEPTED_DIFFERENCE = 1e-8
CLAIMED_DIFFERENCE = 1e-6
ACTIVE_SET_DIFFERENCE = 1e-10
INHERENT = 10.0
CLOSED_FORM, ACTIVE_SET = "closed form", "active set"
QUICK = 110
_THINNED = {"scs, slack": 8}  # it takes half a second to give up: of more than 200 steps it gets every eighth

# Settings of the normal form, as a careful caller of qpsolvers would choose them.
_NORMAL: dict[str, dict[str, float | int | bool]] = {
    "proxqp": {
        "eps_abs": 1e-9,
        "eps_rel": 0.0,
        "check_duality_gap": True,
        "eps_duality_gap_abs": 1e-9,
        "max_iter": 100,
    },
    "osqp": {"eps_abs": 1e-9, "eps_rel": 0.0, "max_iter": 4000},
    "daqp": {"primal_tol": 1e-9},
    "quadprog": {},
}


@dataclass(frozen=True, eq=False)
class Answer:
    """What a path says to one step; ``residuals`` are primal, dual, gap where the path measures its own problem."""

    d: NDArray[np.float64] | None
    claimed: bool
    z: NDArray[np.float64] | None = None
    residuals: tuple[float, float, float] | None = None


Path_ = Callable[[StepProblem], Answer]


def _scaled(step: StepProblem) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return B, r and the bounds of y."""
    movable = step.S > 0
    S = np.where(movable, step.S, 1.0)
    lo = np.where(movable, (step.lb - step.c) / S, -np.inf)
    hi = np.where(movable, (step.ub - step.c) / S, np.inf)
    return step.J * step.S, step.e - step.J @ step.c, lo, hi


def _slack_residuals(step: StepProblem, d: NDArray, z: NDArray) -> tuple[float, float, float]:
    """Return primal residual, dual residual and duality gap of the slack form at x = ((d - c) / S, lambda z)."""
    B, r, lo, hi = _scaled(step)
    y = np.divide(d - step.c, step.S, out=np.zeros(step.n), where=step.S > 0)
    primal = max(float(np.abs(B @ y + step.lam2 * z - r).max()), float(np.max(lo - y)), float(np.max(y - hi)))
    force = B.T @ z - y
    at = np.where(force > 0, (step.ub - d) <= 1e-9, (d - step.lb) <= 1e-9) & (step.S > 0)
    box = np.where(at, force, 0.0)  # elsewhere it has no bound to push against, and stays as dual residual
    support = np.where(at, box * np.where(force > 0, hi, lo), 0.0)
    with np.errstate(invalid="ignore"):
        gap = float(abs(y @ y + step.lam2 * (z @ z) - r @ z + np.nansum(support)))
    return max(primal, 0.0), float(np.abs(force - box).max()), gap


def _normal_form(name: str) -> Path_:
    def solve(step: StepProblem) -> Answer:
        B, r, lo, hi = _scaled(step)
        P = B.T @ B + step.lam2 * np.eye(step.n)
        if name == "osqp":
            from scipy import sparse

            P = sparse.csc_matrix(P)
        problem = qpsolvers.Problem(P, -B.T @ r, lb=np.maximum(lo, -1e20), ub=np.minimum(hi, 1e20))
        try:
            solution = qpsolvers.solve_problem(problem, solver=name, **_NORMAL[name])
        except (qpsolvers.exceptions.QPError, ValueError, ArithmeticError):
            return Answer(None, False)
        if solution.x is None:
            return Answer(None, False)
        residuals = (solution.primal_residual(), solution.dual_residual(), solution.duality_gap())
        return Answer(step.c + step.S * solution.x, bool(solution.found), None, residuals)

    return solve


def paths(n: int) -> dict[str, Path_]:
    """Return every way of solving a step of ``n`` joints that is installed."""

    def by_solver(name: str, *, generic: bool = False) -> Path_:
        solver = qparm.ik.solvers.GenericSolver(name, n) if generic else make_solver(name, n)

        def solve(step: StepProblem) -> Answer:
            answer = solver.solve(step)
            return Answer(answer.d, answer.claimed, answer.z)

        return solve

    def by_cvxpy(name: str) -> Path_:
        problem = CvxpyStep(n, name)

        def solve(step: StepProblem) -> Answer:
            d = problem.solve(step)
            return Answer(d, d is not None)

        return solve

    def by_active_set(step: StepProblem) -> Answer:
        try:
            return Answer(active_set(step), True)
        except KernelError:
            return Answer(None, False)

    installed = list(qpsolvers.available_solvers)
    return {
        CLOSED_FORM: lambda step: Answer(closed_form(step), True),
        ACTIVE_SET: by_active_set,
        "ProxQP, workspace": by_solver("proxqp"),
        "OSQP, workspace": by_solver("osqp"),
        **{f"{name}, slack": by_solver(name, generic=True) for name in installed if name not in ("proxqp", "osqp")},
        **{f"{name}, normal": _normal_form(name) for name in _NORMAL if name in installed},
        **{f"cvxpy, {name}": by_cvxpy(name) for name in ("DAQP", "CLARABEL")},
    }


_COLUMNS = ("asked", "claimed", "accepted", "distance", "primal", "dual", "gap")
Results = dict[str, dict[str, NDArray]]


def _answers(
    path: Path_, cases: Sequence[Case], truths: Sequence[Truth], *, free_only: bool, every: int
) -> dict[str, NDArray]:
    """Return what one path makes of every case (or of every eighth, say), a column a fact."""
    out = {name: np.full(len(cases), np.nan) for name in _COLUMNS}
    for name in ("asked", "claimed", "accepted"):
        out[name] = np.zeros(len(cases), dtype=bool)
    for k, (case, truth) in enumerate(zip(cases, truths, strict=True)):
        step = case.step
        if k % every or (free_only and truth.active.any()):
            continue
        out["asked"][k] = True
        answer = path(step)
        if answer.d is None or not np.isfinite(answer.d).all():
            continue
        d, z = answer.d, answer.z
        if z is None:
            z = (step.e - step.J @ d) / step.lam2  # the one that belongs to the answer
        out["claimed"][k] = answer.claimed
        out["distance"][k] = float(np.abs(d - truth.d).max())
        out["accepted"][k] = answer.claimed and check_optimality(step, np.ascontiguousarray(d), z).holds()
        out["primal"][k], out["dual"][k], out["gap"][k] = answer.residuals or _slack_residuals(step, d, z)
    return out


HEADER = ["path", "steps", "not solved", "distance: median", "max", "primal residual: median", "max",
          "dual residual: median", "max", "duality gap: median", "max", "solved but > 1e-6 off",
          "KKT check accepts", "accepted but > 1e-8 off"]  # fmt: skip


def _row(name: str, found: dict[str, NDArray], within: NDArray[np.bool_]) -> list[object]:
    asked, claimed = found["asked"] & within, found["claimed"] & within
    row: list[object] = [name, int(asked.sum()), int((asked & ~claimed).sum())]
    for column in ("distance", "primal", "dual", "gap"):
        values = found[column][claimed]
        row += [f"{np.median(values):.1e}", f"{values.max():.1e}"] if len(values) else ["-", "-"]
    accepted = found["accepted"] & within
    row += [
        int((claimed & (found["distance"] > CLAIMED_DIFFERENCE)).sum()),
        int(accepted.sum()),
        int((accepted & (found["distance"] > ACCEPTED_DIFFERENCE)).sum()),
    ]
    return row


def _grouped(results: Results, labels: Sequence[str], order: Sequence[str]) -> list[list[object]]:
    """Return the rows of every path by a label of the cases."""
    at = np.array(labels)
    groups = [group for group in order if (at == group).any()]
    return [[group, *_row(name, found, at == group)] for group in groups for name, found in results.items()]


def compare(cases: Sequence[Case]) -> tuple[list[Case], list[Truth], Results]:
    """Return the cases whose truth is known, their truths, and every path's answers."""
    found = [(case, exact_step(case.step)) for case in cases]
    known = [case for case, truth in found if truth is not None]
    truths = [truth for _, truth in found if truth is not None]
    results: Results = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # solvers warn of what the columns count
        for name, path in paths(known[0].step.n).items():
            every = _THINNED.get(name, 1) if len(known) > 200 else 1
            results[name] = _answers(path, known, truths, free_only=name == CLOSED_FORM, every=every)
    return known, truths, results


def _conditioning(cases: Sequence[Case], truths: Sequence[Truth], found: dict[str, NDArray]) -> list[list[object]]:
    """Return, by family and lambda^2, where the active set misses its bar, and what rounding J does to the truth."""
    rng = np.random.default_rng(0)
    groups: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for k in np.flatnonzero(~(found["distance"] <= ACTIVE_SET_DIFFERENCE)):
        step, moved = cases[k].step, 0.0
        for _ in range(3):
            J = step.J * (1.0 + rng.choice([-1.0, 1.0], step.J.shape) * 2.0**-52)
            other = exact_step(StepProblem(J, step.e, step.S, step.c, step.lam2, step.lb, step.ub))
            moved = max(moved, np.inf if other is None else float(np.abs(other.d - truths[k].d).max()))
        decade = f"1e{int(np.floor(np.log10(step.lam2) + 1e-9)):03d}"
        groups.setdefault((cases[k].family, decade), []).append((float(found["distance"][k]), moved))
    return [
        [family, decade, len(pairs), f"{max(p[0] for p in pairs):.1e}", f"{max(p[1] for p in pairs):.1e}",
         f"{max(p[0] / p[1] if p[1] else np.inf for p in pairs):.1e}"]
        for (family, decade), pairs in sorted(groups.items())
    ]  # fmt: skip


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG without touching pyplot's state."""
    path.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(path)


def _error_figure(cases: Sequence[Case], results: Results) -> Figure:
    labels = np.array([case.damping for case in cases])
    figure = Figure(figsize=(9, 5.5), layout="constrained")
    axes = figure.add_subplot()
    for k, (name, found) in enumerate(results.items()):
        worst = [
            np.max(found["distance"][found["claimed"] & (labels == f"{lam2:.0e}")], initial=1e-18) for lam2 in DAMPINGS
        ]
        axes.loglog(DAMPINGS, worst, marker="osv^Dx"[k % 6], linestyle=("-", "--", ":")[k // 6 % 3], label=name)
    axes.axhline(CLAIMED_DIFFERENCE, color="0.6", linewidth=0.8)
    axes.invert_xaxis()
    axes.set(xlabel="λ²", ylabel="largest distance to the true step where called solved (rad)")
    axes.set_title("Error of the answers called solved, all families with a set λ²")
    axes.grid(True, which="major", alpha=0.3)
    figure.legend(loc="outside right upper", fontsize="small", frameon=False)
    return figure


def conventions(cell: Path, *, joint: int = 4) -> tuple[Figure, str]:
    """Return the figure and the sentences on the paper's contradictory weights (eq. 3 against eq. 4)."""
    chain = qparm.Cell.load(cell).chain()
    shares = np.geomspace(1e-3, 0.3, 200)
    width = chain.upper[joint] - chain.lower[joint]
    moved = np.empty((3, len(shares)))
    for k, share in enumerate(shares):
        q = 0.5 * (chain.lower + chain.upper) + 0.15 * (chain.upper - chain.lower) * np.cos(np.arange(chain.n))
        q[joint] = chain.upper[joint] - share * width
        step = step_problem(chain, q, chain.forward(q), method="dls")
        direction = np.zeros(chain.n)
        direction[joint] = 0.02
        W, (mobility, phi), e = chan_dubey_weights(chain, q, direction), clamping_weights(chain, q), step.J @ direction
        open_, none = np.full(chain.n, np.inf), np.zeros(chain.n)
        weights = ((W**-0.5, none), (W**0.5, none), (np.sqrt(mobility), -(1.0 - mobility) * phi))
        for line, (S, c) in enumerate(weights):
            moved[line, k] = closed_form(StepProblem(step.J, e, S, c, 1e-6, -open_, open_))[joint]
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    axes = figure.add_subplot()
    names = ("eq. 3, W as Chan and Dubey have it: large near a limit", "eq. 3 with the text's “smaller weight”: W⁻¹",
             "eq. 4, W̃: a mobility, with its clamp")  # fmt: skip
    for line, name, style in zip(moved, names, ("-", "--", ":"), strict=True):
        axes.semilogx(shares, line, style, label=name)
    axes.axhline(0.0, color="0.6", linewidth=0.8)
    axes.invert_xaxis()
    axes.set(xlabel="distance to the upper limit, share of the range", ylabel=f"step of joint {joint + 1} (rad)")
    axes.set_title("One task towards a limit (0.02 rad of that joint) under three conventions")
    axes.legend(fontsize="small", frameon=False)
    text = (
        f"Eq. 3 with W as Chan and Dubey define it (large near a limit, inverted) slows joint {joint + 1} from"
        f" {moved[0, -1]:.4f} rad at 0.3 of its range from the limit to {moved[0, 0]:.1e} rad at 0.001 of it;"
        f" with the text's “smaller weight factors” (W⁻¹ in its place) it goes {moved[1, 0]:.4f} rad, into the limit.\n"
        f"Eq. 4 writes its weight W̃ as it is, 1 for a free joint and 0 at its limit, so it plays the part of eq. 3's"
        f" W⁻¹: there the same joint goes {moved[2, 0]:.4f} rad, away from the limit by the clamp φ."
    )
    return figure, text


def _save_tables(out: Path, cases: Sequence[Case], results: Results) -> str:
    count = f"{len(cases)} steps"
    rows = [_row(name, found, np.ones(len(cases), bool)) for name, found in results.items()]
    tables = [save_table(out, "equivalence", f"Every path on every family: {count}", HEADER, rows)]
    groups = {
        "family": [case.family for case in cases],
        "lambda^2": [case.damping for case in cases],
        "bounds": [case.bounds for case in cases],
        "method": [case.method for case in cases],
    }
    orders: dict[str, Sequence[str]] = {
        "family": list(dict.fromkeys(groups["family"])),
        "lambda^2": [*(f"{lam2:.0e}" for lam2 in DAMPINGS), "own"],
        "bounds": [*BOUNDS, "own"],
        "method": METHODS,
    }
    for group, labels in groups.items():
        name = f"equivalence_by_{'damping' if group == 'lambda^2' else group}"
        rows = _grouped(results, labels, orders[group])
        tables.append(save_table(out, name, f"Every path by {group}: {count}", [group, *HEADER], rows))
    return "\n".join(tables)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print and write tables and figures; return 1 if the verdict fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--quick", action="store_true", help=f"a seeded choice of {QUICK} steps")
    chosen = parser.parse_args(arguments)
    cases = step_cases(chosen.cell, seed=chosen.seed, limit=QUICK if chosen.quick else None)
    known, truths, results = compare(cases)
    lost = len(cases) - len(known)
    print(_save_tables(chosen.out, known, results))
    active = np.array([truth.active.any() for truth in truths])
    print(f"{len(cases)} steps, truth lost on {lost}; a bound is active in {int(active.sum())}")
    missed = _conditioning(known, truths, results[ACTIVE_SET])
    header = ["family", "lambda^2 from", "steps", "active set off by at most", "truth moves by at most", "worst ratio"]
    title = (
        "Where the active set is off by more than 1e-10, beside what one unit in the last place of J does to the truth"
    )
    print(save_table(chosen.out, "equivalence_conditioning", title, header, missed))
    save_figure(_error_figure(known, results), chosen.out / "equivalence_error.png")
    figure, text = conventions(chosen.cell)
    save_figure(figure, chosen.out / "weight_conventions.png")
    (chosen.out / "weight_conventions.md").write_text(
        f"![weights](weight_conventions.png)\n\n{text}\n", encoding="utf-8"
    )
    print(text)
    wrong = {
        name: count
        for name, found in results.items()
        if (count := int((found["accepted"] & (found["distance"] > ACCEPTED_DIFFERENCE)).sum()))
    }
    print(f"accepted by qparm's KKT check but off by more than 1e-8: {wrong or 'none'}")
    # rounding J itself moves the truth there: no arithmetic in doubles can do better
    avoidable = [row for row in missed if float(str(row[5])) > INHERENT]
    counts = [sum(int(str(row[2])) for row in rows) for rows in (missed, avoidable)]
    print(f"active set off by more than 1e-10: {counts[0]}, beyond ten times the conditioning: {counts[1]}")
    good = not wrong and not avoidable and not lost
    print("all bars hold" if good else "FAILED")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
