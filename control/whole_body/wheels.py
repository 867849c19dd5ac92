"""Driving and turning by four wheels of fixed heading (skid steering)."""

import math
from dataclasses import dataclass

import numpy as np

from control.joints import DAMPING, TORQUE_LIMIT, WHEEL_RADIUS_M, WHEEL_SLICE
from control.kernels.compiled import kernel
from control.kernels.records import config_record, record
from control.kernels.small_algebra import clip
from control.timing import CONTROL_PERIOD_S
from control.whole_body.body_terms import BODY_TERMS
from control.whole_body.reference_correction import CORRECTION
from control.whole_body.task_memory import TASK_MEMORY
from control.whole_body.task_signals import TASK_SIGNALS, stands

_FIRST = WHEEL_SLICE.start
_HIPS, _THIGHS = (0, 3, 6, 9), (1, 4, 7, 10)


@dataclass(frozen=True, slots=True)
class WheelConfig:
    """Gains of the drive.

    Attributes:
        yaw_gain: of the yaw rate error; skid steering turns less than its kinematics. Wheels that spin faster also hold less
            against scrubbing sideways: with a gain of 1 the hips saturate in the turn of a hand led aside, and give it up.
        yaw_push_limit_rps: of what that adds: a hand jerked aside swings the robot, and the wheels shall not swing it on.
        yaw_integral_gain: 1/s.
        effort_start, effort_end: shares of its torque limit. Turning scrubs the wheels sideways and loads the hips: as the
            busiest of them goes from one to the other, the turn is given up. Saturated (1.0), a leg would splay and the robot
            fall.
        push_start, push_end: the same of the thighs, which bear what the wheels push. They follow the turn at once, so they
            stay below what a robot's drives take for long (sim.backends.hardware.limits).
        full_turn_support: load of the least loaded wheel over the mean load: below it the turn is given up in proportion.
        relief_time_s: in which a turn that was given up is taken up again.
        hold_gain: 1/s, of the wheel angles that are held while the robot is commanded to stand.
        hold_limit_rps: of the correction.
    """

    yaw_gain: float = 3.0
    yaw_push_limit_rps: float = 0.5
    yaw_integral_gain: float = 2.0
    effort_start: float = 0.9
    effort_end: float = 1.0
    push_start: float = 0.85
    push_end: float = 0.9
    full_turn_support: float = 0.3
    relief_time_s: float = 0.5
    hold_gain: float = 2.0
    hold_limit_rps: float = 1.0


WHEELS = config_record(WheelConfig(), joint_damping=4, joint_friction=4)
"""The numbers of WheelConfig, and the wheels' damping (N m s/rad) and dry friction (N m), compensated while they roll."""

WHEEL_STATE = record(given_up=(), held_shift=())
"""Share of the turn that is given up, and how far (rad) the stance has rolled the held wheels on; zeros at rest."""


@kernel("f8(Wheels, Signals, f8, State)", Wheels=WHEELS, Signals=TASK_SIGNALS, State=WHEEL_STATE)
def _bearable_turn(wheels: np.record, signals: np.record, support: float, state: np.record) -> float:
    """Share of the turn, 0 to 1, that the legs can bear; falls at once and recovers slowly."""
    effort = push = 0.0
    for joint in _HIPS:
        effort = max(effort, abs(signals.joint_torque[joint]) / TORQUE_LIMIT[joint])
    for joint in _THIGHS:
        push = max(push, abs(signals.joint_torque[joint]) / TORQUE_LIMIT[joint])
    bearable = clip((wheels.effort_end - effort) / (wheels.effort_end - wheels.effort_start), 0.0, 1.0)
    bearable *= clip((wheels.push_end - push) / (wheels.push_end - wheels.push_start), 0.0, 1.0)
    bearable *= clip(support / wheels.full_turn_support, 0.0, 1.0)
    state.given_up = max(1.0 - bearable, state.given_up - CONTROL_PERIOD_S / wheels.relief_time_s)
    return 1.0 - state.given_up


@kernel(
    "void(Wheels, Terms, Signals, Memory, Correction, vector, f8, f8, State, f8[:])",
    Wheels=WHEELS,
    Terms=BODY_TERMS,
    Signals=TASK_SIGNALS,
    Memory=TASK_MEMORY,
    Correction=CORRECTION,
    State=WHEEL_STATE,
)
def wheel_targets(
    wheels: np.record,
    terms: np.record,
    signals: np.record,
    memory: np.record,
    correction: np.record,
    wheel_torque: np.ndarray,
    support: float,
    shift_mps: float,
    state: np.record,
    out: np.ndarray,
) -> None:
    """Wheel velocity targets (4,), rad/s. Standing wheels hold their angles; driven ones roll at

        (v - share (w + K_p e + K_i int e) y) / r,  e = w - w_measured

    with y the distance of the contact to the left of the base.

    Args:
        correction: of the base velocity; its turn is given up with the rest.
        wheel_torque: (4,) N m, of the balance, fed forward through the drive's damping gain.
        support: load of the least loaded wheel over the mean load.
        shift_mps: speed at which the stance moves the wheels ahead under the trunk.
    """
    forward, yaw = signals.command.base_velocity[0], signals.command.base_velocity[2]
    shift = shift_mps / WHEEL_RADIUS_M
    if stands(signals):
        state.held_shift += shift * CONTROL_PERIOD_S
        for wheel in range(4):
            hold = wheels.hold_gain * (memory.wheel_hold[wheel] + state.held_shift)
            hold = clip(hold, -wheels.hold_limit_rps, wheels.hold_limit_rps)
            out[wheel] = wheel_torque[wheel] / DAMPING[_FIRST + wheel] + shift + hold
        return
    state.held_shift = 0.0
    push = clip(wheels.yaw_gain * (yaw - signals.yaw_rate), -wheels.yaw_push_limit_rps, wheels.yaw_push_limit_rps)
    turn = yaw + push + wheels.yaw_integral_gain * memory.yaw_integral
    turn = _bearable_turn(wheels, signals, support, state) * (turn + correction.base_velocity[1])
    for wheel in range(4):
        lateral = 0.0
        for i in range(3):
            lateral += terms.contacts[wheel, i] * terms.rotation_heading_to_world[i, 1]
        rolling = shift + (forward + correction.base_velocity[0] - turn * lateral) / WHEEL_RADIUS_M
        drag = wheels.joint_damping[wheel] * rolling + wheels.joint_friction[wheel] * math.tanh(rolling)
        out[wheel] = rolling + (wheel_torque[wheel] + drag) / DAMPING[_FIRST + wheel]
