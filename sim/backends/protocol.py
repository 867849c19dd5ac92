"""The seam between the pipeline and whatever it drives. Simulation and hardware differ behind it and nowhere else."""

from typing import Protocol

import numpy as np

from control.frames import rotation_from_quaternion, rotation_heading_to_world
from control.types import JointCommand, SensorFrame
from control.values import value


@value
class GroundTruth:
    """Simulator truth, for rewards, evaluation and the "true" trace only; never seen by control/.

    Attributes:
        base_position: (3,) m, in world.
        base_orientation_wxyz: (4,) base to world.
        base_linear_velocity: (3,) m/s, of the base origin, in world.
        base_angular_velocity: (3,) rad/s, in base.
        end_effector_position: (3,) m, in world.
        force_true_n: (3,) N, environment on end effector (applied wrenches and contacts), in heading.
        wheel_forces: (4, 3) N, ground on wheels, in heading.
        wheel_contact_positions: (4, 3) m, in world (the wheel's lowest point where it does not touch).
        wheel_in_contact: (4,) bool.
        object_positions, object_orientations_wxyz: (n, 3), (n, 4) world poses of the scene's movable bodies.
    """

    base_position: np.ndarray
    base_orientation_wxyz: np.ndarray
    base_linear_velocity: np.ndarray
    base_angular_velocity: np.ndarray
    end_effector_position: np.ndarray
    force_true_n: np.ndarray
    wheel_forces: np.ndarray
    wheel_contact_positions: np.ndarray
    wheel_in_contact: np.ndarray
    object_positions: np.ndarray
    object_orientations_wxyz: np.ndarray

    @property
    def rotation_heading_to_world(self) -> np.ndarray:
        """(3, 3), from the true orientation of the base."""
        return rotation_heading_to_world(rotation_from_quaternion(self.base_orientation_wxyz))


class BackendError(RuntimeError):
    """A backend cannot do what was asked; the message names the cure."""


class Backend(Protocol):
    """Drives one robot at 500 Hz: `read` then `write`, every tick.

    In simulation `write` also advances the world by one tick; on hardware it returns at once.
    """

    @property
    def name(self) -> str:
        """As in the snapshot and in REST: "simulation" or "hardware"."""
        ...

    def open(self) -> None:
        """Connect. Raises BackendError when the robot cannot be reached."""

    def read(self) -> SensorFrame:
        """Newest sensor frame."""
        ...

    def write(self, command: JointCommand) -> None:
        """Send one command to the drives. The safety gate has already passed it."""

    def truth(self) -> GroundTruth | None:
        """Ground truth of this tick, None where there is none."""
        ...

    def close(self) -> None:
        """Leave the drives in damping and disconnect."""
