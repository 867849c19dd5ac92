"""The score by which checkpoints are chosen: the full model, the real estimator in the loop, and the box.

Each part is the ratio of an error to its bar, so 1 is the bar; the score is their mean, and less is better. Training reward
and box dragging can go different ways, so the reward alone does not choose.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from control.robot_model import RobotModel
from control.whole_body.controller import Controller
from sim.processes.executors import map_unordered
from sim.trials.box_drag import DragResult, drag_box
from sim.trials.random_commands import Errors, random_commands, rms, settled_position_cm
from sim.trials.trial import TrialSetup

BARS = {
    "velocity_mps": 0.05,
    "yaw_rps": 0.10,
    "position_cm": 1.2,
    "orientation_deg": 2.0,
    "force_10_n": 1.5,
    "force_20_n": 2.0,
    "box_y_n": 0.8,
    "box_z_n": 1.5,
}
MASS_SCALES = (0.8, 1.0, 1.2)
"""Of the robot, which the controller is not told: a third of the random commands and a box drag each."""

FALL_COST = 1.0
"""What one fall in the score's trials adds."""


@dataclass(frozen=True, slots=True)
class Score:
    """`total` is the mean of `parts` over their bars, plus FALL_COST per fall."""

    total: float
    parts: dict[str, float]
    falls: int


def score_controller(
    name: str, make: Callable[[RobotModel], Controller] | None, seed: int, minutes: float, workers: int = 1
) -> Score:
    """Score a controller on `minutes` of random commands and a box drag at each mass scale.

    Args:
        name, make: see TrialSetup; picklable.
        seed: of the trials.
        minutes: robot-minutes of random commands.
        workers: trials at a time; they do not change the score.
    """
    setup = TrialSetup(controller=name, make=make)
    jobs = []
    for index, scale in enumerate(MASS_SCALES):
        scaled = replace(setup, mass_scale=scale)
        jobs += [(scaled, seed + 100 * index, minutes / len(MASS_SCALES)), (scaled, seed + index, 0.0)]
    # The long ones first.
    results = list(map_unordered("local", _trial, sorted(jobs, key=lambda job: -job[2]), workers))
    boxes = [result for result in results if isinstance(result, DragResult)]
    errors = Errors()
    for result in results:
        if isinstance(result, Errors):
            errors.add(result)
    parts = {
        "velocity_mps": rms(np.array(errors.forward)),
        "yaw_rps": rms(np.array(errors.yaw)),
        "position_cm": settled_position_cm(errors),
        "orientation_deg": float(np.degrees(rms(np.array(errors.orientation)))),
        "force_10_n": rms(errors.force_at(10.0)),
        "force_20_n": rms(errors.force_at(20.0)),
        "box_y_n": float(np.mean([box.error_y_n for box in boxes])),
        "box_z_n": float(np.mean([box.error_z_n for box in boxes])),
    }
    ratios = [parts[part] / bar for part, bar in BARS.items() if np.isfinite(parts[part])]
    falls = errors.falls + sum(not box.kept for box in boxes)
    return Score(float(np.mean(ratios)) + FALL_COST * falls, parts, falls)


def _trial(job: tuple[TrialSetup, int, float]) -> Errors | DragResult:
    """Random commands for some minutes, or with none a box drag; importable by other processes."""
    setup, seed, minutes = job
    return random_commands(setup, seed, minutes) if minutes > 0.0 else drag_box(setup, seed)
