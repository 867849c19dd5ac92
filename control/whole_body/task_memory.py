"""What one tick cannot tell about the task: integrals of its errors, the reference's motion, the held wheel angles.

The model-based controller acts on them, and a policy observes them: it is memoryless itself, and as free of steady errors as
what it sees. Trained weights depend on their limits.
"""

from dataclasses import dataclass

import numpy as np

from control.joints import WHEEL_RADIUS_M
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed, record
from control.kernels.small_algebra import clip
from control.timing import CONTROL_PERIOD_S
from control.whole_body.task_signals import REST_VELOCITY, TASK_SIGNALS, force_error, position_error, stands

LEFT_MINUS_RIGHT = (1.0, -1.0, 1.0, -1.0)
"""Sign of each wheel FL, FR, RL, RR where the left ones work against the right ones."""

_FIRST_WHEEL = 12


@dataclass(frozen=True, slots=True)
class TaskMemoryConfig:
    """Attributes:
    position_limit_ms: m s, of the integrated position error.
    force_error_limit_n: force errors beyond it are not integrated.
    rest_force_n: a force felt, smoothed, that is smaller leaves a hand at rest that is asked for no force: an estimate may be
        off by as much for half a minute, and what its noise adds shall not move the hand little by little.
    felt_s: time constant of that smoothing.
    force_limit_ns: N s, of the integrated force error.
    still_mps: slower, a position reference stands still.
    still_s: after which a standing axis of a pressing hand lets go what friction holds.
    pressing_n: force felt, of one asked for, from which the hand presses.
    release_s: time constant of letting go.
    yaw_limit_rad: of the integrated yaw rate error.
    traction_smoothing: weight of the newest wheel torques in the steering traction.
    """

    position_limit_ms: float = 0.03
    force_error_limit_n: float = 8.0
    rest_force_n: float = 1.5
    felt_s: float = 0.2
    force_limit_ns: float = 1.2
    still_mps: float = 0.002
    still_s: float = 0.5
    pressing_n: float = 2.0
    release_s: float = 0.3
    yaw_limit_rad: float = 0.8
    traction_smoothing: float = 0.2


MEMORY_CONFIG = config_record(TaskMemoryConfig())
"""The numbers of TaskMemoryConfig."""

TASK_MEMORY = record(
    position_integral=3,
    force_integral=3,
    yaw_integral=(),
    reference_velocity=3,
    wheel_hold=4,
    steering_traction=(),
    reference=3,
    felt=3,
    anchor=3,
    rest=3,
    still_s=3,
    released=3,
    held=4,
    started=(),
    standing=(),
)
"""Zeros before the first step.

Fields:
    position_integral: m s; zero on force axes.
    force_integral: N s; zero on position axes; fades where no force is asked for and none is felt.
    yaw_integral: rad; zero without a yaw command.
    reference_velocity: m/s, of the position reference; zero on force axes.
    wheel_hold: rad, held wheel angle minus angle; zero while driving.
    steering_traction: N, mean push of the left wheels against the right ones.
    felt: N, the estimated force, smoothed.
    rest: m, where the hand was last moved to by a force on an axis that is asked for none.
    still_s: s, since the position reference moved.
    released: share, 0 to 1, by which a position axis carries no load: that of a pressing hand whose reference stands still,
        since what it feels is the friction that it makes.
    anchor: m, where the hand was when the axis began to be asked for no force.
    reference, held: position reference and held wheel angles of the last step; started, standing: 1 or 0, of the last step.
"""


