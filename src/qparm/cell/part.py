"""The base class of a cell's tables, and the pose, which occurs in many of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict, ValidationInfo

from qparm.cell.quantities import AngleTriple, LengthTriple, problem

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["Part", "Pose", "file_of_cell"]


class Part(BaseModel):
    """A table of a cell: no unknown keys, no change afterwards."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Pose(Part):
    """A position and a rotation by roll, pitch, yaw: about x, then y, then z of the fixed frame."""

    position: LengthTriple = (0.0, 0.0, 0.0)
    rpy: AngleTriple = (0.0, 0.0, 0.0)

    def matrix(self) -> NDArray[np.float64]:
        """Return the (4, 4) pose."""
        import numpy as np
        from scipy.spatial.transform import Rotation

        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", self.rpy).as_matrix() if any(self.rpy) else np.eye(3)
        T[:3, 3] = self.position
        return T


def file_of_cell(value: str, info: ValidationInfo) -> str:
    """Return the whole path of a file that a cell names; one that is not whole starts at the cell's folder."""
    if not value:
        raise problem("must have at least 1 character")
    try:
        return str(((info.context or {}).get("folder", Path()) / value).resolve())
    except (OSError, RuntimeError, ValueError) as error:  # a name that no file can have, a ring of links
        raise problem(f"cannot be a file's name: {error}") from None
