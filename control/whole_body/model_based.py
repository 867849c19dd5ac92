"""The model-based whole-body controller: drives, tracks the hand and regulates its force, with nothing learned.

It is the fallback that is always there and the teacher of learned policies. Three parts share one tick: the arm tracks
the hand and its force (arm), the legs carry weight and hand force (legs), the wheels drive (wheels).
"""

from dataclasses import dataclass, field

import numpy as np

from control.command.axis_mask import force_share
from control.command.limits import CommandLimits
from control.joints import ARM_SLICE, JOINT_COUNT, WHEEL_SLICE
from control.kernels.compiled import kernel
from control.kernels.records import packed, record
from control.kernels.small_algebra import clip, rotate
from control.robot_model import RobotModel
from control.whole_body.arm import ARM, ArmConfig, arm_targets, border_hold, way_back
from control.whole_body.body_terms import BODY_TERMS, body_terms
from control.whole_body.controller import ControllerInput
from control.whole_body.legs import LEG_STATE, LEGS, LegConfig, ground_forces, leg_targets
from control.whole_body.reference_correction import CORRECTION, NO_CORRECTION
from control.whole_body.stance import STANCE, STANCE_STATE, StanceConfig, shifted_posture, stance_record
from control.whole_body.task_memory import TASK_MEMORY, TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import TASK_SIGNALS, task_signals
from control.whole_body.wheels import WHEEL_STATE, WHEELS, WheelConfig, wheel_targets


@dataclass(frozen=True, slots=True)
class ModelBasedConfig:
    """Gains of the parts, and the limits that hold the workspace."""

    arm: ArmConfig = field(default_factory=ArmConfig)
    legs: LegConfig = field(default_factory=LegConfig)
    stance: StanceConfig = field(default_factory=StanceConfig)
    wheels: WheelConfig = field(default_factory=WheelConfig)
    limits: CommandLimits = field(default_factory=CommandLimits)


GAINS = record(arm=ARM, legs=LEGS, stance=STANCE, wheels=WHEELS)
STATE = record(legs=LEG_STATE, stance=STANCE_STATE, wheels=WHEEL_STATE)
"""What the parts remember beside the task memory; zeros at the start."""


@kernel(
    "void(Gains, Terms, Signals, Memory, Correction, State, f8[:])",
    Gains=GAINS,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
    Correction=CORRECTION,
    State=STATE,
)
def _targets(
    gains: np.record,
    terms: np.record,
    signals: np.record,
    memory: np.record,
    correction: np.record,
    state: np.record,
    out: np.ndarray,
) -> None:
    """Joint targets (22,) of one robot, see `Controller.step`."""
    arm, command = gains.arm, signals.command
    share, back, hand_force = np.empty(3), np.empty(3), np.empty(3)
    way_back(arm, command.force_n, memory.anchor, signals.hand_position, back)
    for i in range(3):
        estimated = signals.force_estimated_n[i]
        share[i] = force_share(command.mask[i], command.force_n[i], estimated, arm.contact_share, arm.contact_noise_n)
        share[i] *= 1.0 - border_hold(back[i], estimated, arm.border_m)
        # The legs prepare for the force asked for, which is about to come, and for what is felt beyond it: a hand that is
        # pulled while nothing is asked for loads them all the same.
        surprise = estimated - command.force_n[i]
        surprise -= clip(surprise, -gains.legs.surprise_n, gains.legs.surprise_n)
        hand_force[i] = share[i] * (command.force_n[i] + surprise) + (1.0 - share[i]) * estimated
    hand_force[0], hand_force[1], hand_force[2] = rotate(terms.rotation_heading_to_world, hand_force)
    forces, posture, wheel_torque = np.empty((4, 3)), np.empty(12), np.empty(4)
    ground_forces(gains.legs, terms, signals, hand_force, forces)
    shifted_posture(gains.stance, terms, forces, state.stance, posture)
    support = leg_targets(gains.legs, terms, signals, forces, posture, state.legs, out[:12], wheel_torque)
    shift = state.stance.shift_velocity[0]
    wheels = out[12:16]
    wheel_targets(gains.wheels, terms, signals, memory, correction, wheel_torque, support, shift, state.wheels, wheels)
    arm_targets(arm, terms, signals, memory, correction, share, back, out[16:])


@kernel(
    "void(Gains[::1], Terms[:], Signals[::1], Memory[::1], Correction[::1], State[::1], f8[:,:])",
    Gains=GAINS,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
    Correction=CORRECTION,
    State=STATE,
)
def _all_targets(
    gains: np.ndarray,
    terms: np.ndarray,
    signals: np.ndarray,
    memories: np.ndarray,
    corrections: np.ndarray,
    states: np.ndarray,
    out: np.ndarray,
) -> None:
    """Joint targets (n, 22) of n robots."""
    for robot in range(len(states)):
        _targets(gains[0], terms[robot], signals[robot], memories[robot], corrections[robot], states[robot], out[robot])


class ModelBasedLaw:
    """The law of the model-based controller for n robots: the controller's own one, or those of a training batch."""

    STATE = ("_states",)

    def __init__(self, model: RobotModel, config: ModelBasedConfig, count: int = 1) -> None:
        """Takes limits, friction and kinematics of the nominal posture from `model`, which is left in that posture."""
        limits = config.limits
        self._gains = packed(
            GAINS,
            arm=packed(
                ARM,
                config.arm,
                lower=model.position_lower[ARM_SLICE],
                upper=model.position_upper[ARM_SLICE],
                workspace=np.transpose([limits.position_x_m, limits.position_y_m, limits.position_z_m]),
                shoulder=limits.shoulder_m,
                reach=limits.reach_m,
            ),
            legs=packed(LEGS, config.legs),
            stance=stance_record(config.stance, model),
            wheels=packed(
                WHEELS,
                config.wheels,
                joint_damping=model.joint_damping[WHEEL_SLICE],
                joint_friction=model.joint_friction[WHEEL_SLICE],
            ),
        )
        self._states = np.zeros(count, STATE)

    def reset(self, index: np.ndarray | slice = slice(None)) -> None:
        """Forget what the parts remember, of all robots or of those at `index`."""
        self._states[index] = np.zeros((), STATE)

    def targets(self, terms: np.ndarray, signals: np.ndarray, memories: np.ndarray, corrections: np.ndarray) -> np.ndarray:
        """Joint targets (n, 22), see `Controller.step`; once per control period.

        Args:
            terms: BODY_TERMS (n,).
            signals: TASK_SIGNALS (n,).
            memories: TASK_MEMORY (n,), already stepped with `signals`.
            corrections: CORRECTION (n,) of the references.
        """
        targets = np.empty((len(self._states), JOINT_COUNT))
        _all_targets(self._gains, terms, signals, memories, corrections, self._states, targets)
        return targets


class ModelBasedController:
    """Whole-body controller from the rigid-body model; implements `Controller`."""

    STATE = ("_law", "_memory")

    def __init__(self, model: RobotModel, config: ModelBasedConfig | None = None) -> None:
        self._law = ModelBasedLaw(model, config or ModelBasedConfig())
        self._memory = TaskMemory(TaskMemoryConfig())

    def reset(self) -> None:
        """Forget integrals and held angles."""
        self._law.reset()
        self._memory.reset()

    def step(self, inputs: ControllerInput) -> np.ndarray:
        """Joint targets (22,), see `Controller.step`."""
        signals = task_signals(inputs)
        self._memory.step(signals)
        return self._law.targets(body_terms(inputs.model), signals, self._memory.values, NO_CORRECTION)[0]
