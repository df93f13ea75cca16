"""Time, overhead and accuracy of every QP solver on recorded steps: persistent workspaces and generic calls.

    python -m comparisons.solvers [--cell FILE] [--seed K] [--out FOLDER] [--quick]

The steps are those that plans by cwln, wln and gpm really made, all sizes of task, with the closed-form shortcut off.
On every step all solvers take their turn, in an order that changes from step to step, so that a slow moment of the
machine hits none of them alone. A time is that of the whole call, step in, checked answer out.

*Own time* is the solver's: what OSQP says of its own run (update included), the bare update and solve of ProxQP's
workspace, and ``solve_time`` as qpsolvers tells it for generic calls; the rest of the call is *overhead* (assembly,
conversions, the KKT check). The compiled active set has no call of a solver inside.

The shifted geometric mean exp(mean(log(t + s))) - s, in microseconds and relative to the best, has the power of ten
nearest to the fastest median as its shift s. Where an answer is not accepted the active set's time on the step is
added, for that is what the package then does.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import qpsolvers
from numpy.typing import NDArray

import qparm
from comparisons.families import exact_step
from comparisons.recorded import recorded_steps
from comparisons.tables import microseconds, save_table, shifted_geometric_mean
from qparm.errors import KernelError
from qparm.ik import StepProblem, active_set, make_solver
from qparm.ik.solvers import GenericSolver, StepSolver

__all__ = ["Heard", "compare", "listening", "main"]

METHODS = ("cwln", "wln", "gpm")
ACTIVE_SET = "active set, compiled"
_STEPS, _QUICK = 200, 12  # per method
_WARM_UP = 3
ACCEPTED_DIFFERENCE = 1e-8

# What a call returns: the step, and whether it is accepted.
Call = Callable[[StepProblem], tuple[NDArray[np.float64] | None, bool]]


@dataclass
class Heard:
    """What was overheard since ``own`` was last set to None: the solver's own seconds, and its settings."""

    own: float | None = None
    settings: dict[str, Any] = field(default_factory=dict)

    def add(self, seconds: float) -> None:
        """Add to the solver's own time."""
        self.own = (self.own or 0.0) + seconds


_PROXQP_SETTINGS = ("eps_abs", "eps_rel", "check_duality_gap", "eps_duality_gap_abs", "max_iter", "initial_guess")


@contextmanager
def listening() -> Iterator[Heard]:
    """Overhear the calls that qparm makes of the solvers; they are passed on unchanged."""
    import osqp
    from proxsuite import proxqp

    heard = Heard()
    QP, OSQP = proxqp.dense.QP, osqp.OSQP
    bare = {name: getattr(QP, name) for name in ("init", "update", "solve")}
    setup, solve, solve_problem = OSQP.setup, OSQP.solve, qpsolvers.solve_problem

    def timed(name: str) -> Callable[..., Any]:
        function = bare[name]

        def call(self: Any, *args: Any, **kwargs: Any) -> Any:
            if name == "init":
                heard.settings.update({key: getattr(self.settings, key) for key in _PROXQP_SETTINGS})
            start = time.perf_counter()
            result = function(self, *args, **kwargs)
            heard.add(time.perf_counter() - start)
            return result

        return call

    def osqp_setup(self: Any, *args: Any, **kwargs: Any) -> Any:
        heard.settings.update({key: value for key, value in kwargs.items() if key not in ("P", "q", "A", "l", "u")})
        return setup(self, *args, **kwargs)

    def osqp_solve(self: Any, *args: Any, **kwargs: Any) -> Any:
        results = solve(self, *args, **kwargs)
        heard.add(results.info.run_time)
        return results

    def generic(problem: Any, *args: Any, **kwargs: Any) -> Any:
        solution = solve_problem(problem, *args, **kwargs)
        heard.settings = {key: value for key, value in kwargs.items() if key != "solver"}
        heard.own = solution.solve_time  # in place of what the solver underneath was heard to say
        return solution

    try:
        OSQP.setup, OSQP.solve, qpsolvers.solve_problem = osqp_setup, osqp_solve, generic
        for name in bare:
            setattr(QP, name, timed(name))
        yield heard
    finally:
        OSQP.setup, OSQP.solve, qpsolvers.solve_problem = setup, solve, solve_problem
        for name, function in bare.items():
            setattr(QP, name, function)


def calls(n: int) -> dict[str, Call]:
    """Return every solver for steps of ``n`` joints: qparm's workspaces, then the generic calls."""

    def by_active_set(step: StepProblem) -> tuple[NDArray[np.float64] | None, bool]:
        try:
            return active_set(step), True
        except KernelError:
            return None, False

    def by_solver(solver: StepSolver) -> Call:
        def solve(step: StepProblem) -> tuple[NDArray[np.float64] | None, bool]:
            answer = solver.solve(step)
            return answer.d, answer.accepted

        return solve

    return {
        ACTIVE_SET: by_active_set,
        "ProxQP, workspace": by_solver(make_solver("proxqp", n)),
        "OSQP, workspace": by_solver(make_solver("osqp", n)),
        **{f"{name}, generic": by_solver(GenericSolver(name, n)) for name in qpsolvers.available_solvers},
    }


