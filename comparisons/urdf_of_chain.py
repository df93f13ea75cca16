"""A chain as URDF text, for libraries that read nothing else: kinematics, limits, unit masses but for the root."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.spatial.transform import Rotation

import qparm

__all__ = ["urdf_of_chain"]


def urdf_of_chain(chain: qparm.SerialChain) -> str:
    """Return a URDF whose link ``tool`` has the pose of the chain's tool; joint names are kept."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    links = ["base", *(f"link_{name}" for name in chain.names), "tool"]
    lines = ['<robot name="chain">', '<link name="base"/>']
    lines += [f'<link name="{link}">{mass}</link>' for link in links[1:]]
    for i, joint in enumerate(chain.joints):
        T = np.asarray(joint.transform_previous_joint)
        if i == 0:
            T = np.asarray(chain.transform_base) @ T
        low, high = joint.position
        lines.append(
            f'<joint name="{joint.name}" type="{joint.kind}">{_origin(T)}<parent link="{links[i]}"/>'
            f'<child link="{links[i + 1]}"/><axis xyz="0 0 1"/>'
            f'<limit lower="{low!r}" upper="{high!r}" velocity="{joint.velocity!r}" effort="1000"/></joint>'
        )
    lines.append(
        f'<joint name="to_tool" type="fixed">{_origin(np.asarray(chain.transform_tool))}'
        f'<parent link="{links[-2]}"/><child link="tool"/></joint></robot>'
    )
    return "\n".join(lines)


def _origin(T: np.ndarray) -> str:
    xyz = " ".join(repr(float(x)) for x in T[:3, 3])
    with warnings.catch_warnings(action="ignore"):  # at a pitch of 90 degrees any split of the rest will do
        angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
    rpy = " ".join(repr(float(x)) for x in angles)
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'
