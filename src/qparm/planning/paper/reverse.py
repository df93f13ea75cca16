"""The paper's improved strategy (its section 3.2.2): self-motion, reverse planning, and sacrifice as a last resort.

A row is followed from point to point (step 1). Where an edge is a jump, the arm draws near to the configuration
before by self-motion (step 2). Where that does not do, random solutions of the pose are followed backwards to the
row's start; the first that arrives without a jump replaces the row so far, and the jump has moved to the row end
(step 3). Where none arrives, the arm must reconfigure inside the row: a break, planned as a motion elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from qparm.ik import Method, PoseSolution, PoseStatus, StepCounts, StepRule, StepSolver
from qparm.ik.solve import active_limits
from qparm.path import ToolPath
from qparm.planning.paper.follow import Followed, Follower, Stop
from qparm.planning.paper.general import START_CANDIDATES, PointRecord
from qparm.planning.paper.jump import jump_ratios
from qparm.planning.paper.reverse_record import MetJump, Repair, ReversePath, ReverseStatistics, Step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.planning.problem import PathProblem
    from qparm.robot import SerialChain

__all__ = ["reverse"]

# The paper's number of random solutions, and how many starts may be spent on finding them.
SOLUTIONS = 50
STARTS = 200
# Ours: how far self-motion may draw a point of the reverse pass from the one before, over the criterion; the
# gentlest that joins the row is taken. Not 1: rounding must not make a jump of it.
SHARES = (0.2, 0.5, 0.95)
# Solutions of one pose that are nearer than this in every joint (scaled) are one: one degree.
_SAME = np.radians(1.0)


def reverse(
    problem: PathProblem,
    *,
    method: Method | StepRule = "cwln",
    solver: str | StepSolver = "auto",
    join: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> ReversePath:
    """Return configurations for all points without jumps inside the rows, as far as the paper's strategy finds them.

    Parameters
    ----------
    problem : PathProblem
        The search starts at its home if no random start reaches the first pose; steps are judged by the criteria with
        its feed.
    method, solver
        See :class:`qparm.ik.PoseSolver`. Self-motion is gradient projection whatever the method; its steps go to the
        solver too.
    join : bool
        Before a sacrifice, try to join the row as it stands by self-motion along the reverse pass. It is not in the
        paper; False keeps to its letter.
    progress : callable, optional
        ``progress(done, total)``, called after each row with counts of points.

    Returns
    -------
    ReversePath
        Points that are not reached and jumps that remain are data in it.

    Raises
    ------
    InvalidInput
        If the problem's jump criterion is not positive or of another shape, a tolerance is not positive, or method or
        solver are unknown.

    References
    ----------
    Sun et al., Micromachines 2023, 14, 886, section 3.2.2.
    """
    chain, tool_path = problem.chain, problem.tool_path
    # the edge before each point; that before the first is none
    criteria = np.concatenate([np.full((1, chain.n), np.inf), problem.criteria_by_feed])
    home = chain.check_one_configuration(problem.home, what="home")
    follower = Follower(
        chain,
        tool_path.poses,
        method=method,
        solver=solver,
        position_tolerance=problem.position_tolerance,
        rotation_tolerance=problem.rotation_tolerance,
    )
    planner = _Planner(chain, tool_path, criteria, follower, problem.rng(0), join=join)
    planner.begin(home)
    bounds = np.flatnonzero(np.diff(tool_path.row_of_point, prepend=-1, append=-1))
    for first, after in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        planner.plan_row(first, after - 1)
        if progress is not None:
            progress(after, tool_path.point_count)
    return planner.result()


class _Planner:
    """The state of one run: the configurations so far, and the account."""

    def __init__(
        self,
        chain: SerialChain,
        tool_path: ToolPath,
        criteria: NDArray[np.float64],
        follower: Follower,
        rng: np.random.Generator,
        *,
        join: bool,
    ) -> None:
        self.join = join
        P, n = tool_path.point_count, chain.n
        self.chain, self.follower, self.rng, self.criteria = chain, follower, rng, criteria
        self.row_of_point, in_area = tool_path.row_of_point, tool_path.in_self_motion_area
        new_row = np.diff(self.row_of_point, prepend=-1) != 0
        # the edge before a point lies in a self-motion area if it joins two rows or two points of the area
        self.area = new_row | (in_area & np.roll(in_area, 1))
        # where following makes no test: at row ends, and after gaps as they turn up
        self.tested = np.where(new_row[:, None], np.inf, criteria)
        self.q = np.full((P, n), np.nan)
        self.reached = np.zeros(P, dtype=bool)
        self.errors, self.iterations = np.full((P, 2), np.nan), np.zeros(P, dtype=np.int64)
        self.status: dict[int, PoseStatus] = {}
        self.q_last = np.zeros(n)  # the last configuration that was reached
        self.counts, self.poses_solved, self.start_solutions = StepCounts(), 0, 0
        self.met: list[MetJump] = []

    # --- the rows ---------------------------------------------------------------------------------

    def begin(self, home: NDArray[np.float64]) -> None:
        """Choose where the first row starts: the solution farthest from its limits, home if there is none."""
        found = self.solve_from(0, self.chain.random(self.rng, START_CANDIDATES))
        self.start_solutions, self.q_last = len(found), home
        if found:
            q = np.array([s.q for s in found])
            self.q_last = q[self.chain.distance_to_limits(q).argmax()]

    def plan_row(self, first: int, last: int) -> None:
        """Follow a row to its end, repairing what turns up."""
        start, k = first, first  # start: the row's first point, or the first one after its last gap
        while k <= last:
            followed = self.follow(self.q_last, k, last)
            passed = len(followed.q)
            for m in np.flatnonzero(followed.met[:passed].any(axis=1)).tolist():
                self.note(k + m, self.step(k + m, followed.met[m]), Repair.SELF_MOTION)
            self.put(followed, slice(k, k + passed), slice(0, passed))
            k += passed
            if k > last:
                break
            if not self.repair(k, start, followed):
                start = k + 1
                if start <= last:
                    self.tested[start] = np.inf
            k += 1

    def repair(self, k: int, start: int, followed: Followed) -> bool:
        """Find a configuration for the point that stopped following; return whether there is one."""
        jumped = followed.stop is Stop.JUMP
        step = self.step(k, followed.met[-1]) if jumped else None
        if jumped and self.area[k]:
            self.put_one(k, followed.q_stop, int(followed.iterations[-1]))
            self.note(k, step, Repair.AT_ROW_END, moved_to=k)
            return True
        ended = None if jumped else self.solve(k, self.q_last)
        if ended is not None and ended.status is PoseStatus.UNREACHABLE:
            return self.leave_out(k, ended)
        found = self.random_solutions(k)
        if ended is not None and not found:
            return self.leave_out(k, ended)
        if k == start or self.area[k]:
            best, _ = self.nearest(k, [s.q for s in found])
            self.put_one(k, best, 0)
            self.note(k, step, Repair.RESTART if k == start else Repair.AT_ROW_END, tries=len(found), moved_to=k)
            return True
        done, tries = self.plan_back(k, start, found, step)
        if not done:
            own = [followed.q_stop] if jumped else []
            best, ratio = self.nearest(k, [*own, *(s.q for s in found)])
            self.put_one(k, best, 0)
            self.note(k, step, Repair.SACRIFICE if ratio > 1 else Repair.SELF_MOTION, tries=tries)
        return True

    def plan_back(self, k: int, start: int, found: list[PoseSolution], step: Step | None) -> tuple[bool, int]:
        """Plan the row anew backwards from solutions of point k; return whether one arrived, and the tries."""
        broken = [b for b in range(start + 1, k) if self.ratio(b) > 1]
        second: tuple[int, PoseSolution, Followed] | None = None
        tries = 0
        for solution in found:
            tries += 1
            back = self.follow(solution.q, k - 1, start)
            low = k - len(back.q)
            if back.stop is Stop.ALL or self.area[low]:
                return self.put_reversed(k, low, solution, back, step, tries)
            met_break = next((b for b in broken if b >= low), None)
            if met_break is not None and (second is None or met_break < second[0]):
                second = (met_break, solution, back)
        for share, solution in product(SHARES if self.join else (), found):
            tries += 1
            back = self.follow(solution.q, k - 1, start, share)
            if back.stop in (Stop.ALL, Stop.JOINED):
                repair = Repair.JOINED if back.stop is Stop.JOINED else Repair.REVERSE
                return self.put_reversed(k, k - len(back.q), solution, back, step, tries, repair)
        if second is not None:
            # ours: the arm reconfigures there anyway, so a jump that moves there costs nothing
            return self.put_reversed(k, *second, step, tries)
        return False, tries

    def put_reversed(
        self,
        k: int,
        low: int,
        solution: PoseSolution,
        back: Followed,
        step: Step | None,
        tries: int,
        repair: Repair = Repair.REVERSE,
    ) -> tuple[bool, int]:
        """Replace the points ``low`` to ``k`` by a solution and what following it backwards gave."""
        self.put(back, slice(low, k), slice(k - low - 1, None, -1) if low < k else slice(0, 0))
        self.put_one(k, solution.q, solution.iterations)
        self.note(k, step, repair, tries=tries, moved_to=low if repair is Repair.REVERSE else None)
        return True, tries

    def leave_out(self, k: int, ended: PoseSolution) -> bool:
        """Record a point as not reached."""
        self.q[k], self.reached[k], self.status[k] = ended.q, False, ended.status
        self.errors[k], self.iterations[k] = (ended.position_error, ended.rotation_error), ended.iterations
        self.note(k, None, Repair.UNREACHED, tries=0)
        return False

    # --- solutions of one point -------------------------------------------------------------------

    def random_solutions(self, k: int) -> list[PoseSolution]:
        """Return up to 50 solutions of a point from random starts, in the order drawn, one of each within a degree."""
        kept: list[PoseSolution] = []
        for round_ in range(0, STARTS, SOLUTIONS):
            starts = self.chain.random(self.rng, SOLUTIONS)
            # ours: the clamp keeps CWLN from poses at the edge of reach, which only joints at their limits reach
            plain = round_ > 0 and not kept
            for solution in self.solve_from(k, np.vstack([self.q_last, starts]) if plain else starts, plain=plain):
                apart = (np.abs(solution.q - other.q) / self.chain.scale for other in kept)
                if all(distance.max() > _SAME for distance in apart):
                    kept.append(solution)
            if len(kept) >= SOLUTIONS:
                break
        return kept[:SOLUTIONS]

    def nearest(self, k: int, configurations: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], float]:
        """Return what comes nearest to the last configuration after self-motion, and how near (over the criterion)."""
        drawn = []
        for q in configurations:
            q_near, _, counts = self.follower.draw_near(k, q, self.q_last)
            self.counts += counts
            drawn.append(q_near)
        ratios = jump_ratios(self.q_last, np.array(drawn), self.criteria[k])
        return drawn[ratios.argmin()], float(ratios.min())

    def solve_from(self, k: int, starts: NDArray[np.float64], *, plain: bool = False) -> list[PoseSolution]:
        """Return the solutions of a point from some starts."""
        return [s for s in (self.solve(k, start, plain=plain) for start in starts) if s.reached]

    def solve(self, k: int, q_start: NDArray[np.float64], *, plain: bool = False) -> PoseSolution:
        """Solve a point from one start, on the account; ``plain`` by damped least norm."""
        solution = self.follower.solve(k, q_start, plain=plain)
        self.poses_solved += 1
        self.counts += solution.counts
        return solution

    def follow(self, q: NDArray[np.float64], first: int, last: int, share: float = 0.0) -> Followed:
        """Follow points, on the account; with a share, drawn towards the path as it stands."""
        towards = self.q if share else None
        followed = self.follower.follow(q, first, last, self.tested, towards=towards, share=share)
        self.poses_solved += len(followed.q) + (followed.stop in (Stop.NOT_REACHED, Stop.JUMP))
        self.counts += followed.counts
        return followed

    # --- the path and the account -----------------------------------------------------------------

    def put(self, followed: Followed, points: slice, which: slice) -> None:
        """Set points to configurations that were followed."""
        passed = len(followed.q)
        self.q[points], self.reached[points] = followed.q[which], True
        self.errors[points], self.iterations[points] = (
            followed.errors[:passed][which],
            followed.iterations[:passed][which],
        )
        if points.stop > points.start:
            self.q_last = self.q[points.stop - 1]

    def put_one(self, k: int, q: NDArray[np.float64], iterations: int) -> None:
        """Set one point."""
        E = self.chain.pose_error(self.chain.forward(q), self.follower.poses[k])
        self.q[k], self.reached[k], self.iterations[k] = q, True, iterations
        self.errors[k] = np.linalg.norm(E[:3]), np.linalg.norm(E[3:])
        self.q_last = self.q[k]

    def ratio(self, k: int) -> float:
        """Return the step of the edge before a point over its criterion."""
        return float(jump_ratios(self.q[k - 1], self.q[k], self.criteria[k]))

    def step(self, k: int, difference: NDArray[np.float64]) -> Step:
        """Return the worst joint of a step on the edge before a point."""
        ratios = np.abs(difference) / self.criteria[k]
        joint = int(ratios.argmax())
        return Step(self.chain.names[joint], float(np.abs(difference[joint])), float(ratios[joint]))

    def note(self, k: int, step: Step | None, repair: Repair, *, tries: int = 0, moved_to: int | None = None) -> None:
        """Put a jump on the account."""
        row = int(self.row_of_point[k])
        place = k - int(np.searchsorted(self.row_of_point, row))
        self.met.append(MetJump(row, place, k, step, repair, tries, moved_to))

    def edge(self, k: int | None) -> Step | None:
        """Return the step of the edge before a point in the finished path, None where there is none."""
        if not k or not (self.reached[k - 1] and self.reached[k]):
            return None
        return self.step(k, self.q[k] - self.q[k - 1])

    def result(self) -> ReversePath:
        """Return the finished path."""
        P = len(self.q)
        same_row = np.diff(self.row_of_point, prepend=-1) == 0
        both = self.reached & np.roll(self.reached, 1) & same_row
        breaks = np.array([k for k in np.flatnonzero(both).tolist() if self.ratio(k) > 1], dtype=np.int64)
        return ReversePath(
            q=self.q,
            reached=self.reached,
            breaks=breaks,
            breaks_in_area=self.area[breaks],
            counts=self.counts,
            points=tuple(
                PointRecord(
                    status=self.status.get(k, PoseStatus.REACHED),
                    position_error=float(self.errors[k, 0]),
                    rotation_error=float(self.errors[k, 1]),
                    iterations=int(self.iterations[k]),
                    active_limits=active_limits(self.chain, self.q[k]),
                )
                for k in range(P)
            ),
            statistics=ReverseStatistics(
                jumps=tuple(replace(jump, moved_step=self.edge(jump.moved_to)) for jump in self.met),
                row_ends=tuple(self.edge(k) for k in np.flatnonzero(~same_row)[1:].tolist()),
                poses_solved=self.poses_solved,
                start_solutions=self.start_solutions,
            ),
        )
