"""The score by which checkpoints are chosen: the full model, the real estimator in the loop, and the box.

Each part is the ratio of an error to its bar, so 1 is the bar; the score is their mean, and less is better. Training reward
and box dragging can go different ways, so the reward alone does not choose.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from control.controller import Controller
from control.robot_model import RobotModel
from sim.benchmarks.policy_trials import Errors, TrialSetup, drag_box, random_commands

BARS = {
    "velocity_mps": 0.05,
    "yaw_rps": 0.10,
    "position_cm": 1.2,
    "force_10_n": 1.5,
    "force_20_n": 2.0,
    "box_y_n": 0.8,
    "box_z_n": 1.5,
}
FALL_COST = 1.0
"""What one fall in the score's trials adds."""


@dataclass(frozen=True, slots=True)
class Score:
    """`total` is the mean of `parts` over their bars, plus FALL_COST per fall."""

    total: float
    parts: dict[str, float]
    falls: int


def rms(values: np.ndarray) -> float:
    """Root mean square over everything that is not NaN; NaN when nothing is left."""
    kept = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan")


def settled_position_cm(errors: Errors) -> float:
    """RMS length of the settled position error over the position axes of each sample, cm; NaN without any."""
    position = np.array(errors.position)
    held = np.isfinite(position).any(axis=1) if position.size else np.zeros(0, bool)
    return 100.0 * rms(np.sqrt(np.nansum(position[held] ** 2, axis=1))) if held.any() else float("nan")


def score_controller(
    name: str, make: Callable[[RobotModel], Controller] | None, seed: int, minutes: float, estimator: str = "adaptive"
) -> Score:
    """Score a controller on `minutes` of random commands and one box drag.

    Args:
        name, make: see TrialSetup.
        seed: of the trials.
        minutes: robot-minutes of random commands.
        estimator: that feeds the controller.
    """
    setup = TrialSetup(controller=name, make=make, estimator=estimator)
    errors = random_commands(setup, seed, minutes)
    box = drag_box(setup, seed)
    parts = {
        "velocity_mps": rms(np.array(errors.forward)),
        "yaw_rps": rms(np.array(errors.yaw)),
        "position_cm": settled_position_cm(errors),
        "force_10_n": rms(errors.force_at(10.0)),
        "force_20_n": rms(errors.force_at(20.0)),
        "box_y_n": box.error_y_n,
        "box_z_n": box.error_z_n,
    }
    ratios = [parts[part] / bar for part, bar in BARS.items() if np.isfinite(parts[part])]
    falls = errors.falls + (not box.kept)
    return Score(float(np.mean(ratios)) + FALL_COST * falls, parts, falls)
