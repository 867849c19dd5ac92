"""Estimator benchmark: error of every force estimator under mass mismatch that it is not told.

    python -m sim.benchmarks.estimator [--profile hold] [--rollouts 10] [--mass-scale 0.8 1.0 1.2] [--per-link]
                                       [--quick] [--seed N] [--json PATH] [--plot DIR]

All estimators see the same rollouts. A rollout in which the robot falls or leans on a joint's stop is drawn again and
counted, so the sample is conditioned on neither. Bar: `adaptive` at most 1.0 N vector RMSE at every mass scale, profile hold.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from control.joints import LEGS
from sim.benchmarks.estimator_trials import PROFILES, SETTLE_S, Scores, Trial, run_trial
from sim.benchmarks.report import Report, Row, argument_parser, at_most
from sim.rollout_plans import MASS_SCALES, PER_LINK_RANGE, RolloutPlan
from sim.rollout_runner import ATTEMPTS, RejectedError

BAR_N = 1.0
REFERENCE = "gmo_cqp"
LINKS = (
    "base",
    *(f"{leg}_{part}" for leg in LEGS for part in ("hip", "thigh", "calf", "wheel")),
    *(f"arm_link{index}" for index in range(1, 7)),
)


def draw_plan(arguments: argparse.Namespace, mass_scale: float, number: int) -> RolloutPlan:
    """Rollout `number` at one mass scale; the same number draws the same force, motion and frictions at every mass scale."""
    seed = arguments.seed * 100_000 + number * ATTEMPTS
    random = np.random.default_rng(seed)
    joint_friction, ground_friction = random.uniform(0.5, 1.5), random.uniform(0.75, 1.25)
    link_scales = random.uniform(*PER_LINK_RANGE, len(LINKS)).tolist()
    return RolloutPlan(
        index=number,
        split="test",
        seed=seed,
        profile=arguments.profile,
        mass_scale=mass_scale,
        per_link=dict(zip(LINKS, link_scales, strict=True)) if arguments.per_link else {},
        joint_friction_scale=joint_friction,
        ground_friction_scale=ground_friction,
        duration_s=4.0 if arguments.quick else 20.0,
    )


def run_plan(plan: RolloutPlan, report: Report) -> tuple[Trial | None, int]:
    """The first attempt that is not rejected, or None after ATTEMPTS, and how many were rejected."""
    for attempt in range(ATTEMPTS):
        try:
            return run_trial(replace(plan, seed=plan.seed + attempt)), attempt
        except RejectedError as reason:
            report.progress(f"mass x{plan.mass_scale:g} rollout {plan.index}: rejected, {reason}")
    return None, ATTEMPTS


def rows_of(trials: list[Trial], rejected: int, profile: str, mass_scale: float, per_link: bool) -> list[Row]:
    """One row per estimator: means over rollouts of each rollout's RMSE."""
    vector = {name: [trial.scores[name].rmse_vector_n for trial in trials] for name in trials[0].scores}
    rows: list[Row] = []
    for name, values in vector.items():
        axes = np.mean([trial.scores[name].rmse_axes_n for trial in trials], axis=0)
        rows.append(
            {
                "estimator": name,
                "profile": profile,
                "mass_scale": mass_scale,
                "per_link": per_link,
                "rollouts": len(trials),
                "rejected": rejected,
                "rmse_x_n": float(axes[0]),
                "rmse_y_n": float(axes[1]),
                "rmse_z_n": float(axes[2]),
                "rmse_vector_n": float(np.mean(values)),
                "sd_n": float(np.std(values, ddof=1)) if len(values) > 1 else None,
                "ratio_to_gmo_cqp": float(np.mean(values) / np.mean(vector[REFERENCE])),
                "coverage_2sigma": coverage([trial.scores[name] for trial in trials]),
                "rms_force_n": float(np.mean([trial.rms_force_n for trial in trials])),
                "rms_slope_nps": float(np.mean([trial.rms_slope_nps for trial in trials])),
            }
        )
    return rows


def coverage(scores: list[Scores]) -> float | None:
    """Share of errors within two of the estimator's own standard deviations; None where it gives none."""
    inside = np.concatenate([np.abs(score.error) <= 2.0 * score.sigma for score in scores])
    known = np.concatenate([np.isfinite(score.sigma) for score in scores])
    return float(inside[known].mean()) if known.any() else None


def plot(folder: Path, trials: dict[float, Trial]) -> None:
    """Force of the first rollout at each mass scale: truth and every estimate."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    folder.mkdir(parents=True, exist_ok=True)
    for mass_scale, trial in trials.items():
        figure, panels = pyplot.subplots(3, 1, sharex=True, figsize=(9, 7))
        for axis, panel in enumerate(panels):
            for name, force in trial.force_estimated.items():
                panel.plot(SETTLE_S + 0.02 * np.arange(len(force)), force[:, axis], label=name, linewidth=0.8)
            panel.plot(SETTLE_S + 0.02 * np.arange(len(trial.force_true)), trial.force_true[:, axis], "k", label="true")
            panel.set_ylabel(f"force {'xyz'[axis]} [N]")
        panels[0].legend(ncols=4)
        panels[-1].set_xlabel("time [s]")
        figure.tight_layout()
        figure.savefig(folder / f"estimator_mass_{mass_scale:g}.png", dpi=120)
        pyplot.close(figure)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Error of every force estimator under mass mismatch that it is not told.")
    parser.add_argument("--profile", choices=PROFILES, default="hold", help="of the force (default hold)")
    parser.add_argument("--rollouts", type=int, default=10, metavar="N", help="per mass scale (default 10)")
    parser.add_argument("--mass-scale", type=float, nargs="+", default=MASS_SCALES, metavar="SCALE", help="of every link")
    parser.add_argument("--per-link", action="store_true", help="besides, scale every link by its own random 0.8-1.2")
    arguments = parser.parse_args()
    report = Report("estimator", arguments.seed)
    first: dict[float, Trial] = {}
    for mass_scale in arguments.mass_scale:
        trials, rejected = [], 0
        for number in range(1 if arguments.quick else arguments.rollouts):
            trial, attempts = run_plan(draw_plan(arguments, mass_scale, number), report)
            rejected += attempts
            if trial is None:
                continue
            trials.append(trial)
            errors = ", ".join(f"{name} {score.rmse_vector_n:.2f} N" for name, score in trial.scores.items())
            report.progress(f"mass x{mass_scale:g} rollout {number}: {errors}")
        if not trials:
            report.progress(f"mass x{mass_scale:g}: every rollout was rejected, no row")
            continue
        first[mass_scale] = trials[0]
        rows = rows_of(trials, rejected, arguments.profile, mass_scale, arguments.per_link)
        report.rows += rows
        if arguments.profile == "hold" and not arguments.per_link:
            adaptive = next(row for row in rows if row["estimator"] == "adaptive")
            error = float(adaptive["rmse_vector_n"] or 0.0)
            report.bars.append(at_most(f"adaptive vector RMSE at mass x{mass_scale:g}", error, BAR_N, "N"))
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, first)
    return 0


if __name__ == "__main__":
    sys.exit(main())
