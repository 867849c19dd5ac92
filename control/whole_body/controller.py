"""The interface of every whole-body controller: the model-based one and learned policies."""

from dataclasses import field
from typing import Protocol

import numpy as np

from control.robot_model import RobotModel
from control.types import BaseState, Command, SensorFrame
from control.values import value


@value
class ControllerInput:
    """What a controller may see. Nothing here is simulator truth.

    Attributes:
        sensor: newest sensor frame.
        base: estimated base state.
        model: robot model, updated with both.
        command: as applied: after guidance, limits, the tip-over limit and rate limits.
        force_estimated_n: (3,) N, estimated, environment on end effector.
        mass_scales: (2,) estimated masses of arm and rest over nominal.
    """

    sensor: SensorFrame
    base: BaseState
    model: RobotModel
    command: Command
    force_estimated_n: np.ndarray
    mass_scales: np.ndarray = field(default_factory=lambda: np.ones(2))


class Controller(Protocol):
    """Maps measurements and the applied command to joint targets at 50 Hz."""

    def reset(self) -> None:
        """Forget integrators and history."""

    def step(self, inputs: ControllerInput) -> np.ndarray:
        """Joint targets (22,), a fresh array: legs and arm rad, wheels rad/s.

        The drives run torque = stiffness (target - q) - damping dq on legs and arm and damping (target - dq) on wheels,
        with the gains of control.joints. A target may lie far from the posture where it carries a torque.
        """
        ...
