"""The plain kinematics of an arm from a URDF: joints turn about the axes that the file names, in the file's frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from qparm.files.xml_tree import xml_tree

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    from numpy.typing import NDArray

    from qparm.cell.urdf import UrdfArm

__all__ = ["urdf_transforms"]


def urdf_transforms(arm: UrdfArm, Q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the tool's poses and the frames in which the joints move.

    Parameters
    ----------
    arm : UrdfArm
        Of a valid cell: its text was read before.
    Q : (N, n) ndarray
        m and rad.

    Returns
    -------
    poses : (N, 4, 4) ndarray
        Tool in the base frame.
    axes : (N, n, 4, 4) ndarray
        Frames whose z axes are the joint axes, base frame.
    """
    above = {_link(joint, "child"): joint for joint in xml_tree(arm.text, what="the URDF").findall("joint")}
    way: list[ET.Element] = []
    link = arm.tip_link
    while link != arm.base_link:
        way.insert(0, above[link])
        link = _link(above[link], "parent")
    T = np.tile(arm.base.matrix(), (len(Q), 1, 1))
    axes: list[NDArray[np.float64]] = []
    for joint in way:
        T = T @ _rigid(Rotation.from_euler("xyz", _triple(joint, "origin", "rpy")), _triple(joint, "origin", "xyz"))
        if joint.get("type") == "fixed":
            continue
        axis = _triple(joint, "axis", "xyz", default="1 0 0")
        axis = axis / np.linalg.norm(axis)
        sideways = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        sideways /= np.linalg.norm(sideways)
        frame = Rotation.from_matrix(np.column_stack([sideways, np.cross(axis, sideways), axis]))
        axes.append(T @ _rigid(frame, np.zeros(3)))
        q = Q[:, len(axes) - 1, None]
        motion = np.tile(np.eye(4), (len(Q), 1, 1))
        if joint.get("type") == "prismatic":
            motion[:, :3, 3] = q * axis
        else:
            motion[:, :3, :3] = Rotation.from_rotvec(q * axis).as_matrix()
        T = T @ motion
    return T @ arm.tool.matrix(), np.stack(axes, axis=1)


def _link(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _triple(joint: ET.Element, tag: str, attribute: str, *, default: str = "0 0 0") -> NDArray[np.float64]:
    element = joint.find(tag)
    text = default if element is None else element.get(attribute, default)
    return np.array([float(word) for word in text.split()])


def _rigid(R: Rotation, p: NDArray[np.float64]) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R.as_matrix(), p
    return T
