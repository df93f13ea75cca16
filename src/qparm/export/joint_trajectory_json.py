"""The trajectory with the fields of ROS ``trajectory_msgs/JointTrajectory``, as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from qparm.export.sampled import SampledTrajectory
    from qparm.path import Trajectory

__all__ = ["joint_trajectory_message", "write_joint_trajectory_json", "write_json"]


def joint_trajectory_message(
    trajectory: Trajectory, *, times: NDArray[np.float64] | None = None, executable: bool = True
) -> dict[str, Any]:
    """Return the message as plain data.

    Parameters
    ----------
    trajectory : Trajectory
    times : (T,) ndarray, optional
        Of the points (s); by default the boundaries of its polynomials.
    executable : bool
        The report's verdict. A trajectory that must not be executed carries one more key, ``"executable": false``:
        a reader that takes the message's fields strictly refuses it, as it should.
    """
    times = trajectory.boundaries if times is None else times
    orders = [trajectory(times, order).tolist() for order in range(3)]
    message: dict[str, Any] = {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""},
        "joint_names": list(trajectory.joint_names),
        "points": [
            {
                "positions": position,
                "velocities": velocity,
                "accelerations": acceleration,
                "effort": [],
                "time_from_start": _duration(t),
            }
            for t, position, velocity, acceleration in zip(times.tolist(), *orders, strict=True)
        ],
    }
    if not (executable and trajectory.executable):
        message["executable"] = False
    return message


def write_json(sampled: SampledTrajectory, file: Path) -> None:
    """Write the message; numbers read back to the same bits, times to the nanosecond."""
    _write(joint_trajectory_message(sampled.trajectory, times=sampled.t), file)


def write_joint_trajectory_json(trajectory: Trajectory, file: Path, *, executable: bool = True) -> None:
    """Write the message at the trajectory's boundaries, with the verdict of a report."""
    _write(joint_trajectory_message(trajectory, executable=executable), file)


def _write(message: dict[str, Any], file: Path) -> None:
    file.write_text(json.dumps(message, allow_nan=False) + "\n", encoding="utf-8")


def _duration(t: float) -> dict[str, int]:
    # in whole nanoseconds first, so that x.9999999996 s carries into the seconds
    sec, nanosec = divmod(round(t * 1e9), 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}
