"""The guidance case of the policy benchmark: how light each controller's hand is to lead, in eight directions.

Leads of one controller differ by more than two controllers do, so each direction is led several times, with the same seeds for
every controller, and controllers are compared lead by lead.
"""

from collections.abc import Sequence

import numpy as np

from sim.benchmarks.report import Bar, Row, at_most
from sim.processes.executors import map_unordered
from sim.trials.guidance_trials import LeadResult, lead
from sim.trials.trial import Trial, TrialSetup

CASE = "guidance"
ANGLES_DEG = tuple(range(0, 360, 45))
REPEATS = 4
"""Leads per direction."""


def play_lead(job: tuple[TrialSetup, int, int]) -> tuple[tuple[int, int], LeadResult]:
    """One lead `(setup, seed, angle in degrees)`, and which one it is; importable by an executor's processes."""
    setup, seed, angle_deg = job
    return (seed, angle_deg), lead(Trial(setup, seed), float(np.radians(angle_deg)))


def guide(setup: TrialSetup, seed: int, quick: bool, workers: int) -> list[LeadResult]:
    """Leads in every direction, each with a seed of its own, in order; in two with `quick`."""
    angles = ANGLES_DEG[::2][:2] if quick else ANGLES_DEG
    repeats = 1 if quick else REPEATS
    jobs = [(setup, seed + 1000 * repeat + angle, angle) for repeat in range(repeats) for angle in angles]
    return [result for _, result in sorted(map_unordered("local", play_lead, jobs, workers), key=lambda pair: pair[0])]


def guidance_row(setup: TrialSetup, results: Sequence[LeadResult]) -> Row:
    """One row: the heaviest lead, the mean over all, and the worst of what else was achieved."""
    forces = [result.largest_force_n for result in results]
    return {
        "case": CASE,
        "controller": setup.controller,
        "estimator": setup.estimator,
        "leads": len(results),
        "largest_force_n": max(forces),
        "mean_largest_force_n": float(np.mean(forces)),
        "hand_progress_m": min(result.hand_progress_m for result in results),
        "stop_s": max(result.stop_s for result in results),
        "falls": sum(result.fallen for result in results),
    }


def guidance_bars(name: str, results: Sequence[LeadResult], reference: Sequence[LeadResult]) -> list[Bar]:
    """A controller shall be at least as light to lead as `reference`, the same leads under the model-based one."""
    pairs = zip(results, reference, strict=True)
    heavier = float(np.mean([mine.largest_force_n - other.largest_force_n for mine, other in pairs]))
    return [at_most(f"{name}: heavier to lead than model_based, mean over leads", heavier, 0.0, "N")]
