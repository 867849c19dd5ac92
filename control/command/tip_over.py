"""How much of a force the robot can bear at its hand before it tips over its wheels."""

import math

import numpy as np

from control.kernels.compiled import kernel
from control.kernels.small_algebra import clip, rotate_back
from control.robot_model import GRAVITY_MPS2, RobotModel

_AROUND = (0, 2, 3, 1)
"""FL, RL, RR, FR: the wheels counterclockwise, seen from above."""


def feasible_force_scale(force_n: np.ndarray, model: RobotModel, margin_m: float, mass_scale: float = 1.0) -> float:
    """Largest share, 0 to 1, of a force at the hand under which the centre of pressure stays within the wheels.

    Args:
        force_n: (3,) N, environment on hand, in heading.
        model: at the robot's configuration.
        margin_m: distance from the edges, `CommandLimits.tip_over_margin_m`.
        mass_scale: of the robot, estimated over nominal.

    Returns:
        1 where the whole force can be borne; 0 where the robot tips already and the force adds to it.
    """
    if not force_n.any():
        return 1.0
    return _feasible_scale(
        force_n,
        model.wheel_contact_positions,
        model.end_effector_position,
        model.center_of_mass,
        model.rotation_heading_to_world,
        mass_scale * model.total_mass * GRAVITY_MPS2,
        margin_m,
    )


RELIEF_MPS, RELIEF_RPS = 2.0, 3.0
"""Base velocity towards a load of which nothing can be borne; less in proportion."""


def relief_velocity(force_n: np.ndarray, share: float) -> np.ndarray:
    """Base velocity (3,) [m/s, 0, rad/s] with which the robot drives under a load that would tip it.

    Args:
        force_n: (3,) N, felt at the hand, in heading.
        share: of it that can be borne, `feasible_force_scale`.
    """
    ahead, aside, _ = force_n / max(float(np.linalg.norm(force_n)), 1e-9)
    return (1.0 - share) * np.array([RELIEF_MPS * ahead, 0.0, RELIEF_RPS * aside])


@kernel("f8(vector, matrix, vector, vector, matrix, f8, f8)")
def _feasible_scale(
    force_n: np.ndarray,
    contacts: np.ndarray,
    hand: np.ndarray,
    mass_center: np.ndarray,
    heading: np.ndarray,
    weight_n: float,
    margin_m: float,
) -> float:
    """Statics: the ground answers weight and force at the zero-moment point (Vukobratovic).

    Multiplied by the load it moves linearly with the force, and it has to keep its distance from every line between
    neighbouring wheels. With inward normal n of an edge through c, from the middle of the wheels:

        W (n . m - n . c - margin) + s [n . (h_z f_xy - f_z h_xy) + f_z (n . c + margin)] >= 0

    Args:
        force_n: (3,) f, in heading.
        contacts: (4, 3) m, like `hand` h and `mass_center` m world-aligned. The wheels' mean height counts as the ground's.
        heading: (3, 3) heading to world.
        weight_n: W.
        margin_m: distance from the edges, `CommandLimits.tip_over_margin_m`.

    Returns:
        s.
    """
    points, middle = np.empty((6, 3)), np.zeros(3)
    for wheel in range(4):
        points[wheel, 0], points[wheel, 1], points[wheel, 2] = rotate_back(heading, contacts[wheel])
        for i in range(3):
            middle[i] += 0.25 * points[wheel, i]
    points[4, 0], points[4, 1], points[4, 2] = rotate_back(heading, hand)
    points[5, 0], points[5, 1], points[5, 2] = rotate_back(heading, mass_center)
    for point in range(6):
        for i in range(3):
            points[point, i] -= middle[i]
    hx, hy, hz = points[4]
    mx, my, _ = points[5]
    fx, fy, fz = force_n
    share = 1.0
    for edge in range(4):
        corner, following = points[_AROUND[edge]], points[_AROUND[(edge + 1) % 4]]
        along_x, along_y = following[0] - corner[0], following[1] - corner[1]
        length = math.hypot(along_x, along_y)
        nx, ny = -along_y / length, along_x / length
        beyond_edge = nx * corner[0] + ny * corner[1] + margin_m
        # Load times distance within the edge, less the margin: of the weight, and what the whole force adds.
        of_weight = weight_n * (nx * mx + ny * my - beyond_edge)
        of_force = nx * (hz * fx - fz * hx) + ny * (hz * fy - fz * hy) + fz * beyond_edge
        if of_force < 0.0:
            share = min(share, of_weight / -of_force)
    return clip(share, 0.0, 1.0)
