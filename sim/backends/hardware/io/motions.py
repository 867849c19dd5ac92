"""Standing up and sitting down without any controller: min-jerk postures with stiffness that rises or falls."""

from dataclasses import dataclass

import numpy as np

from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, NOMINAL_POSITION, WHEEL_SLICE
from control.types import JointCommand

CROUCH_LEGS = np.array([0.0, 1.3, -2.6] * 4)
"""Folded legs, (12,) rad, just inside the calves' ends."""

ARM_FOLDED = np.array([0.0, 0.1, -0.1, -0.07, 0.0, 0.0])
"""Folded arm, (6,) rad, just inside the ends of joints 2 and 3. Both are ours; a robot that is switched on lies like this."""


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """Gains and times of the postures that the I/O process commands itself (vendor's stand example: 70 and 5).

    Attributes:
        leg_stiffness, leg_damping, wheel_damping, arm_stiffness, arm_damping: N m/rad, N m s/rad.
        fold_s, rise_s: to the crouch with rising stiffness, from there to the stance.
        sit_s, fade_s: to the crouch, then to zero stiffness.
        reached_rad: largest leg error that still counts as having reached the stance.
        blend_s: from the held stance to the controller's commands.
    """

    leg_stiffness: float = 70.0
    leg_damping: float = 5.0
    wheel_damping: float = 3.0
    arm_stiffness: float = 60.0
    arm_damping: float = 3.0
    fold_s: float = 2.0
    rise_s: float = 2.0
    sit_s: float = 2.0
    fade_s: float = 1.0
    reached_rad: float = 0.35
    blend_s: float = 0.5


def min_jerk(progress: float) -> float:
    """Smooth step from 0 to 1 with zero velocity and acceleration at both ends (Flash and Hogan 1985)."""
    x = min(1.0, max(0.0, progress))
    return x**3 * (10.0 + x * (6.0 * x - 15.0))


class Postures:
    """Commands of the motions, starting from the joint positions (22,) measured when they begin."""

    def __init__(self, config: MotionConfig) -> None:
        self.config = config
        self._stiffness = np.zeros(JOINT_COUNT)
        self._stiffness[LEG_SLICE], self._stiffness[ARM_SLICE] = config.leg_stiffness, config.arm_stiffness
        self._damping = np.empty(JOINT_COUNT)
        self._damping[LEG_SLICE] = config.leg_damping
        self._damping[WHEEL_SLICE] = config.wheel_damping
        self._damping[ARM_SLICE] = config.arm_damping
        self._stance = NOMINAL_POSITION.copy()
        self._stance[WHEEL_SLICE] = 0.0

    def stand_up(self, start: np.ndarray, elapsed_s: float) -> tuple[JointCommand, bool]:
        """Fold the legs, then rise; the arm keeps its pose first and reaches out while rising. Second value: finished."""
        config = self.config
        folded = self._stance.copy()
        folded[LEG_SLICE] = CROUCH_LEGS
        folded[ARM_SLICE] = start[ARM_SLICE]
        fold, rise = min_jerk(elapsed_s / config.fold_s), min_jerk((elapsed_s - config.fold_s) / config.rise_s)
        posture = start + fold * (folded - start) + rise * (self._stance - folded)
        return self._command(posture, min(1.0, elapsed_s / config.fold_s)), elapsed_s >= config.fold_s + config.rise_s

    def stance(self) -> JointCommand:
        """Hold the nominal stance."""
        return self._command(self._stance.copy(), 1.0)

    def sit_down(self, start: np.ndarray, elapsed_s: float) -> tuple[JointCommand, bool]:
        """Fold legs and arm, then let stiffness fade. Second value: finished."""
        config = self.config
        folded = self._stance.copy()
        folded[LEG_SLICE], folded[ARM_SLICE] = CROUCH_LEGS, ARM_FOLDED
        posture = start + min_jerk(elapsed_s / config.sit_s) * (folded - start)
        fade = 1.0 - min(1.0, max(0.0, elapsed_s - config.sit_s) / config.fade_s)
        return self._command(posture, fade), elapsed_s >= config.sit_s + config.fade_s

    def reached(self, position: np.ndarray) -> bool:
        """Whether the measured legs (22,) stand in the stance."""
        return float(np.abs(position[LEG_SLICE] - self._stance[LEG_SLICE]).max()) < self.config.reached_rad

    def _command(self, posture: np.ndarray, stiffness: float) -> JointCommand:
        posture[WHEEL_SLICE] = 0.0
        return JointCommand(posture, np.zeros(JOINT_COUNT), stiffness * self._stiffness, self._damping)


def blend(first: JointCommand, second: JointCommand, weight: float) -> JointCommand:
    """Between two commands: targets, gains and feed-forward alike; weight 0 is `first`."""
    return JointCommand(
        first.position + weight * (second.position - first.position),
        first.velocity + weight * (second.velocity - first.velocity),
        first.stiffness + weight * (second.stiffness - first.stiffness),
        first.damping + weight * (second.damping - first.damping),
        first.torque + weight * (second.torque - first.torque),
    )
