"""Rate limiting of the command, so that a jump of what is asked never yanks the robot."""

import math
from dataclasses import replace

import numpy as np

from control.command.command_record import COMMAND, commands, from_record, to_record
from control.command.limits import LIMITS, CommandLimits, HandState, limits_record
from control.frames import quaternion_from_rotation, quaternion_multiply
from control.kernels.compiled import kernel
from control.kernels.records import record
from control.kernels.small_algebra import clip
from control.types import Command

FILTER_STATE = record(applied=COMMAND, velocity=3, turn_rate=())
"""References as applied, the velocity of the position reference (m/s) and the rate of the orientation reference (rad/s)."""


@kernel("f8(f8, f8, f8, f8)")
def _braking_speed(distance: float, limit: float, acceleration: float, dt_s: float) -> float:
    """Fastest speed from which a stop within `distance` is still possible, v = sqrt(2 a d), with 0.7 of a in reserve.

    In one period no farther than the target: discrete steps would pass it.
    """
    return min(limit, math.sqrt(1.4 * acceleration * distance), distance / dt_s)


@kernel("void(Limits, Command, vector, f8, State)", Limits=LIMITS, Command=COMMAND, State=FILTER_STATE)
def _move(limits: np.record, asked: np.record, hand_position: np.ndarray, dt_s: float, state: np.record) -> None:
    """Move the position reference at limited speed and acceleration; on force axes it follows the hand (3,), m."""
    applied, velocity = state.applied, state.velocity
    acceleration = limits.position_acceleration_mps2
    error, change = np.zeros(3), np.empty(3)
    for i in range(3):
        if asked.mask[i] < 0.5:
            error[i] = asked.position_m[i] - applied.position_m[i]
    distance = math.sqrt(error[0] ** 2 + error[1] ** 2 + error[2] ** 2)
    speed = _braking_speed(distance, limits.position_speed_mps, acceleration, dt_s)
    for i in range(3):
        change[i] = (speed / distance * error[i] if distance > 0.0 else 0.0) - velocity[i]
    size = math.sqrt(change[0] ** 2 + change[1] ** 2 + change[2] ** 2)
    share = min(1.0, acceleration * dt_s / max(size, 1e-9))
    for i in range(3):
        if asked.mask[i] < 0.5:
            velocity[i] += share * change[i]
            applied.position_m[i] += velocity[i] * dt_s
        else:
            velocity[i] = 0.0
            applied.position_m[i] = hand_position[i]


@kernel("void(Limits, vector, f8, State)", Limits=LIMITS, State=FILTER_STATE)
def _turn(limits: np.record, asked: np.ndarray, dt_s: float, state: np.record) -> None:
    """Turn the orientation reference the shortest way towards the quaternion asked for (4,) wxyz, at limited rate."""
    orientation = state.applied.orientation_wxyz
    acceleration = limits.orientation_acceleration_rps2
    conjugate = np.array([orientation[0], -orientation[1], -orientation[2], -orientation[3]])
    relative = quaternion_multiply(asked, conjugate)
    if relative[0] < 0.0:
        relative = -relative
    sine = math.sqrt(relative[1] ** 2 + relative[2] ** 2 + relative[3] ** 2)
    angle = 2.0 * math.atan2(sine, relative[0])
    speed = _braking_speed(angle, limits.orientation_speed_rps, acceleration, dt_s)
    state.turn_rate += clip(speed - state.turn_rate, -acceleration * dt_s, acceleration * dt_s)
    turned = asked * 1.0
    if sine >= 1e-9:
        turn = min(state.turn_rate * dt_s, angle)
        factor = math.sin(turn / 2.0) / sine
        step = np.array([math.cos(turn / 2.0), factor * relative[1], factor * relative[2], factor * relative[3]])
        turned = quaternion_multiply(step, orientation)
        turned /= math.sqrt(turned[0] ** 2 + turned[1] ** 2 + turned[2] ** 2 + turned[3] ** 2)
    for i in range(4):
        orientation[i] = turned[i]


