"""Action law of the policy: joint targets from the network's action, for the robot and for every robot of a batch."""

from dataclasses import dataclass

import numpy as np

from control.joints import ARM_SLICE, DAMPING, JOINT_COUNT, NOMINAL_POSITION, STIFFNESS, WHEEL_SLICE
from control.kernels.compiled import kernel
from control.kernels.records import config_record, packed
from control.kernels.small_algebra import clip
from control.whole_body.reference_correction import CORRECTION
from control.whole_body.task_signals import TASK_SIGNALS


@dataclass(frozen=True, slots=True)
class ActionScales:
    """Scales of the action law, target = nominal + scale * action (Sec. II.E): rad for legs and arm, rad/s for wheels.

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


MAP = config_record(ActionScales(), nominal=JOINT_COUNT, unit=JOINT_COUNT)
"""The numbers of ActionScales, and per joint the target of action zero and of one unit of action: rad, wheels rad/s."""

_FIRST_WHEEL, _FIRST_ARM_JOINT = WHEEL_SLICE.start, ARM_SLICE.start


@kernel("f8[:,::1](Map[::1], matrix)", Map=MAP)
def _targets(scales: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Targets (n, 22) of actions (n, 22): nominal + unit * action."""
    k = scales[0]
    targets = np.empty(actions.shape)
    for robot in range(len(actions)):
        for joint in range(JOINT_COUNT):
            targets[robot, joint] = k.nominal[joint] + k.unit[joint] * actions[robot, joint]
    return targets


@kernel("f8[:,::1](Map[::1], matrix, matrix)", Map=MAP)
def _actions(scales: np.ndarray, targets: np.ndarray, corrections: np.ndarray) -> np.ndarray:
    """Actions (n, 22) of targets (n, 22), corrected in the leg joints, within the largest action.

    clip((target - nominal) / unit + clip(correction, +-correction_limit), +-limit); corrections (n, 22) are actions of a
    residual policy.
    """
    k = scales[0]
    actions = np.empty(targets.shape)
    for robot in range(len(targets)):
        for joint in range(JOINT_COUNT):
            action = (targets[robot, joint] - k.nominal[joint]) / k.unit[joint]
            if joint < _FIRST_WHEEL:
                action += clip(corrections[robot, joint], -k.correction_limit, k.correction_limit)
            actions[robot, joint] = clip(action, -k.limit, k.limit)
    return actions


@kernel("void(Map[::1], matrix, Correction[::1])", Map=MAP, Correction=CORRECTION)
def _correct_references(scales: np.ndarray, actions: np.ndarray, out: np.ndarray) -> None:
    """Corrections (n,) by the wheel and arm actions of a residual policy: unit * clip(action, +-correction_limit)."""
    k = scales[0]
    units = (k.base_forward_mps, k.base_turn_rps)
    for robot in range(len(actions)):
        for i in range(2):
            base = clip(actions[robot, _FIRST_WHEEL + i], -k.correction_limit, k.correction_limit)
            out[robot].base_velocity[i] = units[i] * base
        for i in range(3):
            linear = clip(actions[robot, _FIRST_ARM_JOINT + i], -k.correction_limit, k.correction_limit)
            angular = clip(actions[robot, _FIRST_ARM_JOINT + 3 + i], -k.correction_limit, k.correction_limit)
            out[robot].hand_velocity[i] = k.hand_velocity_mps * linear
            out[robot].hand_force[i] = k.hand_force_n * linear
            out[robot].hand_angular_velocity[i] = k.hand_turn_rps * angular


@kernel("f8[:,::1](Signals[::1])", Signals=TASK_SIGNALS)
def _held_targets(signals: np.ndarray) -> np.ndarray:
    """Targets (n, 22) under which the drives give the present torques: q + (tau + K_d dq) / K_p, wheels dq + tau / K_d."""
    targets = np.empty((len(signals), JOINT_COUNT))
    for robot in range(len(signals)):
        s = signals[robot]
        for joint in range(JOINT_COUNT):
            q, dq, torque = s.joint_position[joint], s.joint_velocity[joint], s.joint_torque[joint]
            if STIFFNESS[joint] == 0.0:
                targets[robot, joint] = dq + torque / DAMPING[joint]
            else:
                targets[robot, joint] = q + (torque + DAMPING[joint] * dq) / STIFFNESS[joint]
    return targets


class ActionMap:
    """Between actions (n, 22) and joint targets (n, 22), see ActionScales."""

    def __init__(self, scales: ActionScales | None = None) -> None:
        self.scales = scales = scales or ActionScales()
        self.unit = np.array([scales.leg_rad] * 12 + [scales.wheel_rps] * 4 + [scales.arm_rad] * 6)
        nominal = NOMINAL_POSITION.copy()
        nominal[WHEEL_SLICE] = 0.0
        self._map = packed(MAP, scales, nominal=nominal, unit=self.unit)
        self._nothing = np.zeros((1, JOINT_COUNT))

    def targets(self, actions: np.ndarray) -> np.ndarray:
        """Joint targets (n, 22) of actions."""
        return _targets(self._map, actions)

    def actions(self, targets: np.ndarray) -> np.ndarray:
        """Actions (n, 22) that ask for these targets, as far as actions can."""
        return _actions(self._map, targets, np.broadcast_to(self._nothing, targets.shape))

    def limited(self, actions: np.ndarray) -> np.ndarray:
        """Actions (n, 22) within the largest one."""
        return np.clip(actions, -self.scales.limit, self.scales.limit)

    def held_actions(self, signals: np.ndarray) -> np.ndarray:
        """Actions (n, 22) that keep the torques of TASK_SIGNALS (n,): what the previous ones were, whoever gave them."""
        return self.actions(_held_targets(signals))

    def corrected_actions(self, targets: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Actions (n, 22) of a residual policy's `actions` on top of the model-based controller's `targets`.

        The controller has been given what `reference_corrections` makes of the same actions; the legs' part is added here.
        """
        return _actions(self._map, targets, actions)

    def reference_corrections(self, actions: np.ndarray) -> np.ndarray:
        """CORRECTION (n,): what the actions (n, 22) of a residual policy add to what is asked of hand and base."""
        corrections = np.empty(len(actions), CORRECTION)
        _correct_references(self._map, actions, corrections)
        return corrections
