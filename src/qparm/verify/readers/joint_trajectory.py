"""The fields of ROS ``trajectory_msgs/JointTrajectory`` as plain data: what JSON, YAML and the bags have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qparm.errors import InvalidInput
from qparm.files.reading import shown_value
from qparm.verify.motion import TIME_ROUNDING
from qparm.verify.readers.table import motion_table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.cell import Cell
    from qparm.verify.motion import MotionTable

__all__ = ["MESSAGE_TYPE", "fields", "only_message", "read_message"]

MESSAGE_TYPE = "trajectory_msgs/msg/JointTrajectory"

# What messages that hold a JointTrajectory call it, and how deep it may lie in them.
_WRAPPERS, _DEEPEST = ("goal", "trajectory", "joint_trajectory", "solution", "planned_trajectory"), 6
_ORDERS = ("positions", "velocities", "accelerations")
# How a topic ends to which no controller listens.
_NOT_EXECUTABLE = "_not_executable"


def only_message(file: Path, messages: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of the one JointTrajectory of a bag, or raise InvalidInput if there is none, or more.

    Parameters
    ----------
    file : Path
    messages : sequence of (str, message)
        With the topic of each, whose name says if it must not be executed.
    """
    if len(messages) != 1:
        raise InvalidInput(f"{file.name} must hold one {MESSAGE_TYPE}; it holds {len(messages) or 'none'}")
    topic, message = messages[0]
    return fields(message) | ({"executable": False} if topic.endswith(_NOT_EXECUTABLE) else {})


def fields(message: Any) -> dict[str, Any]:
    """Return a decoded message, an object with attributes, as plain data."""
    return {
        "joint_names": list(message.joint_names),
        "points": [
            {field: [float(x) for x in getattr(point, field)] for field in _ORDERS}
            | {"time_from_start": {"sec": point.time_from_start.sec, "nanosec": point.time_from_start.nanosec}}
            for point in message.points
        ],
    }


def read_message(
    file: Path,
    cell: Cell,
    message: Any,
    *,
    format: str,
    rounding: Callable[[NDArray[np.float64]], NDArray[np.float64]] = lambda q: np.zeros(q.shape[1]),
) -> MotionTable:
    """Return the motion of a message.

    Parameters
    ----------
    file : Path
        Named in errors.
    cell : Cell
    message : mapping
        With ``joint_names`` and ``points``; or a RobotTrajectory or an action's goal that holds one.
    format : str
    rounding : callable
        How far the positions (T, n) may be from those written; by default they are exact.

    Raises
    ------
    InvalidInput
        With the point, the field and the joint that are wrong.
    """
    message = _unwrapped(file, message)
    if not isinstance(message, Mapping):
        raise InvalidInput(f"{file.name} is not a JointTrajectory: it holds no fields")
    for field in ("joint_names", "points"):
        if not _is_list(message.get(field)):
            raise InvalidInput(f"{file.name} is not a JointTrajectory: it has no list {field!r}")
    joints = _joints(file, message["joint_names"])
    points = message["points"]
    if not points:
        raise InvalidInput(f"{file.name} holds no point; it may be cut short")
    t = np.array([_time(file, k, point) for k, point in enumerate(points)])
    derivatives: list[NDArray[np.float64] | None] = []
    for field in _ORDERS:
        # ROS leaves a list empty where an order is not given
        for k, point in enumerate(points):
            if point.get(field) is not None and not _is_list(point[field]):
                raise InvalidInput(f"{file.name}: point {k}: {field} must be a list, not {shown_value(point[field])}")
        given = [bool(point.get(field)) for point in points]
        if not any(given):
            if field == _ORDERS[0]:
                raise InvalidInput(f"{file.name}: the points have no positions")
            derivatives.append(None)
            continue
        if not all(given):
            raise InvalidInput(f"{file.name}: point {given.index(False)} has no {field}, though others have")
        derivatives.append(np.array([_values(file, k, field, point[field], joints) for k, point in enumerate(points)]))
    q = derivatives[0]
    assert q is not None
    return motion_table(
        file,
        cell,
        format=format,
        joints=joints,
        t=t,
        derivatives=derivatives,
        position_rounding=lambda: rounding(q),
        time_rounding=TIME_ROUNDING,
        place=lambda k: f"point {k}",
        executable=message.get("executable", True) is True,
    )


def _unwrapped(file: Path, message: Any) -> Any:
    """Return the JointTrajectory inside a RobotTrajectory, or inside the goal of an action."""
    executable, inside = True, False
    for _ in range(_DEEPEST):
        if isinstance(message, (list, tuple)) and len(message) == 1 and inside:
            message = message[0]
        if not isinstance(message, Mapping) or "points" in message or "joint_names" in message:
            break
        multi = message.get("multi_dof_joint_trajectory")
        if isinstance(multi, Mapping) and multi.get("points"):
            raise InvalidInput(f"{file.name} moves joints of several degrees of freedom, which the arm has not")
        wrapper = next((name for name in _WRAPPERS if name in message), None)
        if wrapper is None:
            break
        # whichever of them says no
        executable = executable and message.get("executable", True) is True
        message, inside = message[wrapper], True
    return message if executable or not isinstance(message, Mapping) else {**message, "executable": False}


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray))


def _joints(file: Path, names: Sequence[Any]) -> list[str]:
    for k, name in enumerate(names):
        if not isinstance(name, str):
            raise InvalidInput(f"{file.name}: name {k} of joint_names is {shown_value(name)}, which is no text")
    return list(names)


def _time(file: Path, k: int, point: Any) -> float:
    try:
        duration = point["time_from_start"]
        # ROS 1 calls them secs and nsecs
        sec = duration["sec"] if "sec" in duration else duration["secs"]
        nanosec = duration["nanosec"] if "nanosec" in duration else duration["nsecs"]
        if isinstance(sec, bool) or isinstance(nanosec, bool):
            raise TypeError
        return float(sec) + 1e-9 * float(nanosec)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        raise InvalidInput(f"{file.name}: point {k} has no time_from_start with sec and nanosec") from None


def _values(file: Path, k: int, field: str, values: Sequence[Any], joints: Sequence[str]) -> list[float]:
    if len(values) != len(joints):
        raise InvalidInput(f"{file.name}: point {k} has {len(values)} {field} for {len(joints)} joints")
    row: list[float] = []
    for joint, value in zip(joints, values, strict=True):
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InvalidInput(
                f"{file.name}: point {k}, {field} of joint {joint!r}: {shown_value(value)} is not a number"
            )
        try:
            row.append(float(value))
        except OverflowError:
            row.append(float("inf"))
    return row
