"""The safety gate in front of every backend: whatever a controller asks, the drives get a command within limits.

Targets carry torque (a PD drive of 15 N m/rad needs an offset of a radian to hold the arm up), so the limits of joint
position, velocity and torque all act on the torque that a target is predicted to cause, and the target is moved to where
the prediction is within them.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from control.faults import Fault
from control.joints import (
    ARM_SLICE,
    DAMPING,
    JOINT_COUNT,
    LEG_SLICE,
    NOMINAL_POSITION,
    STIFFNESS,
    TORQUE_LIMIT,
    WHEEL_SLICE,
)
from control.kernels.compiled import kernel
from control.kernels.records import packed, record
from control.kernels.small_algebra import clip
from control.robot_model import RobotModel
from control.timing import TICK_S
from control.types import BaseState, Command, JointCommand, SensorFrame
from control.values import value


@dataclass(frozen=True, slots=True)
class SafetyConfig:
    """Thresholds. Torque limits are control.joints.TORQUE_LIMIT, position limits the model's.

    Attributes:
        tilt_warn_rad, tilt_damp_rad: angle between the base's z axis and up. Damping for tilt latches until `clear` or
            `reset`: a robot on its side must not stand up by itself.
        setpoint_timeout_s: age of the operator's last sign of life at which the base velocity becomes zero.
        hold_timeout_s, damp_timeout_s: age of the controller's targets (period 20 ms) that is reported while they are
            held, and at which the drives damp instead.
        position_margin_rad: distance from a joint limit over which the torque towards the limit fades to zero.
        overtravel_rad: beyond a limit by this much, an encoder must be wrong: damp.
        leg_velocity_rps, wheel_velocity_rps, arm_velocity_rps: a joint faster than this may only be braked.
        leg_slew_rps, wheel_slew_rps2, arm_slew_rps: fastest change of a target.
        leg_damping, wheel_damping, arm_damping: N m s/rad while damping, stiffness zero.
        stand_up_s: min-jerk blend from the measured posture to the controller when the legs start far from their stance.
        start_blend_s: the same when they stand already.
        handover_s: min-jerk blend from the targets that act to those of another controller.
        standing_rad: largest leg joint distance from NOMINAL_POSITION that still counts as standing.
    """

    tilt_warn_rad: float = 0.8
    tilt_damp_rad: float = 1.0
    setpoint_timeout_s: float = 0.5
    hold_timeout_s: float = 0.06
    damp_timeout_s: float = 0.1
    position_margin_rad: float = 0.087
    overtravel_rad: float = 0.3
    leg_velocity_rps: float = 30.0
    wheel_velocity_rps: float = 40.0
    arm_velocity_rps: float = 6.0
    leg_slew_rps: float = 50.0
    wheel_slew_rps2: float = 250.0
    arm_slew_rps: float = 75.0
    leg_damping: float = 3.0
    wheel_damping: float = 1.0
    arm_damping: float = 2.0
    stand_up_s: float = 2.0
    start_blend_s: float = 0.1
    handover_s: float = 0.2
    standing_rad: float = 0.3


@value
class SafetyStatus:
    """What the gate did at one tick: reasons, whether the drives damp, whether the e-stop is latched."""

    faults: Fault
    damping: bool
    estop: bool


JOINT_LIMITS = record(lower=22, upper=22, velocity=22, slew=22, margin=())
"""Of the joints: position limits (rad), the speed beyond which a joint may only be braked (rad/s), the largest change of a
target in a tick, and the distance from a position limit over which the torque towards it fades (rad)."""

_GAIN = np.where(STIFFNESS > 0.0, STIFFNESS, DAMPING)
"""Torque per unit of target: of the wheels' targets, which are velocities, the damping."""