@kernel("void(Limits, Command, vector, vector, f8, State)", Limits=LIMITS, Command=COMMAND, State=FILTER_STATE)
def _filter(
    limits: np.record,
    asked: np.record,
    hand_position: np.ndarray,
    force_estimated_n: np.ndarray,
    dt_s: float,
    state: np.record,
) -> None:
    """Move one robot's references; force and base velocity change by at most their rates times `dt_s`."""
    applied = state.applied
    for i in range(3):
        change = limits.force_rate_nps * dt_s
        if asked.mask[i] < 0.5:
            applied.force_n[i] = 0.0
        else:
            felt = clip(force_estimated_n[i], limits.force_n[0], limits.force_n[1])
            start = felt if applied.mask[i] < 0.5 else applied.force_n[i]
            applied.force_n[i] = start + clip(asked.force_n[i] - start, -change, change)
        change = limits.velocity_acceleration[i] * dt_s
        applied.base_velocity[i] += clip(asked.base_velocity[i] - applied.base_velocity[i], -change, change)
        applied.mask[i] = asked.mask[i]
    _move(limits, asked, hand_position, dt_s, state)
    _turn(limits, asked.orientation_wxyz, dt_s, state)


@kernel("void(Limits[::1], Command[::1], matrix, matrix, f8, State[::1])", Limits=LIMITS, Command=COMMAND, State=FILTER_STATE)
def filter_commands(
    limits: np.ndarray,
    asked: np.ndarray,
    hand_positions: np.ndarray,
    forces_estimated_n: np.ndarray,
    dt_s: float,
    states: np.ndarray,
) -> None:
    """Move the references of n robots by one period `dt_s`, each as CommandFilter does.

    Args:
        limits: LIMITS (1,).
        asked: COMMAND (n,), within the limits.
        hand_positions: (n, 3) m, measured, in heading.
        forces_estimated_n: (n, 3) N, in heading.
        dt_s: period of the caller.
        states: FILTER_STATE (n,), moved on.
    """
    for robot in range(len(states)):
        _filter(limits[0], asked[robot], hand_positions[robot], forces_estimated_n[robot], dt_s, states[robot])


class CommandFilter:
    """Rate limits every reference; starts at the measured hand and changes an axis' mode without a bump.

    The position reference of a force axis follows the hand, so that the axis holds where it is when it returns to
    position control; the force reference of an axis that turns to force control starts at the estimated force.
    """

    STATE = ("_state", "_started")

    def __init__(self, limits: CommandLimits) -> None:
        self.limits = limits
        self._limits = limits_record(limits)
        self._guidance_limits = limits_record(replace(limits, force_rate_nps=limits.guidance_force_rate_nps))
        self.reset()

    def reset(self) -> None:
        """Start again from rest at the hand that the next step measures."""
        self._state = np.zeros(1, FILTER_STATE)
        self._started = False

    def step(self, command: Command, hand: HandState, dt_s: float) -> Command:
        """The references to apply for the next `dt_s`.

        Args:
            command: within the limits, see clip_command.
            hand: measured hand, for starting and for changes of mode.
            dt_s: period of the caller.
        """
        if not self._started:
            self._started = True
            start = commands(1)
            start["position_m"] = hand.position_in_heading
            start["orientation_wxyz"] = quaternion_from_rotation(hand.rotation_to_heading)
            self._state["applied"] = start
        position, force = hand.position_in_heading[None], hand.force_estimated_n[None]
        limits = self._guidance_limits if command.guidance else self._limits
        filter_commands(limits, to_record(command), position, force, dt_s, self._state)
        return from_record(self._state["applied"], command.guidance)

    def drive_no_faster(self, velocity: np.ndarray, axes: np.ndarray) -> None:
        """Let the base velocity reference fall to that of the base (3,) where `axes` (3,) says so: it is stopped by then."""
        applied = self._state["applied"]["base_velocity"][0]
        slower = np.clip(velocity, np.minimum(applied, 0.0), np.maximum(applied, 0.0))
        applied[axes] = slower[axes]
