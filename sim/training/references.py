"""The command filter (control.command.filter) for a whole batch: same limits, same profiles; a test compares them."""

import numpy as np

from control.command.limits import CommandLimits
from sim.training.batch_rotations import quaternion_products


class BatchedReferences:
    """Applied references of every robot, rate-limited towards the commands.

    Attributes:
        mask, force, position, base_velocity: (n, 3); orientation (n, 4) wxyz. As applied.
    """

    def __init__(self, count: int, limits: CommandLimits) -> None:
        self._limits = limits
        self.mask, self.force, self.position = (np.zeros((count, 3), order="F") for _ in range(3))
        self.base_velocity = np.zeros((count, 3), order="F")
        self.orientation = np.asfortranarray(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))
        self._velocity = np.zeros((count, 3), order="F")
        self._turn_rate = np.zeros((count, 1))

    def reset(self, ids: np.ndarray, hand_position: np.ndarray, hand_orientation: np.ndarray) -> None:
        """Start robots from rest at their measured hand: position (m, 3), orientation (m, 4), in heading."""
        for array in (self.mask, self.force, self.base_velocity, self._velocity, self._turn_rate):
            array[ids] = 0.0
        self.position[ids], self.orientation[ids] = hand_position, hand_orientation

    def step(self, command: "Commands", hand_position: np.ndarray, force_estimated_n: np.ndarray, dt_s: float) -> None:
        """Move towards the commands.

        Args:
            command: as asked, already within the limits.
            hand_position: (n, 3) m, measured, in heading.
            force_estimated_n: (n, 3) N, estimated, in heading.
            dt_s: control period.
        """
        limits = self._limits
        on_force = command.mask > 0.5
        start = np.where(on_force & (self.mask < 0.5), force_estimated_n, self.force)
        change = limits.force_rate_nps * dt_s
        self.force = np.where(on_force, _approach(start, command.force, change), 0.0)
        self._move(command.position, on_force, hand_position, dt_s)
        self._turn(command.orientation, dt_s)
        self.base_velocity = _approach(self.base_velocity, command.base_velocity, np.array(limits.velocity_acceleration) * dt_s)
        self.mask = command.mask.copy(order="F")

    def _move(self, target: np.ndarray, on_force: np.ndarray, measured: np.ndarray, dt_s: float) -> None:
        acceleration = self._limits.position_acceleration_mps2
        error = np.where(on_force, 0.0, target - self.position)
        distance = np.linalg.norm(error, axis=1, keepdims=True)
        speed = _braking_speed(distance, self._limits.position_speed_mps, acceleration, dt_s)
        change = speed / np.maximum(distance, 1e-12) * error - self._velocity
        size = np.linalg.norm(change, axis=1, keepdims=True)
        self._velocity = self._velocity + change * np.minimum(1.0, acceleration * dt_s / np.maximum(size, 1e-9))
        self._velocity[on_force] = 0.0
        self.position = np.where(on_force, measured, self.position + self._velocity * dt_s)

    def _turn(self, target: np.ndarray, dt_s: float) -> None:
        acceleration = self._limits.orientation_acceleration_rps2
        relative = quaternion_products(target, self.orientation * [1.0, -1.0, -1.0, -1.0])
        relative *= np.where(relative[:, :1] < 0.0, -1.0, 1.0)
        sine = np.linalg.norm(relative[:, 1:], axis=1, keepdims=True)
        angle = 2.0 * np.arctan2(sine, relative[:, :1])
        speed = _braking_speed(angle, self._limits.orientation_speed_rps, acceleration, dt_s)
        self._turn_rate += np.clip(speed - self._turn_rate, -acceleration * dt_s, acceleration * dt_s)
        turn = np.minimum(self._turn_rate * dt_s, angle)
        step = np.concatenate([np.cos(turn / 2.0), np.sin(turn / 2.0) / np.maximum(sine, 1e-9) * relative[:, 1:]], axis=1)
        turned = quaternion_products(step, self.orientation)
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        self.orientation = np.where(sine < 1e-9, target, turned)


class Commands:
    """Commands as asked: mask, force, position, base_velocity (n, 3) and orientation (n, 4) wxyz, in heading."""

    def __init__(self, count: int) -> None:
        self.mask, self.force, self.position = (np.zeros((count, 3), order="F") for _ in range(3))
        self.base_velocity = np.zeros((count, 3), order="F")
        self.orientation = np.asfortranarray(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))


def _braking_speed(distance: np.ndarray, limit: float, acceleration: float, dt_s: float) -> np.ndarray:
    return np.minimum(np.minimum(limit, np.sqrt(1.4 * acceleration * distance)), distance / dt_s)


def _approach(value: np.ndarray, target: np.ndarray, step: float | np.ndarray) -> np.ndarray:
    return value + np.clip(target - value, -step, step)