@kernel("Tuple((b1, f8))(vector, vector, Limits[::1])", Limits=JOINT_LIMITS)
def _inspect(joint_position: np.ndarray, joint_velocity: np.ndarray, limits: np.ndarray) -> tuple[bool, float]:
    """Whether position (22,) and velocity (22,) are finite, and how far the worst joint is beyond its limit, rad."""
    k = limits[0]
    squares, beyond = 0.0, -math.inf
    for joint in range(len(joint_position)):
        q, dq = joint_position[joint], joint_velocity[joint]
        squares += q * q + dq * dq
        excess = max(k.lower[joint] - q, q - k.upper[joint])
        if excess > beyond:  # NaN is not
            beyond = excess
    return math.isfinite(squares), beyond


@kernel("UniTuple(f8, 2)(Limits, i8, f8, f8)", Limits=JOINT_LIMITS)
def _torque_bounds(limits: np.record, joint: int, position: float, velocity: float) -> tuple[float, float]:
    """Lowest and highest torque, N m, that a joint may be given where it is: +-tau_max, but

    towards a limit q_end within the margin m at most tau_max (q_end - q) / m, and a joint that is too fast is only braked.
    """
    highest = TORQUE_LIMIT[joint]
    lower, upper = -highest, highest
    stiffness = highest / limits.margin
    if position > limits.upper[joint] - limits.margin:
        upper = clip(stiffness * (limits.upper[joint] - position), 0.0, highest)
    if position < limits.lower[joint] + limits.margin:
        lower = clip(stiffness * (limits.lower[joint] - position), -highest, 0.0)
    if abs(velocity) > limits.velocity[joint]:
        if velocity > 0.0:
            upper = 0.0
        else:
            lower = 0.0
    return lower, upper


@kernel("UniTuple(b1, 2)(vector, f8[::1], f8, vector, vector, Limits[::1], f8[::1], f8[::1], f8[::1])", Limits=JOINT_LIMITS)
def _limit(
    targets: np.ndarray,
    blend_from: np.ndarray,
    weight: float,
    joint_position: np.ndarray,
    joint_velocity: np.ndarray,
    limits: np.ndarray,
    applied: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
) -> tuple[bool, bool]:
    """Blend, slew, and move the targets to where the predicted torque is within bounds.

    Predicted is tau = g target - K_p q - K_d dq, with g of _GAIN.

    Args:
        targets: (22,) of the controller.
        blend_from: (22,) targets that the blend starts from.
        weight: 0 to 1, of the controller's.
        joint_position, joint_velocity: (22,) measured.
        limits: JOINT_LIMITS (1,).
        applied: (22,) targets of the last tick, become this one's, before the torque is looked at.
        position, velocity: (22,) of the drives' command, the results: of the wheels the velocity, of all others the position.

    Returns:
        Whether a target was moved because of the torque limit, and because of a position or velocity limit.
    """
    k = limits[0]
    saturated, held_back = False, False
    for joint in range(len(targets)):
        target = targets[joint] if weight >= 1.0 else blend_from[joint] + weight * (targets[joint] - blend_from[joint])
        target = clip(target, applied[joint] - k.slew[joint], applied[joint] + k.slew[joint])
        applied[joint] = target
        q, dq = joint_position[joint], joint_velocity[joint]
        offset = STIFFNESS[joint] * q + DAMPING[joint] * dq
        torque = _GAIN[joint] * target - offset
        lower, upper = _torque_bounds(k, joint, q, dq)
        limited = clip(torque, lower, upper)
        if limited != torque:
            target = (limited + offset) / _GAIN[joint]
            at_limit = abs(limited) >= TORQUE_LIMIT[joint]
            saturated |= at_limit
            held_back |= not at_limit
        is_wheel = STIFFNESS[joint] == 0.0
        position[joint], velocity[joint] = (0.0, target) if is_wheel else (target, 0.0)
    return saturated, held_back


class TargetsError(ValueError):
    """Targets that are not (22,) numbers: a programming error, not a fault of the robot."""