@dataclass(eq=False)
class Timings:
    """Per step: seconds of the call, the solver's own seconds, distance to the truth, whether accepted."""

    wall: NDArray[np.float64]
    own: NDArray[np.float64]
    distance: NDArray[np.float64]
    accepted: NDArray[np.bool_]
    settings: str = ""


def compare(steps: Sequence[StepProblem]) -> tuple[dict[str, Timings], NDArray[np.bool_]]:
    """Return what every solver did on every step whose truth is known, and on which of them a bound is active."""
    pairs = [(step, truth) for step in steps if (truth := exact_step(step)) is not None]
    active = np.array([truth.active.any() for _, truth in pairs])
    ways = calls(steps[0].n)
    found = {name: Timings(*np.full((3, len(pairs)), np.nan), np.zeros(len(pairs), bool)) for name in ways}
    names = list(ways)
    with warnings.catch_warnings(), listening() as heard:
        warnings.simplefilter("ignore")  # solvers warn of what the columns count
        for name, way in ways.items():
            heard.settings = {}
            for step, _ in pairs[:_WARM_UP]:
                way(step)
            found[name].settings = ", ".join(f"{k} {_plain(v)}" for k, v in heard.settings.items()) or "as it comes"
        found[ACTIVE_SET].settings = "none"
        for k, (step, truth) in enumerate(pairs):
            turn = k % len(names)
            for name in names[turn:] + names[:turn]:
                heard.own = None
                start = time.perf_counter()
                d, accepted = ways[name](step)
                one = found[name]
                one.wall[k] = time.perf_counter() - start
                one.own[k] = np.nan if heard.own is None else heard.own
                one.accepted[k] = accepted
                if accepted and d is not None:
                    one.distance[k] = float(np.abs(d - truth.d).max())
    return found, active


def _plain(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value).rsplit(".", 1)[-1]


HEADER = ["solver", "steps", "median us", "p99 us", "shifted geometric mean / best", "own time: median us",
          "overhead: median us", "own / call", "accuracy reached", "not solved", "settings"]  # fmt: skip


def rows(found: dict[str, Timings], within: NDArray[np.bool_]) -> tuple[list[list[object]], float]:
    """Return the table over some of the steps, and the shift of its geometric means in microseconds."""
    fallback = found[ACTIVE_SET].wall
    charged = {name: 1e6 * np.where(one.accepted, one.wall, one.wall + fallback)[within] for name, one in found.items()}
    shift = float(10.0 ** np.round(np.log10(min(np.median(times) for times in charged.values()))))
    means = {name: shifted_geometric_mean(times, shift) for name, times in charged.items()}
    best = min(means.values())
    out: list[list[object]] = []
    for name, one in found.items():
        wall, own, failed = one.wall[within], one.own[within], ~one.accepted[within]
        told = np.isfinite(own).all()
        out.append(
            [
                name,
                len(wall),
                *microseconds(wall),
                f"{means[name] / best:.2f}",
                microseconds(own)[0] if told else "-",
                microseconds(wall - own)[0] if told else "-",
                f"{np.median(own / wall):.2f}" if told else "-",
                f"{np.nanmax(one.distance[within]):.1e}" if (~failed).any() else "-",
                f"{int(failed.sum())} ({failed.mean():.1%})",
                one.settings,
            ]
        )
    return out, shift


def main(arguments: Sequence[str] | None = None) -> int:
    """Print and write the tables; return 1 if an accepted answer is off by more than 1e-8."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", type=Path, default=Path("examples/dome.toml"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("comparisons/out"))
    parser.add_argument("--quick", action="store_true", help=f"{_QUICK} steps per method instead of {_STEPS}")
    chosen = parser.parse_args(arguments)
    steps: list[StepProblem] = []
    for method in METHODS:
        plan = qparm.plan(chosen.cell, strategy="general", seed=chosen.seed, method=method, keep_traces=True)
        steps += recorded_steps(plan, limit=_QUICK if chosen.quick else _STEPS)
    found, active = compare(steps)
    everything = np.ones(len(active), bool)
    print(f"truth lost on {len(steps) - len(active)} of {len(steps)} steps")
    for name, what, within in (
        ("solvers_bounded", "at least one bound active", active),
        ("solvers", "all", everything),
    ):
        table, shift = rows(found, within)
        title = f"Solvers on recorded steps, {what}: {int(within.sum())} steps, in turn; shift {shift:g} us"
        print(save_table(chosen.out, name, title, HEADER, table))
    wrong = {name: int((one.distance > ACCEPTED_DIFFERENCE).sum()) for name, one in found.items()}
    wrong = {name: count for name, count in wrong.items() if count}
    print(f"accepted but off by more than 1e-8: {wrong or 'none'}")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
