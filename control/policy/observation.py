"""What the whole-body policy observes, eq. (17): one law for the robot and for every robot of a training batch.

Forms: "paper", the paper's 89 numbers; "memoryless", which adds what follows from the same tick, errors and the estimated
motion of the base; "extended", which adds integrals and references besides (control.whole_body.task_memory); "residual", which
observes the same but corrects the model-based controller (control.policy.policy_controller) instead of acting alone.
"""

import math
from dataclasses import dataclass

import numpy as np

from control.joints import JOINT_COUNT, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed
from control.kernels.small_algebra import clip
from control.timing import CONTROL_PERIOD_S
from control.whole_body.task_memory import TASK_MEMORY
from control.whole_body.task_signals import TASK_SIGNALS, force_error, position_error

GAIT_FREQUENCY_HZ = 1.5
"""Of the gait phase clock. Wheels never step, but the paper observes it."""

PAPER_FORM = "paper"
MEMORYLESS_FORM = "memoryless"
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


SCALES = config_record(ObservationScales())
"""The numbers of ObservationScales."""

_PAPER_SIZES = {
    "angular_velocity": 3,
    "gravity": 3,
    "base_velocity_command": 3,
    "position_command": 3,
    "orientation_command": 4,
    "mask": 3,
    "force_command": 3,
    "leg_position": 12,
    "arm_position": 6,
    "leg_velocity": 12,
    "wheel_velocity": 4,
    "arm_velocity": 6,
    "force_estimate": 3,
    "previous_action": JOINT_COUNT,
    "gait_phase": 2,
}
_EXTENSION_SIZES = {
    "position_error": 3,
    "orientation_error": 3,
    "reference_velocity": 3,
    "position_integral": 3,
    "force_error": 3,
    "force_integral": 3,
    "base_height": 1,
    "base_linear_velocity": 3,
    "velocity_error": 2,
    "yaw_integral": 1,
    "wheel_hold": 4,
    "steering_traction": 1,
}
_OF_MEMORY = {"reference_velocity", "position_integral", "force_integral", "yaw_integral", "wheel_hold", "steering_traction"}
_FORMS = {
    PAPER_FORM: _PAPER_SIZES,
    MEMORYLESS_FORM: _PAPER_SIZES | {name: size for name, size in _EXTENSION_SIZES.items() if name not in _OF_MEMORY},
    EXTENDED_FORM: _PAPER_SIZES | _EXTENSION_SIZES,
    RESIDUAL_FORM: _PAPER_SIZES | _EXTENSION_SIZES,
}


@kernel("i8(f4[:], i8, f8, f8, vector)")
def _put(out: np.ndarray, at: int, limit: float, scale: float, values: np.ndarray) -> int:
    """Write scale * values, clipped at +-limit, into `out` from index `at` on; where it ends."""
    for value in values:
        out[at] = clip(scale * value, -limit, limit)
        at += 1
    return at


@kernel("i8(Scales, Signals, vector, f8, f4[:])", Scales=SCALES, Signals=TASK_SIGNALS)
def _put_paper(scales: np.record, signals: np.record, action: np.ndarray, phase: float, out: np.ndarray) -> int:
    """Write the parts of _PAPER_SIZES in their order; where they end."""
    k, s, command = scales, signals, signals.command
    limit = k.limit
    q, dq = s.joint_position, s.joint_velocity
    velocity, position = np.empty(3), np.empty(3)
    for i in range(3):
        velocity[i] = k.base_velocity[i] * command.base_velocity[i]
        position[i] = command.position_m[i] - k.position_center_m[i]
    # Opposite quaternions are the same orientation.
    sign = -1.0 if command.orientation_wxyz[0] < 0.0 else 1.0
    at = _put(out, 0, limit, k.angular_velocity, s.angular_velocity)
    at = _put(out, at, limit, 1.0, s.gravity)
    at = _put(out, at, limit, 1.0, velocity)
    at = _put(out, at, limit, k.position, position)
    at = _put(out, at, limit, sign, command.orientation_wxyz)
    at = _put(out, at, limit, 1.0, command.mask)
    at = _put(out, at, limit, k.force, command.force_n)
    at = _put(out, at, limit, 1.0, q[:12] - NOMINAL_POSITION[:12])
    at = _put(out, at, limit, 1.0, q[16:] - NOMINAL_POSITION[16:])
    at = _put(out, at, limit, k.leg_velocity, dq[:12])
    at = _put(out, at, limit, k.wheel_velocity, dq[12:16])
    at = _put(out, at, limit, k.arm_velocity, dq[16:])
    at = _put(out, at, limit, k.force, s.force_estimated_n)
    at = _put(out, at, limit, 1.0, action)
    return _put(out, at, limit, 1.0, np.array([math.sin(phase), math.cos(phase)]))


