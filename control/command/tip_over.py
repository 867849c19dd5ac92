"""How much of a force the robot can bear at its hand before it tips over its wheels."""

import numpy as np

from control.robot_model import GRAVITY_MPS2, RobotModel

_AROUND = [0, 2, 3, 1]
"""FL, RL, RR, FR: the wheels counterclockwise, seen from above."""


def feasible_force_scale(
    force_n: np.ndarray, model: RobotModel, rotation_heading_to_world: np.ndarray, margin_m: float
) -> float:
    """Largest share, 0 to 1, of a force at the hand under which the centre of pressure stays within the wheels.

    Statics: the ground answers weight and force at the zero-moment point (Vukobratovic), which moves linearly with the force
    once multiplied by the load, and has to keep its distance from every line between neighbouring wheels. The wheels' mean
    height counts as the ground's.

    Args:
        force_n: (3,) N, environment on hand.
        model: at the robot's configuration.
        rotation_heading_to_world: (3, 3).
        margin_m: distance from the edges.

    Returns:
        1 where the whole force can be borne; 0 where the robot tips already and the force adds to it.
    """
    if not force_n.any():
        return 1.0
    contacts = model.wheel_contact_positions @ rotation_heading_to_world
    middle = contacts.mean(axis=0)
    hand = model.end_effector_position @ rotation_heading_to_world - middle
    mass_center = model.center_of_mass @ rotation_heading_to_world - middle
    corners = (contacts - middle)[_AROUND, :2]
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    beyond_edge = (inward * corners).sum(axis=1) + margin_m
    # Load times distance within each edge, less the margin: of the weight, and what the whole force adds.
    weight = model.total_mass * GRAVITY_MPS2
    of_weight = weight * (inward @ mass_center[:2] - beyond_edge)
    of_force = inward @ (hand[2] * force_n[:2] - force_n[2] * hand[:2]) + force_n[2] * beyond_edge
    tipping = of_force < 0.0
    shares = of_weight[tipping] / -of_force[tipping]
    return float(np.clip(shares.min(initial=1.0), 0.0, 1.0))
