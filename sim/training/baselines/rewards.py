"""What each method rewards the hand for; base, posture and penalties are the policy's (sim.training.rewards).

Portela et al.: exp(-|f - f_d| / tolerance) on every force axis, exp(-15 |x - x_d|^2) where positions are held.
UniFP: exp(-sharpness |x - (x_d + (f + f_cmd) / K)|_1), whatever an axis is asked for. Neither has a slope near the goal at its
published tolerance: an error of 5 N still earns 0.905 and 0.951 of it. `retuned` has it earn 1/e.
"""

from dataclasses import dataclass

import numpy as np

from control.baselines.force_signs import goal_offset, zhi_command
from control.baselines.zhi import STIFFNESS
from sim.training.rewards import RewardInput


@dataclass(frozen=True, slots=True)
class HandRewards:
    """Attributes:
    portela_tolerance_n: of the force.
    zhi_sharpness: 1/m, of the shifted goal.
    orientation, orientation_sharpness: of exp(-sharpness |sin(angle / 2)|), Portela's, which UniFP is given too, since the
        hand's orientation is commanded here.
    overall: factor that brings the sum to the size of the policy's.
    """

    portela_tolerance_n: float = 50.0
    zhi_sharpness: float = 2.0
    orientation: float = 2.5
    orientation_sharpness: float = 5.0
    overall: float = 0.05


PUBLISHED = HandRewards()
RETUNED = HandRewards(portela_tolerance_n=5.0, zhi_sharpness=STIFFNESS / 5.0)


def hand_reward(method: str, scales: HandRewards, state: RewardInput, mask: np.ndarray, force_n: np.ndarray) -> np.ndarray:
    """Reward (n,) of the hand.

    Args:
        method: "portela" or "zhi".
        scales: of the rewards.
        state: truth after a control period.
        mask: (n, 3) 1 on force axes.
        force_n: (n, 3) N, true, environment on hand, in heading.
    """
    tracked = {"portela": portela_tracking, "zhi": zhi_tracking}[method](scales, state, mask, force_n)
    angle = np.linalg.norm(state.orientation_error, axis=1)
    turned = scales.orientation * np.exp(-scales.orientation_sharpness * np.abs(np.sin(0.5 * angle)))
    return scales.overall * (tracked + turned)


def portela_tracking(scales: HandRewards, state: RewardInput, mask: np.ndarray, _: np.ndarray) -> np.ndarray:
    """(n,): 3 for each force axis and 3 for the position of the others, at best."""
    force = (mask * np.exp(-np.abs(state.force_error) / scales.portela_tolerance_n)).sum(axis=1)
    held = mask.min(axis=1) < 0.5
    position = np.exp(-15.0 * (state.position_error**2).sum(axis=1))
    return 3.0 * force + 3.0 * held * position


def zhi_tracking(scales: HandRewards, state: RewardInput, mask: np.ndarray, force_n: np.ndarray) -> np.ndarray:
    """(n,): 2 at best. On a force axis the goal is where the hand is, so that its shift alone is left."""
    asked = mask * (force_n - state.force_error)
    shift = goal_offset(force_n, zhi_command(asked), STIFFNESS)
    return 2.0 * np.exp(-scales.zhi_sharpness * np.abs(state.position_error - shift).sum(axis=1))
