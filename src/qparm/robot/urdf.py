"""Serial chains from URDF: the joints between a base link and a tip link, and nothing else of the file.

Meshes, inertias, transmissions, safety controllers and joints off the way from base to tip are not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from qparm.errors import InvalidInput
from qparm.robot.chain import CONTINUOUS_RANGE, Joint, JointKind, SerialChain, check_pose
from qparm.robot.dh import rotation_x, rotation_z, translation
from qparm.robot.urdf_tree import JointElement, joints_between, urdf_text

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["JointLimits", "chain_from_urdf"]

LimitName = Literal["velocity", "acceleration", "jerk"]


@dataclass(frozen=True)
class JointLimits:
    """Limits that a URDF does not know, or that take the place of its own; None leaves them to the next in line.

    Attributes
    ----------
    position : tuple of float, optional
        m or rad; a continuous joint that is given some is no longer continuous.
    velocity, acceleration, jerk : float, optional
        Symmetric, per second, second squared and cubed.
    """

    position: tuple[float, float] | None = None
    velocity: float | None = None
    acceleration: float | None = None
    jerk: float | None = None


def chain_from_urdf(
    source: str | Path,
    *,
    base: str,
    tip: str,
    revolute: JointLimits | None = None,
    prismatic: JointLimits | None = None,
    joints: Mapping[str, JointLimits] | None = None,
    name: str | None = None,
    transform_base: ArrayLike | None = None,
    transform_tool: ArrayLike | None = None,
    characteristic_length: float = 0.4,
) -> SerialChain:
    """Return the chain from one link of a URDF to another.

    Fixed joints are merged, and every moving joint's frame is turned so that its axis is z. A URDF has no limits
    of acceleration and jerk: they are given here, for all joints of a kind or for single ones.

    Parameters
    ----------
    source : str or Path
        A file, or the text itself (it begins with ``<``).
    base, tip : str
        Links; the tip stands farther from the root than the base.
    revolute, prismatic : JointLimits, optional
        For all joints of the kind (continuous ones are revolute).
    joints : mapping of str to JointLimits, optional
        For single joints, by name. First comes what stands here, then what stands for the kind, then the file.
    name : str, optional
        The robot's name by default.
    transform_base, transform_tool : (4, 4) array_like, optional
        Where the base link stands in the base frame, and the tool in the tip link's frame; identity by default.
    characteristic_length : float
        See :class:`SerialChain`.

    Returns
    -------
    SerialChain

    Raises
    ------
    InvalidInput
        If the file cannot be read or is no URDF; if the links are not there or the tip does not hang on the base;
        if a joint between them floats, is planar, mimics another, or has no usable origin, axis or limits. The
        sentence names the joint or the link.
    """
    given = dict(joints or {})
    of_kind: dict[str, JointLimits] = {
        "revolute": revolute or JointLimits(),
        "prismatic": prismatic or JointLimits(),
    }
    robot, elements = joints_between(urdf_text(source), base, tip)
    moving = [element.name for element in elements if element.type != "fixed"]
    if not moving:
        raise InvalidInput(f"no joint moves between link {base!r} and link {tip!r}")
    for unknown in sorted(set(given) - set(moving)):
        raise InvalidInput(
            f"limits are given for joint {unknown!r}, which does not move between link {base!r} and"
            f" link {tip!r}; the joints there are {', '.join(moving)}"
        )
    _require_given(elements, given, of_kind)
    made: list[Joint] = []
    since_joint = np.eye(4)
    for element in elements:
        since_joint = since_joint @ _origin(element)
        if element.type == "fixed":
            continue
        kind: JointKind = "prismatic" if element.type == "prismatic" else "revolute"
        turn = _turn_z_to(_axis(element))
        sources = (given.get(element.name, JointLimits()), of_kind[kind])
        position = next((limits.position for limits in sources if limits.position is not None), None)
        continuous = element.type == "continuous" and position is None
        if position is None:
            position = CONTINUOUS_RANGE if continuous else _range(element)
        made.append(
            Joint(
                name=element.name,
                kind=kind,
                transform_previous_joint=since_joint @ turn,
                position=position,
                velocity=_first(element, "velocity", sources),
                acceleration=_first(element, "acceleration", sources),
                jerk=_first(element, "jerk", sources),
                continuous=continuous,
            )
        )
        since_joint = turn.T
    tool = np.eye(4) if transform_tool is None else check_pose(transform_tool, what="transform_tool")
    return SerialChain(
        name=name or robot,
        joints=tuple(made),
        transform_base=np.eye(4) if transform_base is None else check_pose(transform_base, what="transform_base"),
        transform_tool=since_joint @ tool,
        characteristic_length=characteristic_length,
    )


def _origin(element: JointElement) -> NDArray[np.float64]:
    """Return the transform from the parent link to the joint's frame: turned about fixed x, then y, then z."""
    roll, pitch, yaw = element.numbers("origin", "rpy", (0.0, 0.0, 0.0))
    about_y = rotation_x(-math.pi / 2) @ rotation_z(pitch) @ rotation_x(math.pi / 2)
    x, y, z = element.numbers("origin", "xyz", (0.0, 0.0, 0.0))
    return translation(x, y, z) @ rotation_z(yaw) @ about_y @ rotation_x(roll)


