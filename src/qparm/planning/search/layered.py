"""Dynamic programming over layers of solutions: the path with the least lexicographic cost.

    (reconfigurations inside rows,  seconds of all reconfigurations,  largest step,  sum of squared steps)

Steps are in velocity-scaled joints. A step beyond the jump criterion is a reconfiguration: the arm goes there
from rest to rest, off its path. The first three parts are exact: adding, adding and taking the larger each keep
the order of partial paths. The fourth is exact once the third is known, so a second pass bounds the step by it.

Layers come one after another and those that no open path uses any more are let go.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from qparm.compiled.kernels import c1, c2, f8, i8, kernel, kernel_helper, o2, oi, void
from qparm.planning.search.projection import turn_of, unwound_turns
from qparm.planning.search.sampling import Layer
from qparm.robot.limits import QUINTIC_PEAKS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["DRIVEN", "FORCED", "INSIDE", "ROW_END", "LayeredSearch"]

# What an edge is: inside a row, at a row end (or in a self-motion area), over poses that cannot be reached, or one that
# is driven or not taken at all (what it does not lead to costs infinitely much).
INSIDE, ROW_END, FORCED, DRIVEN = 0, 1, 2, 3
# Costs closer than this are equal (s, rad): rounding must not decide between reconfigurations.
_EQUAL = 1e-12
_PEAK_V, _PEAK_A, _PEAK_J = QUINTIC_PEAKS


@kernel_helper
def less(a, i, b0, b1, b2, b3):
    """Return whether cost row a[i] comes before (b0, b1, b2, b3)."""
    if a[i, 0] != b0:
        return a[i, 0] < b0
    if abs(a[i, 1] - b1) > _EQUAL:
        return a[i, 1] < b1
    if abs(a[i, 2] - b2) > _EQUAL:
        return a[i, 2] < b2
    return a[i, 3] < b3


@kernel_helper
def sorted_costs(cost):
    """Return the order of ascending costs, by insertion into runs (merge sort on indices)."""
    m = cost.shape[0]
    order, other = np.arange(m), np.empty(m, dtype=np.int64)
    width = 1
    while width < m:
        for start in range(0, m, 2 * width):
            i, j, end = start, min(start + width, m), min(start + 2 * width, m)
            middle = j
            for k in range(start, end):
                if i < middle and (
                    j >= end
                    or not less(
                        cost, order[j], cost[order[i], 0], cost[order[i], 1], cost[order[i], 2], cost[order[i], 3]
                    )
                ):
                    other[k] = order[i]
                    i += 1
                else:
                    other[k] = order[j]
                    j += 1
        order, other = other, order
        width *= 2
    return order


@kernel_helper
def distance_of(a, b, turn):
    """Return how far a joint goes; a continuous one takes the short way round."""
    d = b - a
    if turn < math.inf:
        d -= turn * round(d / turn)
    return abs(d)


@kernel_helper
def seconds_between(a, b, turn, velocity, acceleration, jerk):
    """Return the time of a quintic from rest to rest."""
    t = 0.0
    for i in range(a.shape[0]):
        step = distance_of(a[i], b[i], turn[i])
        t = max(t, _PEAK_V * step / velocity[i])
        t = max(t, math.sqrt(_PEAK_A * step / acceleration[i]))
        t = max(t, (_PEAK_J * step / jerk[i]) ** (1.0 / 3.0))
    return t


@kernel_helper
def reach_within(t, velocity, acceleration, jerk, reach):
    """Write how far each joint comes from rest to rest in a time: the inverse of :func:`seconds_between`."""
    for i in range(reach.shape[0]):
        reach[i] = min(velocity[i] * t / _PEAK_V, acceleration[i] * t * t / _PEAK_A, jerk[i] * t * t * t / _PEAK_J)


@kernel_helper
def telling_joint(A, turn, jump):
    """Return the joint whose jump criterion leaves out most of the solutions A, -1 if none leaves out any."""
    best, least = -1, 0.5
    for i in range(A.shape[1]):
        if turn[i] < math.inf:
            continue
        lowest, highest = A[0, i], A[0, i]
        for a in range(A.shape[0]):
            lowest, highest = min(lowest, A[a, i]), max(highest, A[a, i])
        if jump[i] < least * (highest - lowest):
            best, least = i, jump[i] / (highest - lowest)
    return best


@kernel_helper
def bisected(values, x):
    """Return the number of ascending values below x."""
    low, high = 0, values.shape[0]
    while low < high:
        middle = (low + high) // 2
        if values[middle] < x:
            low = middle + 1
        else:
            high = middle
    return low


@kernel_helper
def measure_steps(AT, first, count, b, turn, scale, jump, squares, step, over):
    """Write of the steps from ``count`` solutions of AT (n, m) to b: sum of squares, largest, largest over its jump.

    One joint after another over all solutions, so that the processor takes several of them at a time.
    """
    for t in range(count):
        squares[t], step[t], over[t] = 0.0, 0.0, 0.0
    for i in range(AT.shape[0]):
        x, size, per_jump, whole = b[i], 1.0 / scale[i], 1.0 / jump[i], turn[i]
        line = AT[i, first : first + count]
        if whole < math.inf:
            for t in range(count):
                d = distance_of(line[t], x, whole)
                u, v = d * size, d * per_jump
                squares[t] += u * u
                step[t] = u if u > step[t] else step[t]
                over[t] = v if v > over[t] else over[t]
        else:
            for t in range(count):
                d = abs(x - line[t])
                u, v = d * size, d * per_jump
                squares[t] += u * u
                step[t] = u if u > step[t] else step[t]
                over[t] = v if v > over[t] else over[t]


@kernel(void(c2, c2, c1, c1, c1, c1, c1, c1, f8, f8, i8, c2, o2, oi))
def relax_kernel(A, B, scale, turn, jump, velocity, acceleration, jerk, cap, minimax, kind, cost, cost_out, back):
    """Write the least costs of the layer B from those of the layer A before it, and where they come from.

    ``minimax`` is 1.0, or 0.0 to leave the largest step out of the cost.
    """
    n, m = A.shape[1], A.shape[0]
    cheapest = 0
    for a in range(1, m):
        if less(cost, a, cost[cheapest, 0], cost[cheapest, 1], cost[cheapest, 2], cost[cheapest, 3]):
            cheapest = a
    order = np.empty(0, dtype=np.int64)
    # solutions in the order of one joint: those within its jump stand side by side
    joint = telling_joint(A, turn, jump) if kind != FORCED else -1
    along = np.argsort(A[:, joint], kind="mergesort") if joint >= 0 else np.arange(m)
    AT, of = np.empty((n, m)), np.empty((m, 4))
    for t in range(m):
        for i in range(n):
            AT[i, t] = A[along[t], i]
        for i in range(4):
            of[t, i] = cost[along[t], i]
    squares, step, over, reach = np.empty(m), np.empty(m), np.empty(m), np.empty(n)
    inside = 1.0 if kind == INSIDE else 0.0
    for b in range(B.shape[0]):
        c0, c1_, c2_, c3_, best = math.inf, math.inf, math.inf, math.inf, -1
        if kind != FORCED:
            first, last = 0, m
            if joint >= 0:
                first = bisected(AT[joint], B[b, joint] - jump[joint])
                last = bisected(AT[joint], B[b, joint] + jump[joint])
                while last < m and AT[joint, last] <= B[b, joint] + jump[joint]:
                    last += 1
            measure_steps(AT, first, last - first, B[b], turn, scale, jump, squares, step, over)
            for t in range(last - first):
                if over[t] > 1.0 or step[t] > cap:
                    continue
                k = first + t
                if of[k, 0] > c0:
                    continue
                largest, total = max(of[k, 2], minimax * step[t]), of[k, 3] + squares[t]
                if of[k, 0] == c0:
                    if of[k, 1] > c1_ + _EQUAL:
                        continue
                    if of[k, 1] >= c1_ - _EQUAL and (
                        largest > c2_ + _EQUAL or (largest >= c2_ - _EQUAL and total >= c3_)
                    ):
                        continue
                c0, c1_, c2_, c3_, best = of[k, 0], of[k, 1], largest, total, along[k]
        # a reconfiguration takes time, so it can only pay where it saves one, or a longer one, elsewhere
        least = cost[cheapest, 0] + inside
        if kind != DRIVEN and (best < 0 or least < c0 or (least == c0 and cost[cheapest, 1] < c1_ - _EQUAL)):
            if not len(order):
                order = sorted_costs(cost)
            reach[:] = math.inf
            if best >= 0 and least == c0:
                reach_within(c1_ - cost[cheapest, 1], velocity, acceleration, jerk, reach)
            for t in range(m):
                a = order[t]
                if best >= 0 and (
                    cost[a, 0] + inside > c0 or (cost[a, 0] + inside == c0 and cost[a, 1] >= c1_ - _EQUAL)
                ):
                    break
                # roots take long, and most ways are slower than one that is known
                slower = False
                for i in range(n):
                    if distance_of(A[a, i], B[b, i], turn[i]) > reach[i]:
                        slower = True
                        break
                if slower and cost[a, 0] + inside >= c0:
                    continue
                seconds = cost[a, 1] + seconds_between(A[a], B[b], turn, velocity, acceleration, jerk)
                if best < 0 or cost[a, 0] + inside < c0 or seconds < c1_ - _EQUAL:
                    c0, c1_, c2_, c3_, best = cost[a, 0] + inside, seconds, cost[a, 2], cost[a, 3], a
                    reach_within(c1_ - cost[cheapest, 1], velocity, acceleration, jerk, reach)
        cost_out[b, 0], cost_out[b, 1], cost_out[b, 2], cost_out[b, 3] = c0, c1_, c2_, c3_
        back[b] = best


class LayeredSearch:
    """Layers in, the best path out; layers that cannot matter any more are thinned as it goes.

    Parameters
    ----------
    chain : SerialChain
    scale : (n,) ndarray
        See :func:`qparm.planning.search.projection.velocity_scale`.
    cap : float
        Driven edges with a larger scaled step are not used (rad); a finite cap takes the place of the third part of the
        cost.
    """

    def __init__(self, chain: SerialChain, scale: NDArray[np.float64], *, cap: float = math.inf) -> None:
        self._chain, self._scale, self._cap = chain, scale, cap
        self._turn = turn_of(chain)
        self._minimax = 1.0 if math.isinf(cap) else 0.0
        self._layers: list[Layer] = []
        self._back: list[NDArray[np.int64]] = []
        self._cost = np.zeros((0, 4))
        self._settled = self._pruned = 0

    @property
    def last(self) -> Layer | None:
        """The layer added last."""
        return self._layers[-1] if self._layers else None

    @property
    def cost(self) -> NDArray[np.float64]:
        """Least cost of a path to each solution of the last layer, (m, 4)."""
        return self._cost

    def add(self, layer: Layer, kind: int, jump: NDArray[np.float64]) -> None:
        """Add a layer that is not empty, the kind of the edge to it, and beyond what step (n,) that is a jump."""
        m = len(layer.q)
        if not self._layers:
            cost, back = np.zeros((m, 4)), np.full(m, -1, dtype=np.int64)
        else:
            cost, back = np.empty((m, 4)), np.empty(m, dtype=np.int64)
            chain = self._chain
            relax_kernel(
                self._layers[-1].q, layer.q, self._scale, self._turn, jump, chain.velocity, chain.acceleration,
                chain.jerk, self._cap, self._minimax, kind, self._cost, cost, back,
            )  # fmt: skip
        self._layers.append(layer)
        self._back.append(back)
        self._cost = cost

    def prune(self) -> None:
        """Drop the solutions that no path to the last layer uses."""
        last = len(self._layers) - 1
        if last < 1:
            return
        used = np.unique(self._back[last])
        for k in range(last - 1, self._settled - 1, -1):
            if len(used) == len(self._layers[k].q) and k <= self._pruned:
                break
            position = np.full(len(self._layers[k].q), -1, dtype=np.int64)
            position[used] = np.arange(len(used))
            self._layers[k] = Layer(self._layers[k].q[used], self._layers[k].rho[used])
            self._back[k + 1] = position[self._back[k + 1]]
            self._back[k] = self._back[k][used]
            used = np.unique(self._back[k])
        self._pruned = last
        while self._settled < last and len(self._layers[self._settled].q) == 1:
            self._settled += 1

    def path(
        self, end: int | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, float, float, float]]:
        """Return the best path (K, n), or that to one solution of the last layer, its tool parameters and its cost."""
        j = int(np.lexsort(self._cost.T[::-1])[0]) if end is None else end
        cost = self._cost[j]
        q, rho = [], []
        for k in range(len(self._layers) - 1, -1, -1):
            q.append(self._layers[k].q[j])
            rho.append(self._layers[k].rho[j])
            j = int(self._back[k][j])
        return (
            unwound_turns(self._chain, np.array(q[::-1])),
            np.array(rho[::-1]),
            (int(cost[0]), float(cost[1]), float(cost[2]), float(cost[3])),
        )
