"""The guidance case of the policy benchmark: how light each controller's hand is to lead, in eight directions."""

from collections.abc import Sequence

import numpy as np

from sim.benchmarks.guidance_trials import LeadResult, lead
from sim.benchmarks.policy_trials import ControllerTrial, TrialSetup
from sim.benchmarks.report import Bar, Row, at_most
from sim.executors import map_unordered

CASE = "guidance"
ANGLES_DEG = tuple(range(0, 360, 45))


def play_lead(job: tuple[TrialSetup, int, int]) -> LeadResult:
    """One lead `(setup, seed, angle in degrees)`; importable by an executor's processes."""
    setup, seed, angle_deg = job
    return lead(ControllerTrial(setup, seed), float(np.radians(angle_deg)))


def guide(setup: TrialSetup, seed: int, quick: bool, workers: int) -> list[LeadResult]:
    """Leads in every direction, each with a seed of its own; in two with `quick`."""
    angles = ANGLES_DEG[::2][:2] if quick else ANGLES_DEG
    return list(map_unordered("local", play_lead, [(setup, seed + angle, angle) for angle in angles], workers))


def guidance_row(name: str, results: Sequence[LeadResult]) -> Row:
    """One row: the heaviest lead, the mean over the directions, and the worst of what else was achieved."""
    forces = [result.largest_force_n for result in results]
    return {
        "case": CASE,
        "controller": name,
        "largest_force_n": max(forces),
        "mean_largest_force_n": float(np.mean(forces)),
        "hand_progress_m": min(result.hand_progress_m for result in results),
        "stop_s": max(result.stop_s for result in results),
        "falls": sum(result.fallen for result in results),
    }


def guidance_bars(row: Row, reference: Row) -> list[Bar]:
    """A controller shall be at least as light to lead as `reference`, the model-based one's row of the same run."""
    limit = float(reference["mean_largest_force_n"] or np.nan)
    value = float(row["mean_largest_force_n"] or np.nan)
    return [at_most(f"{row['controller']}: force of the leading hand, mean over directions", value, limit, "N")]
