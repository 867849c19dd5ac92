"""The hand as references and controllers see it: its pose in heading, and the force that it feels."""

import numpy as np

from control.command.limits import HandState
from control.kernels.compiled import kernel
from control.kernels.small_algebra import clip, rotate_back
from control.robot_model import RobotModel

_MOST_FELT_N = 50.0
"""Per axis, more than may be asked for. Beyond it the model is wrong (a tool that is not there): who obeyed would shake."""


@kernel("void(f8[::1], matrix, f8[:,::1], f8, vector, f8[::1], f8[:,::1], f8[::1])")
def _pose_and_force(
    hand: np.ndarray,
    hand_rotation: np.ndarray,
    heading: np.ndarray,
    base_height_m: float,
    force_estimated_n: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    force: np.ndarray,
) -> None:
    """Pose of the hand in heading, whose origin lies on the ground below the base: H^T x + h e_z, H^T R; and what it feels.

    Args:
        hand: (3,) m, x, world-aligned, from the base origin.
        hand_rotation: (3, 3) R, hand to world.
        heading: (3, 3) H, heading to world.
        base_height_m: h.
        force_estimated_n: (3,) N, in heading.
        position: (3,) m, the result, like
        rotation: (3, 3) hand to heading, and
        force: (3,) N, as far as controllers believe it.
    """
    position[0], position[1], position[2] = rotate_back(heading, hand)
    position[2] += base_height_m
    for axis in range(3):
        column = rotate_back(heading, hand_rotation[:, axis])
        rotation[0, axis], rotation[1, axis], rotation[2, axis] = column
        force[axis] = clip(force_estimated_n[axis], -_MOST_FELT_N, _MOST_FELT_N)


def hand_state(model: RobotModel, base_height_m: float, force_estimated_n: np.ndarray) -> HandState:
    """The hand at the configuration of the model.

    Args:
        model: updated.
        base_height_m: of the base origin above the ground.
        force_estimated_n: (3,) N, environment on hand, in heading.
    """
    position, rotation, force = np.empty(3), np.empty((3, 3)), np.empty(3)
    hand, hand_rotation, heading = model.end_effector_position, model.end_effector_rotation, model.rotation_heading_to_world
    _pose_and_force(hand, hand_rotation, heading, base_height_m, force_estimated_n, position, rotation, force)
    return HandState(position, rotation, force)
