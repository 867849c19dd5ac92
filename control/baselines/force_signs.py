"""Signed adapters: what each method calls a force, and what this project does (environment on hand)."""

import numpy as np


def portela_command(force_n: np.ndarray) -> np.ndarray:
    """Command of Portela et al. (..., 3), N: the force of the environment on the gripper, as ours, `force_n` (..., 3)."""
    return force_n


def zhi_command(force_n: np.ndarray) -> np.ndarray:
    """Command of UniFP (..., 3), N: the force that the robot exerts, the negative of ours.

    Its goal is offset by (f_ext + f_cmd) / K, which is zero where the environment pushes back what the robot exerts.
    """
    return -force_n


def goal_offset(external_n: np.ndarray, command_n: np.ndarray, stiffness: float) -> np.ndarray:
    """UniFP's shift (..., 3) of the hand's goal, m: (f_ext + f_cmd) / K.

    Args:
        external_n: (..., 3) N, f_ext, environment on hand.
        command_n: (..., 3) N, f_cmd as UniFP counts it, see `zhi_command`.
        stiffness: N/m, K.
    """
    return (external_n + command_n) / stiffness
