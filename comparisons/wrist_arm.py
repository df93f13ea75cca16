"""Whether the reference arm reaches a pose, by its own geometry: no Jacobian, no iteration from configurations.

Axes 2, 3, 4 meet in the shoulder on its rail, axes 6, 7, 8 in the wrist. For a pose the wrist is known; rail position
and arm angle (of the elbow about the line from shoulder to wrist) then give theta3, theta5 and theta7 up to sign. A
pose is out of reach if no pair of the two keeps all three within their limits, which are symmetric. That the other
four, limited to 170 and 175 deg, must also hold makes this a necessary condition.
"""

from __future__ import annotations

import numpy as np

import qparm

__all__ = ["best_margin"]

_RAILS, _ANGLES = 201, 120
_ZOOMS = 6


def best_margin(cell: qparm.Cell, pose: np.ndarray) -> float:
    """Return the largest margin of theta3, theta5 and theta7 over rail position and arm angle; negative: out of reach.

    Parameters
    ----------
    cell : Cell
        The reference cell, with any lengths.
    pose : (4, 4) ndarray

    Returns
    -------
    float
        The least over the joints of cos(angle) - cos(limit); -inf where no rail position lets the elbow close.
    """
    L1, L2, L3, L4 = (cell.arm.lengths[name] for name in ("L1", "L2", "L3", "L4"))
    joints = cell.chain().joints
    low, high = joints[0].position
    least = [float(np.cos(joints[i].position[1])) for i in (2, 4, 6)]
    wrist, tool_z = pose[:3, 3] - L4 * pose[:3, 2], pose[:3, 2]

    def margins(rail: np.ndarray, angle: np.ndarray) -> np.ndarray:
        v = wrist - np.column_stack([0 * rail, rail, 0 * rail + L1])
        distance = np.linalg.norm(v, axis=1)
        elbow = (distance**2 - L2**2 - L3**2) / (2 * L2 * L3)
        u = v / distance[:, None]
        along = (distance**2 + L2**2 - L3**2) / (2 * distance * L2)
        across = np.sqrt(np.maximum(1 - along**2, 0))
        first = np.cross(u, np.where(np.abs(u[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]]))
        first /= np.linalg.norm(first, axis=1)[:, None]
        second = np.cross(u, first)
        turned = first[:, None] * np.cos(angle)[:, None] + second[:, None] * np.sin(angle)[:, None]
        upper = along[:, None, None] * u[:, None] + across[:, None, None] * turned
        forearm = (v[:, None] - L2 * upper) / L3
        margin = np.minimum(upper[..., 2] - least[0], forearm @ tool_z - least[2])
        margin = np.minimum(margin, (elbow - least[1])[:, None])
        return np.where((elbow <= 1)[:, None], margin, -np.inf)

    # where the elbow just closes, stretched: a sliver of the rail may fall between the values of a grid
    off_rail = np.hypot(wrist[0], wrist[2] - L1)
    half = np.sqrt(max((L2 + L3) ** 2 - off_rail**2, 0.0)) * (1 - 1e-12)
    ends = np.clip([wrist[1] - half, wrist[1] + half, low, high], low, high)
    rails = np.concatenate([np.linspace(low, high, _RAILS), np.linspace(ends[0], ends[1], _RAILS), ends])
    angles = np.linspace(-np.pi, np.pi, _ANGLES, endpoint=False)
    rail_step, angle_step = (high - low) / _RAILS, 2 * np.pi / _ANGLES
    best = -np.inf
    for _ in range(_ZOOMS):
        found = margins(rails, angles)
        i, j = np.unravel_index(found.argmax(), found.shape)
        if found[i, j] == -np.inf:
            break
        best = max(best, float(found[i, j]))
        rails = np.clip(rails[i] + rail_step * np.linspace(-1, 1, 41), low, high)
        angles = angles[j] + angle_step * np.linspace(-1, 1, 41)
        rail_step, angle_step = rail_step / 20, angle_step / 20
    return best
