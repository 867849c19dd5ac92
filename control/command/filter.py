"""Rate limiting of the command, so that a jump of what is asked never yanks the robot."""

from dataclasses import replace

import numpy as np

from control.command.limits import DEFAULT_COMMAND, CommandLimits, HandState
from control.frames import quaternion_from_rotation, quaternion_multiply
from control.types import Command


class CommandFilter:
    """Rate limits every reference; starts at the measured hand and changes an axis' mode without a bump.

    The position reference of a force axis follows the hand, so that the axis holds where it is when it returns to
    position control; the force reference of an axis that turns to force control starts at the estimated force.
    """

    def __init__(self, limits: CommandLimits) -> None:
        self.limits = limits
        self.reset()

    def reset(self) -> None:
        """Start again from rest at the hand that the next step measures."""
        self._applied: Command | None = None
        self._velocity = np.zeros(3)
        self._turn_rate = 0.0

    def step(self, command: Command, hand: HandState, dt_s: float) -> Command:
        """The references to apply for the next `dt_s`.

        Args:
            command: within the limits, see clip_command.
            hand: measured hand, for starting and for changes of mode.
            dt_s: period of the caller.
        """
        last = self._applied
        if last is None:
            orientation = quaternion_from_rotation(hand.rotation_to_heading)
            last = replace(
                DEFAULT_COMMAND,
                mask=np.zeros(3),
                position_m=hand.position_in_heading,
                orientation_wxyz=orientation,
            )
        on_force = command.mask > 0.5
        entering = on_force & (last.mask < 0.5)
        force = np.where(entering, hand.force_estimated_n, last.force_n)
        self._applied = Command(
            mask=command.mask,
            force_n=np.where(on_force, _approach(force, command.force_n, self.limits.force_rate_nps * dt_s), 0.0),
            position_m=self._move(last.position_m, command.position_m, on_force, hand.position_in_heading, dt_s),
            orientation_wxyz=self._turn(last.orientation_wxyz, command.orientation_wxyz, dt_s),
            base_velocity=_approach(
                last.base_velocity, command.base_velocity, np.array(self.limits.velocity_acceleration) * dt_s
            ),
            guidance=command.guidance,
        )
        return self._applied

    def _move(
        self, last: np.ndarray, target: np.ndarray, on_force: np.ndarray, measured: np.ndarray, dt_s: float
    ) -> np.ndarray:
        acceleration = self.limits.position_acceleration_mps2
        error = np.where(on_force, 0.0, target - last)
        distance = float(np.linalg.norm(error))
        speed = _braking_speed(distance, self.limits.position_speed_mps, acceleration, dt_s)
        change = (speed / distance * error if distance > 0.0 else 0.0) - self._velocity
        size = float(np.linalg.norm(change))
        self._velocity = self._velocity + change * min(1.0, acceleration * dt_s / max(size, 1e-9))
        self._velocity[on_force] = 0.0
        return np.where(on_force, measured, last + self._velocity * dt_s)

    def _turn(self, last: np.ndarray, target: np.ndarray, dt_s: float) -> np.ndarray:
        acceleration = self.limits.orientation_acceleration_rps2
        relative = quaternion_multiply(target, last * [1.0, -1.0, -1.0, -1.0])
        if relative[0] < 0.0:
            relative = -relative
        sine = float(np.linalg.norm(relative[1:]))
        angle = 2.0 * float(np.arctan2(sine, relative[0]))
        speed = _braking_speed(angle, self.limits.orientation_speed_rps, acceleration, dt_s)
        self._turn_rate += float(np.clip(speed - self._turn_rate, -acceleration * dt_s, acceleration * dt_s))
        turn = min(self._turn_rate * dt_s, angle)
        if sine < 1e-9:
            return target
        step = np.concatenate([[np.cos(turn / 2.0)], np.sin(turn / 2.0) / sine * relative[1:]])
        turned = quaternion_multiply(step, last)
        return turned / np.linalg.norm(turned)


def _braking_speed(distance: float, limit: float, acceleration: float, dt_s: float) -> float:
    """Fastest speed from which a stop within `distance` is still possible, a little early for the discrete steps."""
    return min(limit, float(np.sqrt(1.4 * acceleration * distance)), distance / dt_s)


def _approach(value: np.ndarray, target: np.ndarray, step: float | np.ndarray) -> np.ndarray:
    """`value` moved towards `target` by at most `step` per element."""
    return value + np.clip(target - value, -step, step)
