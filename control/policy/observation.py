"""What the whole-body policy observes, eq. (rl_observation), for one robot and, by the same code, for a training batch.

Forms: "paper", the paper's 89 numbers; "extended", which adds errors, integrals and the estimated motion of the base
(control.policy.task_memory); "residual", which observes the same but corrects the model-based
controller (control.policy.policy_controller) instead
of acting alone. Everything is known on hardware: joint encoders and torques, the IMU, estimates made of them,
and the robot's own commands.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from control.estimation.rolling_contact import rolling_velocity
from control.frames import rotation_error, rotation_from_quaternion, rotation_heading_to_world
from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION, WHEEL_SLICE
from control.policy.task_memory import TaskMemory, TaskSignals
from control.timing import CONTROL_PERIOD_S
from control.whole_body.controller import ControllerInput

GAIT_FREQUENCY_HZ = 1.5
"""Of the gait phase clock. Wheels never step, but the paper observes it."""

PAPER_FORM = "paper"
EXTENDED_FORM = "extended"
RESIDUAL_FORM = "residual"


@dataclass(frozen=True, slots=True)
class ObservationScales:
    """Factor of each part: observation = scale * value, clipped at +-limit.

    Attributes:
        position_center_m: (3,) subtracted from the position reference first.
    """

    angular_velocity: float = 0.25
    base_velocity: tuple[float, float, float] = (2.0, 2.0, 1.0)
    position: float = 4.0
    position_center_m: tuple[float, float, float] = (0.55, 0.0, 0.5)
    force: float = 0.1
    leg_velocity: float = 0.1
    wheel_velocity: float = 0.05
    arm_velocity: float = 0.2
    position_error: float = 40.0
    orientation_error: float = 15.0
    reference_velocity: float = 2.0
    position_integral: float = 33.0
    force_integral: float = 0.8
    force_error: float = 0.5
    base_height: float = 10.0
    base_linear_velocity: float = 2.0
    velocity_error: tuple[float, float] = (15.0, 5.0)
    yaw_integral: float = 4.0
    wheel_hold: float = 2.0
    steering_traction: float = 0.02
    limit: float = 8.0


@dataclass(frozen=True, slots=True)
class _Sources:
    signals: TaskSignals
    memory: TaskMemory
    action: np.ndarray
    phase: np.ndarray


_Part = Callable[[_Sources, ObservationScales], np.ndarray]

_PAPER_PARTS: dict[str, tuple[int, _Part]] = {
    "angular_velocity": (3, lambda s, k: k.angular_velocity * s.signals.angular_velocity),
    "gravity": (3, lambda s, k: s.signals.gravity),
    "base_velocity_command": (3, lambda s, k: np.array(k.base_velocity) * s.signals.base_velocity),
    "position_command": (3, lambda s, k: k.position * (s.signals.position - np.array(k.position_center_m))),
    "orientation_command": (4, lambda s, k: np.where(s.signals.orientation[..., :1] < 0.0, -1.0, 1.0) * s.signals.orientation),
    "mask": (3, lambda s, k: s.signals.mask),
    "force_command": (3, lambda s, k: k.force * s.signals.force),
    "leg_position": (12, lambda s, k: s.signals.joint_position[..., LEG_SLICE] - NOMINAL_POSITION[LEG_SLICE]),
    "arm_position": (6, lambda s, k: s.signals.joint_position[..., ARM_SLICE] - NOMINAL_POSITION[ARM_SLICE]),
    "leg_velocity": (12, lambda s, k: k.leg_velocity * s.signals.joint_velocity[..., LEG_SLICE]),
    "wheel_velocity": (4, lambda s, k: k.wheel_velocity * s.signals.joint_velocity[..., WHEEL_SLICE]),
    "arm_velocity": (6, lambda s, k: k.arm_velocity * s.signals.joint_velocity[..., ARM_SLICE]),
    "force_estimate": (3, lambda s, k: k.force * s.signals.force_estimated_n),
    "previous_action": (JOINT_COUNT, lambda s, k: s.action),
    "gait_phase": (2, lambda s, k: np.concatenate([np.sin(s.phase), np.cos(s.phase)], axis=-1)),
}

_EXTENSION: dict[str, tuple[int, _Part]] = {
    "position_error": (3, lambda s, k: k.position_error * s.signals.position_error),
    "orientation_error": (3, lambda s, k: k.orientation_error * s.signals.orientation_error),
    "reference_velocity": (3, lambda s, k: k.reference_velocity * s.memory.reference_velocity),
    "position_integral": (3, lambda s, k: k.position_integral * s.memory.position_integral),
    "force_error": (3, lambda s, k: k.force_error * s.signals.force_error),
    "force_integral": (3, lambda s, k: k.force_integral * s.memory.force_integral),
    "base_height": (1, lambda s, k: k.base_height * (s.signals.base_height - NOMINAL_BASE_HEIGHT_M)),
    "base_linear_velocity": (3, lambda s, k: k.base_linear_velocity * s.signals.base_linear_velocity),
    "velocity_error": (2, lambda s, k: np.array(k.velocity_error) * s.signals.velocity_error),
    "yaw_integral": (1, lambda s, k: k.yaw_integral * s.memory.yaw_integral),
    "wheel_hold": (4, lambda s, k: k.wheel_hold * s.memory.wheel_hold),
    "steering_traction": (1, lambda s, k: k.steering_traction * s.memory.steering_traction),
}

_FORMS = {PAPER_FORM: _PAPER_PARTS, EXTENDED_FORM: _PAPER_PARTS | _EXTENSION, RESIDUAL_FORM: _PAPER_PARTS | _EXTENSION}


class Observation:
    """Assembles observations of one form. Stateless: memory, previous action and phase come from the caller."""

    def __init__(self, form: str, scales: ObservationScales | None = None) -> None:
        """
        Raises:
            ValueError: no such form.
        """
        if form not in _FORMS:
            raise ValueError(f"observation form {form!r} does not exist; the forms are {', '.join(_FORMS)}")
        self.form = form
        self.scales = scales or ObservationScales()
        self._parts = _FORMS[form]
        self.size = sum(size for size, _ in self._parts.values())

    @property
    def groups(self) -> dict[str, slice]:
        """Where each part lies in the observation, by name, in order."""
        groups, start = {}, 0
        for name, (size, _) in self._parts.items():
            groups[name] = slice(start, start + size)
            start += size
        return groups

    def assemble(self, signals: TaskSignals, memory: TaskMemory, action: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """Observation (..., size), float32.

        Args:
            signals: of this tick.
            memory: already stepped with `signals`.
            action: (..., 22) previous action.
            phase: (..., 1) rad, gait phase.
        """
        sources = _Sources(signals, memory, action, phase)
        parts = [part(sources, self.scales) for _, part in self._parts.values()]
        limit = self.scales.limit
        return np.clip(np.concatenate(parts, axis=-1, dtype=np.float32, casting="same_kind"), -limit, limit)


def advance_phase(phase: np.ndarray) -> np.ndarray:
    """Gait phase one control period later, rad in [0, 2 pi)."""
    return (phase + 2.0 * np.pi * GAIT_FREQUENCY_HZ * CONTROL_PERIOD_S) % (2.0 * np.pi)


def task_signals(inputs: ControllerInput) -> TaskSignals:
    """The signals of one robot, batch shape ()."""
    sensor, base, model, command = inputs.sensor, inputs.base, inputs.model, inputs.command
    rotation = base.rotation_base_to_world
    heading = rotation_heading_to_world(rotation)
    hand_position = model.end_effector_position @ heading
    hand_position[2] += base.height_m
    target = heading @ rotation_from_quaternion(command.orientation_wxyz)
    return TaskSignals(
        angular_velocity=base.angular_velocity_in_base,
        gravity=-rotation[2],
        base_linear_velocity=rolling_velocity(model) @ heading,
        base_height=np.array([base.height_m]),
        yaw_rate=rotation[2:] @ base.angular_velocity_in_base,
        joint_position=sensor.joint_position,
        joint_velocity=sensor.joint_velocity,
        joint_torque=sensor.joint_torque,
        hand_position=hand_position,
        orientation_error=rotation_error(target, model.end_effector_rotation) @ heading,
        force_estimated_n=inputs.force_estimated_n,
        mask=command.mask,
        force=command.force_n,
        position=command.position_m,
        orientation=command.orientation_wxyz,
        base_velocity=command.base_velocity,
    )
