"""Serial chains from Denavit-Hartenberg tables, modified (Craig) and standard."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.errors import InvalidInput
from qparm.robot.chain import Joint, JointKind, SerialChain, check_pose

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["DHRow", "chain_from_dh"]

Convention = Literal["modified", "standard"]


@dataclass(frozen=True)
class DHRow:
    """One line of a Denavit-Hartenberg table with the joint's limits, in m and rad.

    ``theta`` is the offset that is added to a revolute joint's variable, ``d`` the one that is added to
    a prismatic joint's; the other of the two is the constant of the table.

    In the modified convention ``alpha`` and ``a`` are those of the link *before* the joint
    (alpha_{i-1}, a_{i-1}), in the standard convention those of the link after it.
    """

    name: str
    kind: JointKind
    alpha: float
    a: float
    d: float
    theta: float
    position: tuple[float, float]
    velocity: float
    acceleration: float
    jerk: float


def rotation_x(angle: float) -> NDArray[np.float64]:
    """Return the (4, 4) rotation about x. Exact for multiples of a right angle."""
    c, s = _cos_sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], dtype=float)


def rotation_z(angle: float) -> NDArray[np.float64]:
    """Return the (4, 4) rotation about z. Exact for multiples of a right angle."""
    c, s = _cos_sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=float)


def translation(x: float, y: float, z: float) -> NDArray[np.float64]:
    """Return the (4, 4) translation."""
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def _cos_sin(angle: float) -> tuple[float, float]:
    # cos(pi/2) is 6e-17 in floating point; tables are full of right angles, and a zero should be a zero
    quarter_turns = angle / (math.pi / 2)
    if abs(quarter_turns - round(quarter_turns)) < 1e-12:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarter_turns) % 4]
    return math.cos(angle), math.sin(angle)


def chain_from_dh(
    rows: Sequence[DHRow],
    *,
    convention: Convention,
    name: str = "arm",
    transform_base: ArrayLike | None = None,
    transform_tool: ArrayLike | None = None,
    characteristic_length: float = 0.4,
) -> SerialChain:
    """Return the chain that a Denavit-Hartenberg table describes.

    Parameters
    ----------
    rows : sequence of DHRow
        One line per joint, from the base to the tool.
    convention : {"modified", "standard"}
        Modified (Craig): ``T_i = Rx(alpha) Tx(a) Rz(theta) Tz(d)``; standard:
        ``T_i = Rz(theta) Tz(d) Tx(a) Rx(alpha)``.
        There is no default: the same numbers describe two different arms.
    name : str
    transform_base, transform_tool : (4, 4) array_like, optional
        Where the table's first frame stands, and the tool in the table's last frame; identity by default.
    characteristic_length : float
        See :class:`SerialChain`.

    Returns
    -------
    SerialChain

    Raises
    ------
    InvalidInput
        If the convention is unknown or a limit is not usable.
    """
    base = np.eye(4) if transform_base is None else check_pose(transform_base, what="transform_base")
    tool = np.eye(4) if transform_tool is None else check_pose(transform_tool, what="transform_tool")
    if convention not in ("modified", "standard"):
        raise InvalidInput(f"DH convention must be 'modified' or 'standard', not {convention!r}")
    joints = []
    after_previous = np.eye(4)
    for row in rows:
        for entry in ("alpha", "a", "d", "theta"):
            if not math.isfinite(getattr(row, entry)):
                raise InvalidInput(f"joint {row.name!r}: {entry} must be finite, not {getattr(row, entry)}")
        # Rz(theta) and Tz(d) commute, so the table's constants go in front of the joint's own motion
        constant = rotation_z(row.theta) @ translation(0, 0, row.d)
        link = rotation_x(row.alpha) @ translation(row.a, 0, 0)
        if convention == "modified":
            before_joint, after_joint = link @ constant, np.eye(4)
        else:
            before_joint, after_joint = constant, link
        joints.append(
            Joint(
                name=row.name,
                kind=row.kind,
                transform_previous_joint=after_previous @ before_joint,
                position=row.position,
                velocity=row.velocity,
                acceleration=row.acceleration,
                jerk=row.jerk,
            )
        )
        after_previous = after_joint
    return SerialChain(
        name=name,
        joints=tuple(joints),
        transform_base=base,
        transform_tool=after_previous @ tool,
        characteristic_length=characteristic_length,
    )
