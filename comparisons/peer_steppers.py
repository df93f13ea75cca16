"""pink's and mink's differential step on a chain: one frame task, position and velocity limits, DAQP."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import qparm
from comparisons.extras import load
from comparisons.urdf_of_chain import urdf_of_chain

__all__ = ["Mink", "Pink", "Stepper"]


class Stepper(Protocol):
    """A library that takes one step."""

    def configuration(self, q: NDArray[np.float64]) -> Any:
        """Return the library's configuration at q."""
        ...

    def step(self, configuration: Any, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take one step and return its velocity; the configuration is moved on and its kinematics with it."""
        ...


class Pink:
    """pink's solve_ik with its default limits: position and velocity of the URDF."""

    def __init__(self, chain: qparm.SerialChain, time_step: float) -> None:
        pink, pin = load("pink"), load("pinocchio")

        self._pin, self._pink, self._time_step = pin, pink, time_step
        model = pin.buildModelFromXML(urdf_of_chain(chain))
        self._model, self._data = model, model.createData()
        self._task = pink.tasks.FrameTask("tool", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-2)
        self._lower, self._upper = chain.lower, chain.upper

    def configuration(self, q: NDArray[np.float64]) -> Any:
        """Return pink's configuration at q."""
        return self._pink.Configuration(self._model, self._data, q)

    def step(self, configuration: Any, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take one step and return its velocity."""
        self._task.set_target(self._pin.SE3(target))
        velocity = self._pink.solve_ik(configuration, [self._task], self._time_step, solver="daqp", safety_break=False)
        configuration.integrate_inplace(velocity, self._time_step)
        return velocity

    def solve(
        self, target: NDArray[np.float64], q: NDArray[np.float64], tolerance: float, iterations: int
    ) -> NDArray[np.float64] | None:
        """Iterate from one start; None if the pose is not reached."""
        configuration = self.configuration(q)
        self._task.set_target(self._pin.SE3(target))
        for _ in range(iterations):
            error = self._task.compute_error(configuration)
            if np.linalg.norm(error[:3]) <= tolerance and np.linalg.norm(error[3:]) <= tolerance:
                return configuration.q
            try:
                velocity = self._pink.solve_ik(configuration, [self._task], 1.0, solver="daqp", safety_break=False)
            except self._pink.exceptions.PinkError:
                return None
            q_next = np.clip(configuration.q + velocity, self._lower, self._upper)
            configuration.update(q_next)
        return None


class Mink:
    """mink's solve_ik on MuJoCo's model of the same URDF, with both limits, which it applies only if asked."""

    def __init__(self, chain: qparm.SerialChain, time_step: float) -> None:
        mink = load("mink")
        mujoco = load("mujoco")

        self._mink, self._time_step = mink, time_step
        # MuJoCo would merge the tool into the last link
        keep = '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
        self._model = mujoco.MjModel.from_xml_string(urdf_of_chain(chain).replace("</robot>", keep))
        self._task = mink.FrameTask("tool", "body", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-2)
        velocities = dict(zip(chain.names, chain.velocity.tolist(), strict=True))
        self._limits = [mink.ConfigurationLimit(self._model), mink.VelocityLimit(self._model, velocities)]

    def configuration(self, q: NDArray[np.float64]) -> Any:
        """Return mink's configuration at q."""
        return self._mink.Configuration(self._model, q)

    def pose(self, configuration: Any) -> NDArray[np.float64]:
        """Return the pose of the tool, (4, 4)."""
        return configuration.get_transform_frame_to_world("tool", "body").as_matrix()

    def step(self, configuration: Any, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take one step and return its velocity."""
        self._task.set_target(self._mink.SE3.from_matrix(target))
        velocity = self._mink.solve_ik(
            configuration, [self._task], self._time_step, solver="daqp", limits=self._limits, safety_break=False
        )
        configuration.integrate_inplace(velocity, self._time_step)
        return velocity
