"""Quality figures of a trajectory, from its positions alone: differentiated anew, not by its own derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.path.joint_path import SegmentKind

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.interpolate import PPoly

    from qparm.path.joint_path import JointPath
    from qparm.path.tool_path import ToolPath
    from qparm.path.trajectory import Trajectory
    from qparm.robot import MotionLimits, SerialChain

__all__ = ["RotationError", "TrajectoryReport", "verify_trajectory"]

# By how much tool rotations (N, 3, 3) miss others (N, 3, 3): (N,), rad.
RotationError = Callable[["NDArray[np.float64]", "NDArray[np.float64]"], "NDArray[np.float64]"]

# Positions of a polynomial of degree five at six places give all its derivatives; they are looked at in 17 places.
_NODES = 0.5 - 0.5 * np.cos((np.arange(6) + 0.5) * np.pi / 6)
_LOOKS = np.linspace(0.0, 1.0, 17)
# Rounding of a position, times what the third derivative makes of it over unit time.
_ROUNDING = 2.3e-16 * 2e3
# Share of a jerk limit that rounding may make: on shorter pieces accelerations are differentiated instead.
_NOISE = 1e-5
# The accelerations of a cubic at four places give its jerk; below the least duration (s) the trajectory's own is taken.
_FEW = np.array([0.05, 0.35, 0.65, 0.95])
_LEAST = 1e-7
# Places between two waypoints at which the tool is looked at, and the time over which its speed is taken (s).
_PLACES, _PLACES_AT_ENDS = 16, 256
_SPEED_TIME = 1e-4
# A curve whose speed over its parameter squared is no more than this stands still.
_STILL = 1e-9
# The feed is kept where the tool's speed is this near to it, as a share.
_FEED_KEPT = 1e-3
_ORDERS = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True, eq=False)
class TrajectoryReport:
    """Figures of a trajectory; NaN and empty arrays where nothing was given to compare it with.

    Attributes
    ----------
    joint_names : tuple of str
    shares : (3, n) ndarray
        Largest velocity, acceleration and jerk over their limits, at 17 places of every polynomial.
    share_times : (3, n) ndarray
        When (s).
    steps : (3,) ndarray
        Largest step of position, velocity and acceleration between two polynomials (m, rad and derivatives).
    waypoint_times : (N,) ndarray
        When the waypoints are passed (s).
    waypoint_deviation : float
        Largest distance of a joint from a waypoint at that time (m, rad).
    tool_deviation : float
        Largest distance of the tool from the tool path on rows and transitions (m).
    tool_rotation : float
        Largest orientation error of the tool there (rad).
    feed_kept : (rows,) ndarray
        Share of each row's way on which the tool's speed is within 0.1 % of the feed.
    feed_lost : float
        Seconds that the rows take longer than at the feed from end to end.
    """

    joint_names: tuple[str, ...]
    shares: NDArray[np.float64]
    share_times: NDArray[np.float64]
    steps: NDArray[np.float64]
    waypoint_times: NDArray[np.float64]
    waypoint_deviation: float
    tool_deviation: float
    tool_rotation: float
    feed_kept: NDArray[np.float64]
    feed_lost: float

    def problems(
        self, *, share: float = 1.001, waypoint: float = 1e-6, tool: float = 5e-6, rotation: float = 20e-6
    ) -> tuple[str, ...]:
        """Return a sentence for whatever is beyond what is allowed; none if all is well.

        Parameters
        ----------
        share : float
            Of a limit.
        waypoint : float
            Distance from waypoints (m, rad).
        tool : float
            Distance from the tool path (m).
        rotation : float
            Angle off the tool path (rad).
        """
        sentences = []
        for order, name in enumerate(_ORDERS):
            for joint in np.flatnonzero(~(self.shares[order] <= share)):
                sentences.append(
                    f"joint {self.joint_names[joint]!r} exceeds its {name} limit by"
                    f" {100 * (self.shares[order, joint] - 1):.3g}% at {self.share_times[order, joint]:.4f} s"
                )
        for step, name, allowed in zip(self.steps, ("position", "velocity", "acceleration"), (1e-8, 1e-7, 1e-5),
                                       strict=True):  # fmt: skip
            if not step <= allowed:
                sentences.append(f"the {name} steps by up to {step:.1e} between two pieces")
        if self.waypoint_deviation > waypoint:
            sentences.append(f"a waypoint is missed by {self.waypoint_deviation:.1e} (m or rad)")
        if self.tool_deviation > tool:
            sentences.append(f"the tool leaves its path by up to {self.tool_deviation * 1e6:.3g} um")
        if self.tool_rotation > rotation:
            sentences.append(f"the tool turns off its path by up to {self.tool_rotation * 1e6:.3g} urad")
        return tuple(sentences)


def verify_trajectory(
    trajectory: Trajectory,
    limits: MotionLimits,
    *,
    path: JointPath | None = None,
    chain: SerialChain | None = None,
    tool_path: ToolPath | None = None,
    feed: float | None = None,
    rotation_error: RotationError | None = None,
) -> TrajectoryReport:
    """Return the figures of a trajectory; see :meth:`qparm.path.Trajectory.verify`.

    Raises
    ------
    InvalidInput
        If the limits or the path are of other joints, or of another number of waypoints.
    """
    n = len(trajectory.joint_names)
    if limits.n != n:
        raise InvalidInput(f"the limits are of {limits.n} joints, the trajectory of {n}")
    shares, times, steps = np.zeros((3, n)), np.zeros((3, n)), np.zeros(3)
    for joint, polynomial in enumerate(trajectory.polynomials):
        shares[:, joint], times[:, joint] = _joint_shares(polynomial, limits.table[:, joint])
        steps = np.maximum(steps, _steps(polynomial))
    missed, off, turned, kept, lost = float("nan"), float("nan"), float("nan"), np.empty(0), float("nan")
    if path is not None:
        if path.joint_names != trajectory.joint_names or len(path.q) != len(trajectory.knots):
            raise InvalidInput("the joint path and the trajectory do not belong together")
        missed = float(np.abs(trajectory(trajectory.knots) - path.q).max())
        if chain is not None and tool_path is not None:
            off, turned, kept, lost = _tool(trajectory, path, chain, tool_path, feed, rotation_error or _angle)
    return TrajectoryReport(
        trajectory.joint_names, shares, times, steps, trajectory.knots, missed, off, turned, kept, lost
    )


def _derivatives_at_looks(nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return matrices (3, 17, k) from a polynomial's values at k nodes to its derivatives at the places."""
    count = len(nodes)
    powers = np.vander(nodes - 0.5, count, increasing=True)
    table = np.zeros((3, len(_LOOKS), count))
    for order in (1, 2, 3):
        for k in range(order, count):
            factor = np.prod(np.arange(k - order + 1, k + 1, dtype=float))
            table[order - 1, :, k] = factor * (_LOOKS - 0.5) ** (k - order)
    return table @ np.linalg.inv(powers)


