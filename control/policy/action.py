"""Action law of the policy: joint targets from the network's action."""

from dataclasses import dataclass

import numpy as np

from control.joints import ARM_SLICE, LEG_SLICE, WHEEL_SLICE
from control.whole_body.reference_correction import ReferenceCorrection


@dataclass(frozen=True, slots=True)
class ActionScales:
    """Target = nominal + scale * action, eq. of the action: rad for legs and arm, rad/s for wheels.

    The drives are soft, so a target lies as far from the joint as its torque asks: up to 2 rad on the arm.

    Attributes:
        leg_rad, wheel_rps, arm_rad: one unit of action.
        limit: largest action.
        hand_velocity_mps, hand_force_n, hand_turn_rps: one unit of a residual policy's correction of the arm, of what is asked
            of the hand: the first on position axes, the second on force axes. What an error of the hand asks for depends on
            neither posture nor inertia then, and turning the hand does not move it. Little force: what training makes of
            forces beyond that suits its own contacts, not real ones.
        base_forward_mps, base_turn_rps: one unit of its first two wheel actions, which correct what is asked of the base. Its
            other two do nothing: with an action for each wheel, noise hardly ever turns the robot, and wheels that work
            against each other gain speed in the training world but lose the turn on the full model.
        correction_limit: largest part of a correction.
    """

    leg_rad: float = 0.25
    wheel_rps: float = 5.0
    arm_rad: float = 0.5
    limit: float = 8.0
    hand_velocity_mps: float = 0.1
    hand_force_n: float = 3.0
    hand_turn_rps: float = 1.0
    base_forward_mps: float = 0.2
    base_turn_rps: float = 1.0
    correction_limit: float = 1.0

    def per_joint(self) -> np.ndarray:
        """(22,) scale of each joint."""
        return np.array([self.leg_rad] * 12 + [self.wheel_rps] * 4 + [self.arm_rad] * 6)

    def joint_correction(self, action: np.ndarray) -> np.ndarray:
        """What the action (..., 22) of a residual policy adds to the model-based action (..., 22): that of the legs."""
        added = np.zeros_like(action)
        added[..., LEG_SLICE] = action[..., LEG_SLICE]
        return added

    def reference_correction(self, action: np.ndarray) -> ReferenceCorrection:
        """What the action (..., 22) of a residual policy adds to what is asked of hand and base."""
        arm, base = action[..., ARM_SLICE], action[..., WHEEL_SLICE][..., :2]
        linear, angular = arm[..., :3], arm[..., 3:]
        return ReferenceCorrection(
            hand_velocity=self.hand_velocity_mps * linear,
            hand_force=self.hand_force_n * linear,
            hand_angular_velocity=self.hand_turn_rps * angular,
            base_velocity=np.array([self.base_forward_mps, self.base_turn_rps]) * base,
        )
