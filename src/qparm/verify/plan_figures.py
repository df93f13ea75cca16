"""Quality figures of a joint path and its trajectory: every one from plain tables and the cell alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput
from qparm.verify.between import measure_between
from qparm.verify.clearance import measure_clearance
from qparm.verify.figures import Figures, JointFigures, Jump, Unreached
from qparm.verify.interpolate import derivative_peaks, position_extremes, positions_at
from qparm.verify.kinematics import joint_transforms, scaled_singular_values, tool_rotation_error
from qparm.verify.row_feed import measure_row_feed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.files import KnotTable, SampleTable, WaypointTable

__all__ = ["measure"]

# The rule h/2 (v0 + v1) - h^2/12 (a1 - a0) integrates a velocity whose second derivative is at most J
# to within this times h^3 J (the integral of |1/12 - x (1 - x) / 2| over [0, 1] is 0.0321).
_INTEGRATION = 0.0321
# A knot passes a waypoint that it is this close to (m, rad): Ruckig ends its profiles within 1e-8.
_PASSED = 1e-6
# Of two knots that pass it, the later one is nearer only if it is by this much: where the arm rests both do.
_NEARER = 1e-10
_ENDS = 1e-3
# Velocities below this share of their limits are rest.
_REST = 1e-6
# Places between two points of a row at which the tool is looked at.
_PLACES = 32


def measure(cell: Cell, waypoints: WaypointTable, samples: SampleTable, knots: KnotTable) -> Figures:
    """Return the figures of a joint path and its trajectory.

    Parameters
    ----------
    cell : Cell
    waypoints, samples, knots
        As :mod:`qparm.verify.files` reads them.

    Returns
    -------
    Figures

    Raises
    ------
    InvalidInput
        If the tables do not belong to the cell's arm, or to each other.
    """
    names = tuple(joint.name for joint in cell.arm.joints)
    for what, table in (("joint path", waypoints), ("trajectory", samples), ("knots", knots)):
        if table.joints != names:
            raise InvalidInput(f"the {what} is of the joints {', '.join(table.joints)}, the cell of {', '.join(names)}")
    if len(knots.t) < len(waypoints.q):
        raise InvalidInput(f"{len(waypoints.q)} waypoints but {len(knots.t)} knots: the files do not belong together")
    if np.abs(knots.derivatives[0, [0, -1]] - waypoints.q[[0, -1]]).max() > _ENDS:
        raise InvalidInput("the joint path and the trajectory do not begin and end alike: one of them is cut short")
    if (np.diff(knots.t) <= 0).any():
        raise InvalidInput(f"knot {int(np.flatnonzero(np.diff(knots.t) <= 0)[0]) + 1} is not later than the one before")
    # nanoseconds in one file, twelve digits in the other
    if samples.t[0] != 0 or abs(samples.t[-1] - knots.t[-1]) > 1e-6:
        raise InvalidInput(
            f"the samples run from {samples.t[0]:.6f} to {samples.t[-1]:.6f} s, the knots to {knots.t[-1]:.6f} s:"
            " the trajectory is cut short"
        )
    tool_path = cell.tool_path()
    poses, axes = joint_transforms(cell, waypoints.q)
    at = np.flatnonzero((waypoints.kind == "row") & (waypoints.index >= 0))
    index = waypoints.index[at]
    if len(index) and (index.min() < 0 or index.max() >= tool_path.point_count or (np.diff(index) <= 0).any()):
        raise InvalidInput("the row waypoints of the joint path are not ascending points of the cell's raster")
    sigma = scaled_singular_values(cell, poses[at], axes[at])
    targets = tool_path.poses[index]
    position = np.linalg.norm(poses[at, :3, 3] - targets[:, :3, 3], axis=-1)
    rotation = tool_rotation_error(cell, poses[at, :3, :3], targets[:, :3, :3])
    good = (position <= cell.process.position_tolerance) & (rotation <= cell.process.rotation_tolerance)
    unreached = [Unreached(int(k), int(tool_path.row_of_point[k]), "no waypoint")
                 for k in np.setdiff1d(np.arange(tool_path.point_count), index)]  # fmt: skip
    unreached += [Unreached(int(k), int(tool_path.row_of_point[k]), "beyond tolerance") for k in index[~good]]

    jumps, reconfigurations, faster, steps = _steps(cell, waypoints, names)
    lower, upper, limits = _limits(cell)
    derivatives = samples.derivatives
    shares = np.maximum(derivative_peaks(knots), np.abs(derivatives[1:]).max(axis=1)) / limits
    passed, waypoint_deviation = _passed(waypoints.q, knots)
    surface_deviation, speed_max, speed_mean = _on_rows(cell, waypoints, knots, passed)
    inside_waypoints = np.minimum(waypoints.q - lower, upper - waypoints.q).min(axis=0)
    inside_samples = np.minimum(derivatives[0] - lower, upper - derivatives[0]).min(axis=0)
    least, largest = position_extremes(knots)
    inside_samples = np.minimum(inside_samples, np.minimum(least - lower, upper - largest))
    revolute = np.array([joint.type == "revolute" for joint in cell.arm.joints])
    rests = _at_rest(knots, passed, limits)
    return Figures(
        points=tool_path.point_count,
        reached=int(good.sum()),
        unreached=tuple(sorted(unreached, key=lambda point: point.index)),
        position_error_max=_max(position),
        position_error_mean=float(position.mean()) if len(position) else float("nan"),
        rotation_error_max=_max(rotation),
        rotation_error_mean=float(rotation.mean()) if len(rotation) else float("nan"),
        jumps=jumps,
        reconfigurations=reconfigurations,
        faster_than_feed=faster,
        largest_step_revolute=float(steps[revolute].max(initial=0.0)),
        largest_step_prismatic=float(steps[~revolute].max(initial=0.0)),
        singular_value_min=float(sigma.min()) if len(sigma) else float("nan"),
        singular_value_index=int(index[sigma.argmin()]) if len(sigma) else -1,
        joints=tuple(
            JointFigures(
                name=name,
                unit="rad" if revolute[i] else "m",
                largest_step=float(steps[i]),
                limit_distance_waypoints=float(inside_waypoints[i]),
                limit_distance_trajectory=float(inside_samples[i]),
                velocity_share=float(shares[0, i]),
                acceleration_share=float(shares[1, i]),
                jerk_share=float(shares[2, i]),
            )
            for i, name in enumerate(names)
        ),
        duration=float(samples.t[-1]),
        waypoint_deviation=waypoint_deviation,
        sample_deviation=float(np.abs(positions_at(knots, samples.t) - derivatives[0]).max()),
        surface_deviation=surface_deviation,
        tool_speed_max=speed_max,
        tool_speed_mean=speed_mean,
        columns_consistent=_consistent(samples, limits),
        between=measure_between(cell, waypoints, tool_path, rests=rests),
        clearance=measure_clearance(cell, waypoints, knots, knots.t[passed]),
        feed=measure_row_feed(cell, tool_path, waypoints, knots, passed, limits, rests),
    )


def _max(values: NDArray[np.float64]) -> float:
    return float(values.max()) if len(values) else float("nan")


def _limits(cell: Cell) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    joints = cell.arm.joints
    lower, upper = (np.array([joint.position[k] for joint in joints]) for k in (0, 1))
    return (
        lower,
        upper,
        np.array([[getattr(j, key) for j in joints] for key in ("velocity", "acceleration", "jerk")]),
    )


def _steps(
    cell: Cell, waypoints: WaypointTable, names: tuple[str, ...]
) -> tuple[tuple[Jump, ...], tuple[Jump, ...], int, NDArray[np.float64]]:
    """Return jumps and reconfigurations, the steps too fast for the feed, and the largest in-row step of each joint.

    A step is that from one point to the next, via poses of a transition included; home is left out. Where the
    file has a motion between the two, the step is a reconfiguration, else it is taken as it stands.
    """
    tool_path, criterion = cell.tool_path(), cell.jump()
    moving = waypoints.kind == "break"
    away = np.flatnonzero((waypoints.row >= 0) & ~moving & ((waypoints.kind != "row") | (waypoints.index >= 0)))
    if len(away) < 2:
        return (), (), 0, np.zeros(len(names))
    passed = np.cumsum(moving)
    moved = passed[away[1:]] > passed[away[:-1]]
    index, row, on_row = waypoints.index[away], waypoints.row[away], waypoints.kind[away] == "row"
    step = np.abs(np.diff(waypoints.q[away], axis=0))
    both = on_row[1:] & on_row[:-1]
    neighbours = both & (np.diff(index) == 1)
    in_row = neighbours & (row[1:] == row[:-1])
    # both points of one self-motion area: there the arm may reconfigure as it may between the rows
    area = tool_path.in_self_motion_area[index]
    in_area = in_row & area[1:] & area[:-1]
    ratio = step / criterion
    # a via pose has no index of its own: the points at either side of it stand for it
    points = np.where(on_row, index, -1)
    before = np.maximum.accumulate(points)
    after = np.minimum.accumulate(np.where(points < 0, tool_path.point_count, points)[::-1])[::-1]
    jumps, reconfigurations = [], []
    for k in np.flatnonzero((ratio > 1).any(axis=1) | moved):
        joint = int(ratio[k].argmax())
        first, last = int(before[k]), int(after[k + 1])
        (reconfigurations if moved[k] else jumps).append(
            Jump(
                first=first,
                last=last,
                row=int(tool_path.row_of_point[first]),
                row_last=int(tool_path.row_of_point[min(last, tool_path.point_count - 1)]),
                joint=names[joint],
                step=float(step[k, joint]),
                ratio=float(ratio[k, joint]),
                place="gap" if both[k] and not neighbours[k] else "row" if in_row[k] and not in_area[k] else "row end",
            )
        )
    in_row &= ~moved
    at = index[:-1][in_row]
    seconds = np.abs(tool_path.s[at + 1] - tool_path.s[at]) / cell.process.feed
    _, _, limits = _limits(cell)
    faster = (step[in_row] / limits[0] > seconds[:, None]).any(axis=1)
    largest = step[in_row].max(axis=0, initial=0.0) if in_row.any() else np.zeros(len(names))
    return tuple(jumps), tuple(reconfigurations), int(faster.sum()), largest


def _passed(q: NDArray[np.float64], knots: KnotTable) -> tuple[NDArray[np.int64], float]:
    """Return for each waypoint, in order, the first knot that passes it, and the largest deviation there."""
    passed, worst, first = np.empty(len(q), dtype=np.int64), 0.0, 0
    for k, waypoint in enumerate(q):
        # the waypoints that follow need knots too
        last = len(knots.t) - (len(q) - k) + 1
        window, deviation = first, np.inf
        best = first
        while window < last and deviation > _PASSED:
            part = knots.derivatives[0, window : min(window + 64, last)]
            off = np.abs(part - waypoint).max(axis=1)
            near = np.flatnonzero(off <= _PASSED)
            candidate = int(near[0]) if len(near) else int(off.argmin())
            if off[candidate] < deviation:
                best, deviation = window + candidate, float(off[candidate])
            window += 64
        while best + 1 < last:  # the first that is near may have a nearer one behind it
            closer = float(np.abs(knots.derivatives[0, best + 1] - waypoint).max())
            if closer > deviation - _NEARER:
                break
            best, deviation = best + 1, closer
        passed[k], worst, first = best, max(worst, deviation), best + 1
    return passed, worst


def _at_rest(knots: KnotTable, passed: NDArray[np.int64], limits: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return at which waypoints the arm rests."""
    return (np.abs(knots.derivatives[1, passed]) < _REST * limits[0]).all(axis=1)


