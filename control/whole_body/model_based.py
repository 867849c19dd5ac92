"""The model-based whole-body controller: drives, tracks the hand and regulates its force, with nothing learned.

It is the fallback that is always there and the teacher of learned policies. Three parts share one tick: the arm tracks
the hand and its force (arm_control), the legs carry weight and hand force (leg_control), the wheels drive (wheel_control).
"""

from dataclasses import dataclass, field

import numpy as np

from control.command.limits import CommandLimits
from control.frames import rotation_heading_to_world
from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, WHEEL_SLICE
from control.robot_model import RobotModel
from control.whole_body.arm import ArmConfig, ArmControl
from control.whole_body.controller import ControllerInput
from control.whole_body.legs import LegConfig, LegControl
from control.whole_body.reference_correction import NO_CORRECTION, ReferenceCorrection
from control.whole_body.stance import Stance, StanceConfig
from control.whole_body.wheels import WheelConfig, WheelControl


@dataclass(frozen=True, slots=True)
class ModelBasedConfig:
    """Gains of the parts, and the limits that hold the workspace."""

    arm: ArmConfig = field(default_factory=ArmConfig)
    legs: LegConfig = field(default_factory=LegConfig)
    stance: StanceConfig = field(default_factory=StanceConfig)
    wheels: WheelConfig = field(default_factory=WheelConfig)
    limits: CommandLimits = field(default_factory=CommandLimits)


class ModelBasedController:
    """Whole-body controller from the rigid-body model; implements `Controller`."""

    def __init__(self, model: RobotModel, config: ModelBasedConfig | None = None) -> None:
        config = config or ModelBasedConfig()
        self._arm = ArmControl(config.arm, model.position_lower[ARM_SLICE], model.position_upper[ARM_SLICE], config.limits)
        self._stance = Stance(config.stance, model)
        self._legs = LegControl(config.legs, self._stance)
        self._wheels = WheelControl(config.wheels, model.joint_damping[WHEEL_SLICE], model.joint_friction[WHEEL_SLICE])

    def reset(self) -> None:
        """Forget integrals and held angles."""
        self._arm.reset()
        self._legs.reset()
        self._wheels.reset()

    def step(self, inputs: ControllerInput, correction: ReferenceCorrection = NO_CORRECTION) -> np.ndarray:
        """Joint targets (22,), see `Controller.step`; a residual policy may correct the references."""
        heading = rotation_heading_to_world(inputs.base.rotation_base_to_world)
        on_force = self._arm.on_force(inputs)
        hand_force = on_force * inputs.command.force_n + (1.0 - on_force) * inputs.force_estimated_n
        legs = self._legs.step(inputs, heading, heading @ hand_force)
        lateral = inputs.model.wheel_contact_positions @ heading[:, 1]

        targets = np.empty(JOINT_COUNT)
        targets[LEG_SLICE] = legs.position
        shift = float(self._stance.shift_velocity[0])
        targets[WHEEL_SLICE] = self._wheels.step(inputs, lateral, legs, shift, correction)
        targets[ARM_SLICE] = self._arm.step(inputs, heading, on_force, correction)
        return targets