def _joint_shares(polynomial: PPoly, limits: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the largest shares of one joint's limits, and when."""
    start, h = polynomial.x[:-1], np.diff(polynomial.x)
    places = start[:, None] + h[:, None] * _LOOKS
    q = np.asarray(polynomial(start[:, None] + h[:, None] * _NODES))
    q = q - q[:, :1]
    scale = h[:, None] ** np.arange(1, 4)[:, None, None]
    values = np.abs(np.einsum("opk,mk->omp", _derivatives_at_looks(_NODES), q)) / scale
    # times are rounded too: late on, that moves a position more than its own rounding
    fastest = float(np.abs(polynomial.c[-2]).max()) if len(polynomial.c) > 1 else 0.0
    size = max(float(np.abs(polynomial.c[-1]).max()), 1e-3) + float(polynomial.x[-1]) * fastest
    short = h < np.cbrt(_ROUNDING * size / (_NOISE * limits[2]))
    if short.any():
        inside = start[short, None] + h[short, None] * _FEW
        v, a = (np.asarray(polynomial(inside, order)) for order in (1, 2))
        values[0, short] = np.abs(v).max(axis=1)[:, None]
        values[1, short] = np.abs(a).max(axis=1)[:, None]
        values[2, short] = np.abs((a - a[:, :1]) @ _derivatives_at_looks(_FEW)[0].T) / h[short, None]
        least = h < _LEAST
        values[2, least] = np.abs(np.asarray(polynomial(start[least], 3)))[:, None]
    shares = values.reshape(3, -1) / limits[:, None]
    at = shares.argmax(axis=1)
    return shares[np.arange(3), at], places.ravel()[at]


def _steps(polynomial: PPoly) -> NDArray[np.float64]:
    """Return the largest steps of position, velocity and acceleration where pieces meet."""
    if polynomial.c.shape[1] < 2:
        return np.zeros(3)
    h, steps = np.diff(polynomial.x)[:-1], []
    for order in range(3):
        c = polynomial.derivative(order).c if order else polynomial.c
        left = np.zeros(len(h))
        for row in c[:, :-1]:
            left = left * h + row
        steps.append(float(np.abs(left - c[-1, 1:]).max()))
    return np.array(steps)


def _tool(
    trajectory: Trajectory, path: JointPath, chain: SerialChain, tool_path: ToolPath, feed: float | None,
    rotation_error: RotationError,
) -> tuple[float, float, NDArray[np.float64], float]:  # fmt: skip
    """Return how far the tool is off its path (m, rad), the share of each row at the feed, and the time lost."""
    worst, turned, kept, lost = 0.0, 0.0, [], 0.0
    base = tool_path.pose_base_workpiece
    for index, segment in enumerate(path.segments):
        if segment.kind not in (SegmentKind.ROW, SegmentKind.TRANSITION):
            continue
        knots, parameter = trajectory.knots[segment.first : segment.last + 1], path.parameters[index]
        fine = np.arange(_PLACES_AT_ENDS) / _PLACES_AT_ENDS
        t = np.unique(
            np.concatenate(
                [
                    (knots[:-1, None] + np.diff(knots)[:, None] * np.arange(_PLACES) / _PLACES).ravel(),
                    knots[0] + (knots[1] - knots[0]) * fine,
                    knots[-1] - (knots[-1] - knots[-2]) * fine,
                ]
            )
        )
        poses = chain.forward(trajectory(t))
        p = poses[:, :3, 3]
        s = np.interp(t, knots, parameter)
        if segment.kind is SegmentKind.ROW:
            curve, length = tool_path.rows[segment.row].curve, tool_path.rows[segment.row].length
        else:
            curve, length = tool_path.transitions[segment.row].curve, tool_path.transitions[segment.row].length

        def pose(s: NDArray[np.float64], curve: Callable = curve) -> NDArray[np.float64]:
            return base @ curve(s)

        nominal = pose(_nearest(pose, poses, s, length))
        worst = max(worst, float(np.linalg.norm(p - nominal[:, :3, 3], axis=1).max()))
        turned = max(turned, float(rotation_error(poses[:, :3, :3], nominal[:, :3, :3]).max()))
        if feed is not None and segment.kind is SegmentKind.ROW:
            inside = np.clip(t, knots[0] + _SPEED_TIME, knots[-1] - _SPEED_TIME)
            ahead, behind = (chain.forward(trajectory(inside + d))[:, :3, 3] for d in (_SPEED_TIME, -_SPEED_TIME))
            speed = np.linalg.norm(ahead - behind, axis=1) / (2 * _SPEED_TIME)
            way = np.linalg.norm(np.diff(p, axis=0), axis=1)
            at_feed = np.abs(speed / feed - 1) <= _FEED_KEPT
            kept.append(float(way[at_feed[1:] & at_feed[:-1]].sum() / way.sum()))
            lost += float(knots[-1] - knots[0] - (parameter[-1] - parameter[0]) / feed)
    return worst, turned, np.array(kept), lost if feed is not None else float("nan")


def _nearest(
    pose: Callable[[NDArray[np.float64]], NDArray[np.float64]], poses: NDArray[np.float64], s: NDArray[np.float64],
    length: float,
) -> NDArray[np.float64]:  # fmt: skip
    """Return the parameters at which a curve's point is nearest to those of poses, near given ones.

    Where the curve stands still, as it does where a tool turns on the spot, its rotation decides.
    """
    if not length > 0:
        return np.zeros(len(poses))
    step = 1e-5 * length
    for _ in range(4):
        s = np.clip(s, step, length - step)
        tangent, off = (pose(s + step) - pose(s - step)) / (2 * step), poses - pose(s)
        forward, square = (off[:, :3, 3] * tangent[:, :3, 3]).sum(axis=1), (tangent[:, :3, 3] ** 2).sum(axis=1)
        turning = (tangent[:, :3, :3] ** 2).sum(axis=(1, 2))
        still = square < _STILL * (1.0 + turning)
        forward = np.where(still, (off[:, :3, :3] * tangent[:, :3, :3]).sum(axis=(1, 2)), forward)
        square = np.where(still, np.maximum(turning, _STILL), square)
        s = np.clip(s + forward / square, 0.0, length)
    return s


def _angle(R: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles between rotations (N, 3, 3), exact for small ones too: from their chord."""
    chord = np.linalg.norm(R - other, axis=(1, 2)) / np.sqrt(8.0)
    return 2 * np.arcsin(np.minimum(chord, 1.0))