def _axis(element: JointElement) -> NDArray[np.float64]:
    axis = np.array(element.numbers("axis", "xyz", (1.0, 0.0, 0.0)))
    length = np.linalg.norm(axis)
    if not length > 1e-9:
        raise InvalidInput(f"joint {element.name!r}: its axis has no direction")
    return axis / length


def _turn_z_to(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (4, 4) rotation that takes z to a unit axis by the shortest way; exact for axes of the frame."""
    x, y, z = axis.tolist()
    if z < -1.0 + 1e-12:
        return rotation_x(math.pi)
    # the columns are Rodrigues' formula for the axis z x axis
    T = np.eye(4)
    T[:3, 0] = 1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), -x
    T[:3, 1] = -x * y / (1.0 + z), 1.0 - y * y / (1.0 + z), -y
    T[:3, 2] = x, y, z
    return T


def _range(element: JointElement) -> tuple[float, float]:
    if not element.has("limit", "lower") and not element.has("limit", "upper"):
        raise InvalidInput(f"joint {element.name!r} ({element.type}) has no position limits")
    (lower,), (upper,) = element.numbers("limit", "lower", (0.0,)), element.numbers("limit", "upper", (0.0,))
    if not lower < upper:
        raise InvalidInput(
            f"joint {element.name!r}: its position limits are reversed or equal: {lower:g} to {upper:g} (SI)"
        )
    return lower, upper


def _require_given(
    elements: tuple[JointElement, ...], given: Mapping[str, JointLimits], of_kind: Mapping[str, JointLimits]
) -> None:
    """Refuse joints without limits that no URDF has: all that are missing, and what gives them."""
    missing: dict[tuple[str, LimitName], list[str]] = {}
    for element in elements:
        if element.type == "fixed":
            continue
        kind = "prismatic" if element.type == "prismatic" else "revolute"
        own = given.get(element.name, JointLimits())
        limits: tuple[LimitName, ...] = ("acceleration", "jerk")
        for limit in limits:
            if getattr(own, limit) is None and getattr(of_kind[kind], limit) is None:
                missing.setdefault((kind, limit), []).append(element.name)
    if not missing:
        return
    names = next(iter(missing.values()))
    what = " and ".join(dict.fromkeys(limit for _, limit in missing))
    keys = ", ".join(f"arm.limits.{kind}.{limit}" for kind, limit in missing)
    raise InvalidInput(
        f"joint {names[0]!r}: a URDF has no limit of {what}; it must be given beside it: {keys} for all joints of the"
        " kind, or arm.limits.joints for single ones"
    )


def _first(element: JointElement, limit: LimitName, sources: tuple[JointLimits, ...]) -> float:
    for limits in sources:
        value = getattr(limits, limit)
        if value is not None:
            return value
    if not element.has("limit", "velocity"):
        raise InvalidInput(f"joint {element.name!r} has no velocity limit, and none is given beside the URDF")
    (value,) = element.numbers("limit", "velocity", (0.0,))
    if not value > 0:
        raise InvalidInput(f"joint {element.name!r}: its velocity limit must be greater than zero, not {value:g}")
    return value
