"""What hangs on the hand and is no contact: a tool of known weight, and a short motion that finds it.

The tool joins the last link of the rigid-body model, so controller and estimators carry it and the estimate tells contact
force alone. The motion turns the hand through a few postures. At rest the residual of the arm's joints is what the model lacks:

    r = -sum of the tool's weight and the arm's mass error = Y(q) [dm, dm c, beta]
"""

from dataclasses import dataclass, field

import numpy as np

from control.frames import quaternion_multiply
from control.joints import ARM_SLICE
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.timing import CONTROL_PERIOD_S
from control.types import Command

MAX_TOOL_KG = 3.0
MAX_TOOL_CENTER_M = 0.3


class ToolError(ValueError):
    """A tool that the hand cannot carry, or a motion that found none; the message says why."""


@dataclass(frozen=True, slots=True)
class Tool:
    """Attributes:
    mass_kg: beyond the nominal end effector.
    center_of_mass_m: (3,) in the end effector's frame.
    """

    mass_kg: float = 0.0
    center_of_mass_m: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        if not 0.0 <= self.mass_kg <= MAX_TOOL_KG:
            raise ToolError(f"mass_kg is {self.mass_kg}; the range is 0 to {MAX_TOOL_KG:g}")
        center = np.asarray(self.center_of_mass_m, dtype=float)
        if center.shape != (3,) or not (np.abs(center) <= MAX_TOOL_CENTER_M).all():
            raise ToolError(f"center_of_mass_m is {center.tolist()}; each of 3 lies within +-{MAX_TOOL_CENTER_M:g} m")
        object.__setattr__(self, "center_of_mass_m", center)


@dataclass(frozen=True, slots=True)
class IdentificationConfig:
    """Attributes:
    turns_rad: pitch, then roll of the hand in each posture, beyond where it was at the start.
    move_s: into a posture and to rest there.
    rest_s: over which the residual is averaged.
    joint_noise_nm: standard deviation of one joint's mean residual at rest, beside its dry friction.
    arm_mass_sd: prior standard deviation of the arm's mass error.
    tool_sd: prior standard deviations of the tool's mass (kg) and of mass times centre (kg m).
    """

    turns_rad: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.6, 0.0), (0.6, 0.9), (-0.4, 0.9), (-0.4, -0.9), (0.3, -0.9))
    move_s: float = 1.4
    rest_s: float = 0.4
    joint_noise_nm: float = 0.05
    arm_mass_sd: float = 0.1
    tool_sd: tuple[float, float] = (2.0, 0.3)


def rest_regressor(model: RobotModel) -> np.ndarray:
    """Y (6, 5) of the arm's joints: what [dm (kg), dm c (kg m, end effector's frame), beta] add to their residual r."""
    rows = model.joint_rows[ARM_SLICE]
    jacobian = model.end_effector_jacobian[:, rows]
    weight = np.array([0.0, 0.0, -GRAVITY_MPS2])
    columns = np.empty((6, 5))
    columns[:, 0] = jacobian[:3].T @ weight
    for axis in range(3):
        columns[:, 1 + axis] = jacobian[3:].T @ np.cross(model.end_effector_rotation[:, axis], weight)
    columns[:, 4] = -model.arm_gravity[rows]
    return columns


class ToolIdentification:
    """The motion, period by period; feed it the command to move by and the residual there."""

    STATE = ("_config", "_start", "_posture", "_elapsed_s", "_weights", "_information", "_vector", "_samples")

    def __init__(self, config: IdentificationConfig, model: RobotModel, start: Command) -> None:
        """`start`: references from which the motion begins and to which it returns."""
        self._config, self._start = config, start
        self._posture, self._elapsed_s = 0, 0.0
        noise = model.joint_friction[ARM_SLICE] + config.joint_noise_nm
        self._weights = 1.0 / noise**2
        mass_sd, moment_sd = config.tool_sd
        prior = np.array([mass_sd, moment_sd, moment_sd, moment_sd, config.arm_mass_sd])
        self._information, self._vector = np.diag(prior**-2.0), np.zeros(5)
        self._samples = round(config.rest_s / CONTROL_PERIOD_S)

    @property
    def progress(self) -> float:
        """Done, 0 to 1."""
        return self._posture / len(self._config.turns_rad)

    @property
    def finished(self) -> bool:
        """Whether all postures have been seen."""
        return self._posture == len(self._config.turns_rad)

    def command(self) -> Command:
        """The references of now."""
        pitch, roll = self._config.turns_rad[min(self._posture, len(self._config.turns_rad) - 1)]
        turned = quaternion_multiply(self._start.orientation_wxyz, _about(1, pitch))
        turned = quaternion_multiply(turned, _about(0, roll))
        return Command(np.zeros(3), np.zeros(3), self._start.position_m, turned, np.zeros(3))

    def step(self, model: RobotModel, residual: np.ndarray, dt_s: float) -> None:
        """Take in one control period.

        Args:
            model: at this configuration.
            residual: (28,) r of the momentum observer.
            dt_s: since the last step.
        """
        self._elapsed_s += dt_s
        if self._elapsed_s > self._config.move_s:
            regressor = rest_regressor(model)
            weights = self._weights / self._samples
            self._information += regressor.T * weights @ regressor
            self._vector += regressor.T * weights @ residual[model.joint_rows[ARM_SLICE]]
        if self._elapsed_s > self._config.move_s + self._config.rest_s:
            self._posture, self._elapsed_s = self._posture + 1, 0.0

    def tool(self, carried: Tool) -> Tool:
        """The tool, of which the model already carries `carried`.

        Raises:
            ToolError: what was found is no tool that a hand can carry.
        """
        mass, *moment, _ = np.linalg.solve(self._information, self._vector)
        mass += carried.mass_kg
        moment = np.array(moment) + carried.mass_kg * carried.center_of_mass_m
        if mass < 0.02:
            return Tool()
        # Of a light tool the centre is hardly seen; it lies within what a hand can hold.
        center = np.clip(moment / mass, -MAX_TOOL_CENTER_M, MAX_TOOL_CENTER_M)
        return Tool(float(mass), center)


def _about(axis: int, angle: float) -> np.ndarray:
    """Quaternion (4,) wxyz of a turn about an axis of the hand."""
    quaternion = np.zeros(4)
    quaternion[0], quaternion[1 + axis] = np.cos(angle / 2.0), np.sin(angle / 2.0)
    return quaternion