class SafetyGate:
    """Turns a controller's targets into a JointCommand at 500 Hz. Latches e-stop and tilt.

    Attributes:
        in_control: the controller's targets act; false while damping or blending them in from the measured posture.
    """

    STATE = (
        "_estop",
        "_handover_due",
        "_tilted",
        "_setpoint_stale",
        "_targets",
        "_targets_time_s",
        "_refused",
        "_applied",
        "in_control",
        "_starting",
        "_blend_from",
        "_blend_start_s",
        "_blend_s",
    )

    def __init__(self, config: SafetyConfig, model: RobotModel) -> None:
        self.config = config
        self._limits = packed(
            JOINT_LIMITS,
            lower=model.position_lower,
            upper=model.position_upper,
            velocity=_per_joint(config.leg_velocity_rps, config.wheel_velocity_rps, config.arm_velocity_rps),
            slew=TICK_S * _per_joint(config.leg_slew_rps, config.wheel_slew_rps2, config.arm_slew_rps),
            margin=config.position_margin_rad,
        )
        self._damping_command = _frozen_damping(config)
        self._warn_upright, self._damp_upright = math.cos(config.tilt_warn_rad), math.cos(config.tilt_damp_rad)
        self.reset()

    def reset(self) -> None:
        """As at power-on: nothing latched, the next targets are blended in from the measured posture."""
        self._estop = False
        self.clear()

    @property
    def estop_latched(self) -> bool:
        """Whether the e-stop is latched."""
        return self._estop

    def estop(self) -> None:
        """Latch the e-stop: damping from the next tick until `clear`."""
        self._estop = True

    def hand_over(self) -> None:
        """Blend the next targets in from those that act now, because another controller takes over in motion."""
        self._handover_due = self.in_control

    def clear(self) -> None:
        """Clear e-stop and tilt; the next targets are blended in from the measured posture."""
        self._estop = False
        self._tilted = False
        self._setpoint_stale = False
        self._targets: np.ndarray | None = None
        self._targets_time_s = -math.inf
        self._refused = Fault.NONE
        self._applied: np.ndarray | None = None
        self.in_control = False
        self._handover_due = False
        self._starting = False
        self._blend_from = np.zeros(JOINT_COUNT)
        self._blend_start_s = 0.0
        self._blend_s = 0.0

    def check_command(self, command: Command, age_s: float) -> Command:
        """`command`, with zero base velocity when its operator has not been heard for `setpoint_timeout_s`."""
        self._setpoint_stale = not age_s <= self.config.setpoint_timeout_s
        return replace(command, base_velocity=np.zeros(3)) if self._setpoint_stale else command

    def accept(self, targets: np.ndarray, time_s: float) -> None:
        """Take over (a copy of) what the controller has just delivered.

        Targets that are not finite are refused: the last good ones act and grow old, and NOT_FINITE is reported until sound
        ones arrive.

        Args:
            targets: (22,) joint targets.
            time_s: of the sensor frame that they answer; the age of the targets counts from it.

        Raises:
            TargetsError: targets of another shape or type. The last good ones grow old.
        """
        if not isinstance(targets, np.ndarray) or targets.shape != (JOINT_COUNT,) or targets.dtype.kind not in "fiu":
            given = f"{type(targets).__name__} of shape {np.shape(targets)}"
            raise TargetsError(f"targets must be a numpy array of {JOINT_COUNT} numbers, shape ({JOINT_COUNT},), not {given}")
        if not math.isfinite(targets.dot(targets)):
            self._refused = Fault.NOT_FINITE
            return
        self._refused = Fault.NONE
        self._targets = targets.astype(float)
        self._targets_time_s = time_s

    def step(self, sensor: SensorFrame, base: BaseState, reported: Fault = Fault.NONE) -> tuple[JointCommand, SafetyStatus]:
        """The command for one 2 ms tick, from the targets accepted last.

        Args:
            sensor: newest sensor frame.
            base: estimated base state, for tilt.
            reported: faults found elsewhere, passed on.
        """
        config = self.config
        faults = reported
        if self._refused:
            faults |= self._refused
        if self._setpoint_stale:
            faults |= Fault.STALE_SETPOINT
        finite, beyond = _inspect(sensor.joint_position, sensor.joint_velocity, self._limits)
        damp = self._estop
        # NaN fails every comparison, so "not below" also catches it.
        upright = base.rotation_base_to_world[2, 2]
        if not upright >= self._warn_upright:
            faults |= Fault.TILT
            self._tilted |= not upright >= self._damp_upright
        if self._tilted:
            faults |= Fault.TILT
            damp = True
        if not finite:
            faults |= Fault.NOT_FINITE
            damp = True
        age = sensor.time_s - self._targets_time_s
        if age > config.hold_timeout_s:
            faults |= Fault.STALE_TARGETS
            damp |= age > config.damp_timeout_s
        if beyond > config.overtravel_rad:
            faults |= Fault.JOINT_LIMIT
            damp = True
        if damp or self._targets is None:
            self._applied = None
            self.in_control = False
            return self._damping_command, SafetyStatus(faults, True, self._estop)
        position, velocity = np.empty(JOINT_COUNT), np.empty(JOINT_COUNT)
        saturated, held_back = self._limited(self._targets, sensor, position, velocity)
        if saturated:
            faults |= Fault.TORQUE_LIMIT
        if held_back:
            faults |= Fault.JOINT_LIMIT
        command = JointCommand(position, velocity, STIFFNESS, DAMPING, _NO_TORQUE)
        return command, SafetyStatus(faults, False, False)

    def _limited(
        self, targets: np.ndarray, sensor: SensorFrame, position: np.ndarray, velocity: np.ndarray
    ) -> tuple[bool, bool]:
        """See `_limit`."""
        if self._applied is None:
            self._applied = self._start(sensor)
        if self._handover_due:
            self._handover_due = False
            self._blend_from = self._applied.copy()
            self._blend_start_s, self._blend_s = sensor.time_s, self.config.handover_s
        progress = (sensor.time_s - self._blend_start_s) / self._blend_s
        self._starting &= progress < 1.0
        self.in_control = not self._starting
        weight = progress**3 * (10.0 + progress * (6.0 * progress - 15.0)) if progress < 1.0 else 1.0
        q, dq = sensor.joint_position, sensor.joint_velocity
        return _limit(targets, self._blend_from, weight, q, dq, self._limits, self._applied, position, velocity)

    def _start(self, sensor: SensorFrame) -> np.ndarray:
        """Begin the blend at the targets (22,) that cause the torque of this moment, so that nothing jumps."""
        q = sensor.joint_position
        self._blend_from = (STIFFNESS * q + DAMPING * sensor.joint_velocity + sensor.joint_torque) / _GAIN
        distance = np.abs(q[LEG_SLICE] - NOMINAL_POSITION[LEG_SLICE]).max()
        self._starting = True
        self._handover_due = False
        self._blend_start_s = sensor.time_s
        self._blend_s = self.config.start_blend_s if distance < self.config.standing_rad else self.config.stand_up_s
        return self._blend_from.copy()


_NO_TORQUE = np.zeros(JOINT_COUNT)
_NO_TORQUE.setflags(write=False)


def _per_joint(leg: float, wheel: float, arm: float) -> np.ndarray:
    """(22,) with one value per group of joints."""
    values = np.empty(JOINT_COUNT)
    values[LEG_SLICE], values[WHEEL_SLICE], values[ARM_SLICE] = leg, wheel, arm
    return values


def _frozen_damping(config: SafetyConfig) -> JointCommand:
    """Zero stiffness, pure damping."""
    damping = _per_joint(config.leg_damping, config.wheel_damping, config.arm_damping)
    damping.setflags(write=False)
    return JointCommand(_NO_TORQUE, _NO_TORQUE, _NO_TORQUE, damping, _NO_TORQUE)