def _on_rows(
    cell: Cell, waypoints: WaypointTable, knots: KnotTable, passed: NDArray[np.int64]
) -> tuple[float, float, float]:
    """Return the tool's largest distance from its surface and its largest and mean speed, between points of rows."""
    on_row = waypoints.kind == "row"
    rows = on_row[1:] & on_row[:-1] & (np.diff(waypoints.row) == 0)
    # what the planner calls a break is no process, though its ends are neighbours
    rows &= waypoints.status[1:] == "reached"
    if not rows.any():
        return float("nan"), float("nan"), float("nan")
    start, end = knots.t[passed[:-1][rows]], knots.t[passed[1:][rows]]
    t = start[:, None] + (end - start)[:, None] * np.linspace(0.0, 1.0, _PLACES + 1)
    poses, _ = joint_transforms(cell, positions_at(knots, t.ravel()))
    p = poses[:, :3, 3].reshape(*t.shape, 3)
    way = np.linalg.norm(np.diff(p, axis=1), axis=2)
    speed = way / np.diff(t, axis=1)
    distance = cell.distance()
    off = float("nan")
    if distance is not None:
        off = float(np.abs(distance(p) - cell.process.stand_off).max())
    return off, float(speed.max()), float(way.sum() / (end - start).sum())


def _consistent(samples: SampleTable, limits: NDArray[np.float64]) -> bool:
    """Return whether position, velocity and acceleration integrate each other as far as jerk limits tell."""
    t, (q, v, a, j) = samples.t, samples.derivatives
    if len(t) < 2:
        return True
    h = np.diff(t)[:, None]
    if (h <= 0).any():
        return False
    J = np.maximum(limits[2], np.abs(j).max(axis=0))
    rounding = 1e-9
    q_error = np.abs(np.diff(q, axis=0) - 0.5 * h * (v[:-1] + v[1:]) + h**2 / 12 * np.diff(a, axis=0))
    v_error = np.abs(np.diff(v, axis=0) - 0.5 * h * (a[:-1] + a[1:]))
    a_error = np.abs(np.diff(a, axis=0))
    return bool(
        (q_error <= _INTEGRATION * h**3 * J * 1.01 + rounding).all()
        and (v_error <= 0.25 * h**2 * J * 1.01 + rounding).all()
        and (a_error <= h * J * 1.01 + rounding).all()
    )
