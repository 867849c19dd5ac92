"""Rows and bars of the estimator benchmark, from its trials."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.benchmarks.estimator_ablations import ORIGINALS
from sim.benchmarks.estimator_scores import coverage, coverage_error, mean_and_deviation
from sim.benchmarks.estimator_trials import RolloutTrial
from sim.benchmarks.report import Bar, Row, at_least, at_most
from sim.trials.rollout_runner import DRIVER

REFERENCE = "gmo_cqp"
HYBRID_BARS_N = {"hold": 0.75, "sine": 1.0, "slow": 1.0}
HYBRID_PER_LINK_BAR_N = 1.2
HYBRID_PAPER_SHARE = 0.5
COVERAGE_RANGE = (0.92, 0.98)


@dataclass(frozen=True, slots=True)
class Cell:
    """One line of the paper's table: force profile, mass scale of every link, and whether links differ besides."""

    profile: str
    mass_scale: float
    per_link: bool

    def __str__(self) -> str:
        return f"{self.profile}, mass x{self.mass_scale:g}{', per link' if self.per_link else ''}"


def cell_rows(cell: Cell, trials: Sequence[RolloutTrial]) -> list[Row]:
    """One row per estimator: means over rollouts of each rollout's RMSE, as in the paper.

    A ratio compares the mean vector RMSE with that of `gmo_cqp`, and that of a learned correction or an ablation with the
    same estimate without it. Trials without scores count as rejected only.
    """
    kept = [trial for trial in trials if trial.scores]
    if not kept:
        return []
    vector = {name: [trial.scores[name].rmse_vector_n for trial in kept] for name in kept[0].scores}
    rows: list[Row] = []
    for name, values in vector.items():
        scores = [trial.scores[name] for trial in kept]
        axes = np.mean([score.rmse_axes_n for score in scores], axis=0)
        mean, deviation = mean_and_deviation(values)
        original = ORIGINALS.get(name)
        lags = [trial.lag_only_n[name] for trial in kept if name in trial.lag_only_n]
        rows.append(
            {
                "controller": DRIVER,
                "estimator": name,
                "profile": cell.profile,
                "mass_scale": cell.mass_scale,
                "per_link": cell.per_link,
                "rollouts": len(kept),
                "rejected": sum(len(trial.rejected) for trial in trials),
                "rmse_x_n": float(axes[0]),
                "rmse_y_n": float(axes[1]),
                "rmse_z_n": float(axes[2]),
                "rmse_vector_n": mean,
                "sd_n": deviation,
                "lag_only_n": float(np.mean(lags)) if lags else None,
                "ratio_to_gmo_cqp": mean / float(np.mean(vector[REFERENCE])),
                "ratio_to_original": mean / float(np.mean(vector[original])) if original in vector else None,
                "coverage_1sigma": coverage(scores, 1.0),
                "coverage_2sigma": coverage(scores, 2.0),
                "coverage_2sigma_se": coverage_error(scores, 2.0),
                "rms_force_n": float(np.mean([trial.rms_force_n for trial in kept])),
                "rms_slope_nps": float(np.mean([trial.rms_slope_nps for trial in kept])),
            }
        )
    return rows


def cell_bars(cell: Cell, rows: Sequence[Row]) -> list[Bar]:
    """What is asked of the learned corrections in one cell; nothing without rows."""
    if not rows:
        return []
    numbers = {row["estimator"]: {key: x for key, x in row.items() if isinstance(x, float)} for row in rows}
    hybrid = numbers["hybrid"]
    covered = hybrid["coverage_2sigma"]
    limit = HYBRID_PER_LINK_BAR_N if cell.per_link else HYBRID_BARS_N[cell.profile]
    bars = [
        at_most(f"hybrid vector RMSE, {cell}", hybrid["rmse_vector_n"], limit, "N"),
        at_most(f"hybrid over the same without learning, {cell}", hybrid["ratio_to_original"], 1.0, "1"),
        at_least(f"hybrid errors within 2 sigma, at least, {cell}", covered, COVERAGE_RANGE[0], "1"),
        at_most(f"hybrid errors within 2 sigma, at most, {cell}", covered, COVERAGE_RANGE[1], "1"),
    ]
    if cell.mass_scale != 1.0:
        share = numbers["hybrid_paper"]["ratio_to_gmo_cqp"]
        bars.append(at_most(f"hybrid_paper over gmo_cqp, {cell}", share, HYBRID_PAPER_SHARE, "1"))
    return bars


def coverage_bars(trials: Sequence[RolloutTrial]) -> list[Bar]:
    """Whether sigma says how large the errors of `hybrid` are, over a whole run; nothing without scores.

    A cell of ten robots is known to one or two points only (`coverage_2sigma_se`): the whole run tells more.
    """
    covered = coverage([trial.scores["hybrid"] for trial in trials if "hybrid" in trial.scores], 2.0)
    if covered is None:
        return []
    low, high = COVERAGE_RANGE
    return [
        at_least("hybrid errors within 2 sigma, all rollouts, at least", covered, low, "1"),
        at_most("hybrid errors within 2 sigma, all rollouts, at most", covered, high, "1"),
    ]