@kernel("void(Config, Signals, Memory)", Config=MEMORY_CONFIG, Signals=TASK_SIGNALS, Memory=TASK_MEMORY)
def _remember(config: np.record, signals: np.record, memory: np.record) -> None:
    """Take in one control period of one robot: e <- clip(e + error dt, +-limit) while an axis keeps its mode."""
    command = signals.command
    pressing = False
    for i in range(3):
        felt = signals.force_estimated_n[i] if command.force_n[i] > 0.0 else -signals.force_estimated_n[i]
        pressing |= command.mask[i] > 0.5 and command.force_n[i] != 0.0 and felt > config.pressing_n
    for i in range(3):
        on_force = command.mask[i]
        integral = memory.position_integral[i] + CONTROL_PERIOD_S * position_error(signals, i)
        memory.position_integral[i] = (1.0 - on_force) * clip(integral, -config.position_limit_ms, config.position_limit_ms)
        # So large an error means that there is no contact yet: the integral waits.
        error = force_error(signals, i)
        error = error if abs(error) <= config.force_error_limit_n else 0.0
        memory.felt[i] += CONTROL_PERIOD_S / config.felt_s * (signals.force_estimated_n[i] - memory.felt[i])
        led = abs(memory.felt[i]) > config.rest_force_n
        if command.force_n[i] != 0.0 or led:
            integral = memory.force_integral[i] + CONTROL_PERIOD_S * error
        else:
            integral = (1.0 - CONTROL_PERIOD_S / config.release_s) * memory.force_integral[i]
        memory.force_integral[i] = on_force * clip(integral, -config.force_limit_ns, config.force_limit_ns)

        position = command.position_m[i]
        last = memory.reference[i] if memory.started > 0.0 else position
        memory.reference_velocity[i] = (1.0 - on_force) * (position - last) / CONTROL_PERIOD_S
        memory.reference[i] = position
        still = pressing and on_force < 0.5 and abs(memory.reference_velocity[i]) < config.still_mps
        memory.still_s[i] = memory.still_s[i] + CONTROL_PERIOD_S if still else 0.0
        memory.released[i] = clip(memory.still_s[i] / config.still_s - 1.0, 0.0, 1.0)
        memory.position_integral[i] *= 1.0 - memory.released[i] * CONTROL_PERIOD_S / config.release_s
        if on_force < 0.5 or command.force_n[i] != 0.0 or memory.started == 0.0:
            memory.anchor[i] = memory.rest[i] = signals.hand_position[i]
        elif led:
            memory.rest[i] = signals.hand_position[i]
    memory.started = 1.0

    yaw, standing = command.base_velocity[2], stands(signals)
    integral = memory.yaw_integral + CONTROL_PERIOD_S * (yaw - signals.yaw_rate)
    turning = abs(yaw) >= REST_VELOCITY
    memory.yaw_integral = clip(integral, -config.yaw_limit_rad, config.yaw_limit_rad) if turning else 0.0
    push = 0.0
    for wheel in range(4):
        angle = signals.joint_position[_FIRST_WHEEL + wheel]
        if memory.standing == 0.0:
            memory.held[wheel] = angle
        memory.wheel_hold[wheel] = memory.held[wheel] - angle if standing else 0.0
        push += LEFT_MINUS_RIGHT[wheel] * signals.joint_torque[_FIRST_WHEEL + wheel]
    memory.standing = 1.0 if standing else 0.0
    traction = push / (4.0 * WHEEL_RADIUS_M)
    memory.steering_traction += config.traction_smoothing * (traction - memory.steering_traction)


@kernel("void(Config[::1], Signals[::1], Memory[::1])", Config=MEMORY_CONFIG, Signals=TASK_SIGNALS, Memory=TASK_MEMORY)
def _remember_all(config: np.ndarray, signals: np.ndarray, memories: np.ndarray) -> None:
    """Take in one control period of every robot."""
    for robot in range(len(memories)):
        _remember(config[0], signals[robot], memories[robot])


class TaskMemory:
    """Integrates once per control period, for one robot or many.

    Attributes:
        values: TASK_MEMORY (n,), changed in place.
    """

    STATE = ("values",)

    def __init__(self, config: TaskMemoryConfig, count: int = 1) -> None:
        self._config = packed(MEMORY_CONFIG, config)
        self.values = np.zeros(count, TASK_MEMORY)

    def reset(self, index: np.ndarray | slice = slice(None)) -> None:
        """Forget everything, of all robots or of those at `index`."""
        self.values[index] = np.zeros((), TASK_MEMORY)

    def step(self, signals: np.ndarray) -> None:
        """Take in TASK_SIGNALS (n,) of one control period."""
        _remember_all(self._config, signals, self.values)
