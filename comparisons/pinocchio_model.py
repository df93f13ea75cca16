"""A chain as a Pinocchio model, joint by joint."""

from __future__ import annotations

from typing import Any

import numpy as np

import qparm
from comparisons.extras import load

__all__ = ["pinocchio_model"]

pin = load("pinocchio")


def pinocchio_model(chain: qparm.SerialChain) -> tuple[Any, Any, int]:
    """Return model, data and the id of the tool's frame."""
    model, parent = pin.Model(), 0
    for index, joint in enumerate(chain.joints):
        transform = np.asarray(joint.transform_previous_joint)
        if index == 0:
            transform = np.asarray(chain.transform_base) @ transform
        kind = pin.JointModelPZ() if joint.kind == "prismatic" else pin.JointModelRZ()
        parent = model.addJoint(parent, kind, pin.SE3(transform), joint.name)
    tool = pin.Frame("tool", parent, pin.SE3(np.array(chain.transform_tool)), pin.FrameType.OP_FRAME)
    frame = model.addFrame(tool)
    return model, model.createData(), frame