@kernel("i8(Scales, Signals, Memory, i8, f4[:])", Scales=SCALES, Signals=TASK_SIGNALS, Memory=TASK_MEMORY)
def _put_extension(scales: np.record, signals: np.record, memory: np.record, at: int, out: np.ndarray) -> int:
    """Write the parts of _EXTENSION_SIZES in their order from index `at` on; where they end."""
    k, s, m, command = scales, signals, memory, signals.command
    limit = k.limit
    position, force, velocity = np.empty(3), np.empty(3), np.empty(2)
    for i in range(3):
        position[i], force[i] = position_error(s, i), force_error(s, i)
    velocity[0] = k.velocity_error[0] * (command.base_velocity[0] - s.base_linear_velocity[0])
    velocity[1] = k.velocity_error[1] * (command.base_velocity[2] - s.yaw_rate)
    at = _put(out, at, limit, k.position_error, position)
    at = _put(out, at, limit, k.orientation_error, s.orientation_error)
    at = _put(out, at, limit, k.reference_velocity, m.reference_velocity)
    at = _put(out, at, limit, k.position_integral, m.position_integral)
    at = _put(out, at, limit, k.force_error, force)
    at = _put(out, at, limit, k.force_integral, m.force_integral)
    at = _put(out, at, limit, k.base_height, np.array([s.base_height - NOMINAL_BASE_HEIGHT_M]))
    at = _put(out, at, limit, k.base_linear_velocity, s.base_linear_velocity)
    at = _put(out, at, limit, 1.0, velocity)
    at = _put(out, at, limit, k.yaw_integral, np.array([m.yaw_integral]))
    at = _put(out, at, limit, k.wheel_hold, m.wheel_hold)
    return _put(out, at, limit, k.steering_traction, np.array([m.steering_traction]))


@kernel(
    "void(Scales[::1], Signals[::1], Memory[::1], matrix, vector, b1, f4[:,::1])",
    Scales=SCALES,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
)
def _observe(
    scales: np.ndarray,
    signals: np.ndarray,
    memories: np.ndarray,
    actions: np.ndarray,
    phases: np.ndarray,
    extended: bool,
    out: np.ndarray,
) -> None:
    """Observations (n, size) float32 of n robots: scale * value of each part, clipped."""
    for robot in range(len(out)):
        end = _put_paper(scales[0], signals[robot], actions[robot], phases[robot], out[robot])
        if extended:
            _put_extension(scales[0], signals[robot], memories[robot], end, out[robot])


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
        self._packed = packed(SCALES, self.scales)
        self._sizes = _FORMS[form]
        self.size = sum(self._sizes.values())
        observed = _PAPER_SIZES if form == PAPER_FORM else _FORMS[EXTENDED_FORM]
        self._observed_size = sum(observed.values())
        kept = [np.arange(part.stop)[part] for name, part in _slices(observed).items() if name in self._sizes]
        self._kept = np.concatenate(kept) if self.size < self._observed_size else None

    @property
    def groups(self) -> dict[str, slice]:
        """Where each part lies in the observation, by name, in order."""
        return _slices(self._sizes)

    def assemble(self, signals: np.ndarray, memories: np.ndarray, actions: np.ndarray, phases: np.ndarray) -> np.ndarray:
        """Observations (n, size), float32.

        Args:
            signals: TASK_SIGNALS (n,) of this tick.
            memories: TASK_MEMORY (n,), already stepped with `signals`.
            actions: (n, 22) previous actions.
            phases: (n,) rad, gait phases.
        """
        observations = np.empty((len(signals), self._observed_size), np.float32)
        _observe(self._packed, signals, memories, actions, phases, self.form != PAPER_FORM, observations)
        return observations if self._kept is None else observations.take(self._kept, axis=1)


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    slices, start = {}, 0
    for name, size in sizes.items():
        slices[name] = slice(start, start + size)
        start += size
    return slices


def advance_phase(phase: np.ndarray) -> np.ndarray:
    """Gait phase one control period later, rad in [0, 2 pi)."""
    return (phase + 2.0 * np.pi * GAIT_FREQUENCY_HZ * CONTROL_PERIOD_S) % (2.0 * np.pi)
