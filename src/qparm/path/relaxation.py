"""Task relaxations in the path frame: which rotations of the tool are free, and how far.

The tool stands at ``pose exp(tilt_x, tilt_y, 0) Rz(spin)``: a tilt of its axis out of the path frame's z, then
a spin about its own axis. The parameters (tilt_x, tilt_y, spin) are zero at the nominal pose, which is preferred.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from qparm.errors import InvalidInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from qparm.robot import SerialChain

__all__ = ["EXACT", "Relaxation"]

# Strips whose intersection is the polygon inside the cone: plans use 98 % of it.
_STRIPS = 8


@dataclass(frozen=True)
class Relaxation:
    """Which rotations of the tool are free.

    Attributes
    ----------
    spin : bool
        The tool may turn about its own axis.
    tilt : float
        Half angle of the cone in which the tool's axis may lean (rad); 0 keeps it.
    """

    spin: bool = False
    tilt: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.tilt <= np.pi / 3:
            raise InvalidInput(f"the tilt must lie between 0 and 60 deg, not {np.degrees(self.tilt):.6g} deg")

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the free parameters among tilt_x, tilt_y, spin."""
        return ((0, 1) if self.tilt > 0 else ()) + ((2,) if self.spin else ())

    @property
    def freedom(self) -> int:
        """How many parameters are free."""
        return len(self.free)

    @property
    def words(self) -> str:
        """What is free, in words; empty if nothing is."""
        spin, tilt = "to spin" if self.spin else "", f"to lean by {np.degrees(self.tilt):.4g} deg" if self.tilt else ""
        return f"the tool free {' and '.join(filter(None, (spin, tilt)))}" if self.free else ""

    @property
    def words_beyond_plans(self) -> str:
        """The same of what is reached by leaning farther than plans let the tool lean."""
        return f"{self.words}, but only beyond the {np.degrees(self.inner):.4g} deg to which plans lean it"

    @property
    def inner(self) -> float:
        """Half angle of the cone inside the polygon by which the true cone is held (rad): where searches stay."""
        return self.tilt * float(np.cos(0.5 * np.pi / _STRIPS))

    @cached_property
    def _facets(self) -> NDArray[np.float64]:
        angle = np.pi / _STRIPS * np.arange(_STRIPS)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

    @property
    def planned(self) -> Relaxation:
        """What plans make use of: the tilt within :attr:`inner`."""
        return replace(self, tilt=self.inner)

    def random(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Return random parameters, (count, 3); the first is nominal."""
        rho = np.zeros((count, 3))
        if self.tilt > 0:
            radius, angle = self.inner * np.sqrt(rng.random(count)), rng.uniform(0, 2 * np.pi, count)
            rho[:, 0], rho[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
        if self.spin:
            rho[:, 2] = rng.uniform(-np.pi, np.pi, count)
        rho[:1] = 0.0
        return rho

    def clipped(self, rho: NDArray[np.float64], *, inner: bool = False) -> NDArray[np.float64]:
        """Return parameters brought back into the cone, or the inner one; those that are not free are zero."""
        out = np.zeros_like(rho)
        if self.tilt > 0:
            norm = np.linalg.norm(rho[..., :2], axis=-1, keepdims=True)
            out[..., :2] = rho[..., :2] * np.minimum(
                1.0, 0.999999 * (self.inner if inner else self.tilt) / np.maximum(norm, 1e-300)
            )
        if self.spin:
            out[..., 2] = rho[..., 2]
        return out

    def unwound(self, rho: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the parameters of a path (N, 3) with a spin that does not leap by full turns, near nominal."""
        out = rho.copy()
        if self.spin and len(out):
            out[:, 2] = np.unwrap(out[:, 2])
            out[:, 2] -= 2 * np.pi * np.round(np.median(out[:, 2]) / (2 * np.pi))
        return out

    def rotations(self, rho: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the tool's rotation against the path frame, (N, 3, 3)."""
        from scipy.spatial.transform import Rotation

        tilt, spin = np.zeros_like(rho), np.zeros_like(rho)
        tilt[:, :2], spin[:, 2] = rho[:, :2], rho[:, 2]
        return (Rotation.from_rotvec(tilt) * Rotation.from_rotvec(spin)).as_matrix()

    def targets(self, poses: NDArray[np.float64], rho: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the poses with the tool turned by its parameters, (N, 4, 4)."""
        if not self.free:
            return poses
        turned = poses.copy()
        turned[:, :3, :3] = poses[:, :3, :3] @ self.rotations(rho)
        return turned

    def rows(
        self,
        chain: SerialChain,
        poses: NDArray[np.float64],
        q: NDArray[np.float64],
        rho: NDArray[np.float64],
        D: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the task rows in joints scaled by D: fixed ones (N, 6 - f, n), their errors, free ones (N, f, n).

        The fixed rows are the position over the characteristic length and the fixed parameters; the free rows
        give the change of the free parameters. At the parameters' own pose the angular velocity is, in the tool frame,

            w = Rz(spin)^T J_r(tilt)[:, :2] d(tilt) + e_z d(spin)
        """
        target = self.targets(poses, rho)
        current, J = chain.forward(q), chain.jacobian(q) * D
        E = chain.pose_error(current, target)
        RT = target[:, :3, :3].transpose(0, 2, 1)
        position, rotation = J[:, :3] / chain.characteristic_length, RT @ J[:, 3:]
        e_rotation = np.einsum("kij,kj->ki", RT, E[:, 3:])
        if self.free:
            inverse = np.linalg.inv(self._rates(rho))
            rotation, e_rotation = inverse @ rotation, np.einsum("kij,kj->ki", inverse, e_rotation)
        held = [i for i in range(3) if i not in self.free]
        task = np.concatenate([position, rotation[:, held]], axis=1)
        error = np.concatenate([E[:, :3] / chain.characteristic_length, e_rotation[:, held]], axis=1)
        return task, error, rotation[:, list(self.free)]

    def _rates(self, rho: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return B (N, 3, 3): angular velocity in the tool frame = B d(rho)."""
        angle = np.linalg.norm(rho[:, :2], axis=1)
        a = np.where(angle > 1e-6, (1 - np.cos(angle)) / np.maximum(angle, 1e-8) ** 2, 0.5)
        b = np.where(angle > 1e-6, (angle - np.sin(angle)) / np.maximum(angle, 1e-8) ** 3, 1 / 6)
        W = np.zeros((len(rho), 3, 3))
        W[:, 0, 2], W[:, 1, 2] = rho[:, 1], -rho[:, 0]
        W[:, 2, 0], W[:, 2, 1] = -rho[:, 1], rho[:, 0]
        right = np.eye(3) - a[:, None, None] * W + b[:, None, None] * (W @ W)
        c, s = np.cos(rho[:, 2]), np.sin(rho[:, 2])
        RzT = np.zeros((len(rho), 3, 3))
        RzT[:, 0, 0], RzT[:, 0, 1], RzT[:, 1, 0], RzT[:, 1, 1], RzT[:, 2, 2] = c, s, -s, c, 1.0
        B = RzT @ right
        B[:, :, 2] = (0.0, 0.0, 1.0)
        return B

    def cone(
        self,
        rho: NDArray[np.float64],
        relaxed: NDArray[np.float64],
        basis: NDArray[np.float64],
        p: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None:
        """Return the cone as rows on z: (N, k, r), lower and upper bounds (N, k); None without tilt."""
        if self.tilt == 0:
            return None
        rows = self._facets @ (relaxed[:, :2] @ basis)
        now = (rho[:, :2] + np.einsum("kij,kj->ki", relaxed[:, :2], p)) @ self._facets.T
        return rows, -self.inner - now, self.inner - now


EXACT = Relaxation()
