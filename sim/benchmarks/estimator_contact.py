"""Estimator benchmark under real contact instead of applied wrenches: pressing a table, pushing a wall, sliding a box.

    python -m sim.benchmarks.estimator_contact [--trials 5] [--mass-scale 0.8 1.0 1.2] [--rigid] [--workers N]
                                               [--quick] [--seed N] [--json PATH] [--plot DIR]

Scored from 0.3 s after the first touch. Bars: `hybrid` at most 1.5 N vector RMSE in every task at every mass scale, and
never worse than `adaptive`, on padded surfaces; with --rigid also on rigid ones, for the record.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sim.benchmarks.estimator import add_workers
from sim.benchmarks.estimator_ablations import ORIGINALS
from sim.benchmarks.estimator_contact_tasks import DURATION_S, TASKS
from sim.benchmarks.estimator_contact_trials import ContactPlan, ContactTrial, run_contact_trial
from sim.benchmarks.estimator_plots import plot_estimates
from sim.benchmarks.estimator_scores import coverage, mean_and_deviation
from sim.benchmarks.report import Report, Row, argument_parser, at_most
from sim.processes.executors import map_unordered
from sim.trials.rollout_plans import MASS_SCALES
from sim.trials.rollout_runner import DRIVER

BAR_N = 1.5
QUICK_DURATION_S = 4.0


def contact_rows(task: str, surface: str, mass_scale: float, trials: Sequence[ContactTrial]) -> list[Row]:
    """One row per estimator: means over the trials that count."""
    kept = [trial for trial in trials if not trial.failure]
    if not kept:
        return []
    rows: list[Row] = []
    vector = {name: [trial.scores[name].rmse_vector_n for trial in kept] for name in kept[0].scores}
    for name, values in vector.items():
        scores = [trial.scores[name] for trial in kept]
        axes = np.mean([score.rmse_axes_n for score in scores], axis=0)
        mean, deviation = mean_and_deviation(values)
        original = ORIGINALS.get(name)
        rows.append(
            {
                "task": task,
                "surface": surface,
                "controller": DRIVER,
                "estimator": name,
                "mass_scale": mass_scale,
                "trials": len(kept),
                "failed": len(trials) - len(kept),
                "rmse_x_n": float(axes[0]),
                "rmse_y_n": float(axes[1]),
                "rmse_z_n": float(axes[2]),
                "rmse_vector_n": mean,
                "sd_n": deviation,
                "ratio_to_original": mean / float(np.mean(vector[original])) if original in vector else None,
                "coverage_2sigma": coverage(scores, 2.0),
                "contact_share": float(np.mean([trial.contact_share for trial in kept])),
                "rms_force_n": float(np.mean([trial.rms_force_n for trial in kept])),
                "ripple_n": float(np.mean([trial.ripple_n for trial in kept])),
            }
        )
    return rows


def plot(folder: Path, trials: Sequence[ContactTrial]) -> None:
    """The first trial of each task: every axis over time."""
    for number, task in enumerate(TASKS):
        trial = next((trial for trial in trials if trial.plan.task == number and not trial.failure), None)
        if trial is not None:
            path = folder / f"estimator_contact_{task.name.replace(' ', '_')}.png"
            series = [(f"{task.name}, {name}", axis, trial.force_true_n, trial.scores) for axis, name in enumerate("xyz")]
            plot_estimates(path, trial.time_s, series)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Error of every force estimator under real contact.")
    add_workers(parser)
    parser.add_argument("--trials", type=int, default=5, metavar="N", help="per task and mass scale (default 5)")
    parser.add_argument("--mass-scale", type=float, nargs="+", default=MASS_SCALES, metavar="SCALE", help="of every link")
    parser.add_argument("--rigid", action="store_true", help="besides, the same on rigid surfaces")
    arguments = parser.parse_args()
    report = Report("estimator_contact", arguments.seed)
    count, duration_s = (1, QUICK_DURATION_S) if arguments.quick else (arguments.trials, DURATION_S)
    surfaces = (True, False) if arguments.rigid else (True,)
    seeds = [arguments.seed * 1000 + number for number in range(count)]
    plans = {
        (task, padded, scale): [ContactPlan(task, padded, scale, seed, duration_s) for seed in seeds]
        for task in range(len(TASKS))
        for padded in surfaces
        for scale in arguments.mass_scale
    }
    trials = play([plan for cell in plans.values() for plan in cell], arguments.workers, report)
    for (number, padded, mass_scale), cell in plans.items():
        task = TASKS[number].name
        rows = contact_rows(task, "padded" if padded else "rigid", mass_scale, [trials[plan] for plan in cell])
        report.rows += rows
        for hybrid in (row for row in rows if padded and row["estimator"] == "hybrid"):
            case = f"{task}, mass x{mass_scale:g}"
            error, ratio = float(hybrid["rmse_vector_n"] or 0.0), float(hybrid["ratio_to_original"] or 0.0)
            report.bars.append(at_most(f"hybrid vector RMSE, {case}", error, BAR_N, "N"))
            report.bars.append(at_most(f"hybrid over the same without learning, {case}", ratio, 1.0, "1"))
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, [trials[plan] for cell in plans.values() for plan in cell])
    return 0


def play(plans: Sequence[ContactPlan], workers: int, report: Report) -> dict[ContactPlan, ContactTrial]:
    """All trials."""
    trials: dict[ContactPlan, ContactTrial] = {}
    for trial in map_unordered("local", run_contact_trial, plans, workers):
        plan = trial.plan
        trials[plan] = trial
        errors = ", ".join(f"{name} {score.rmse_vector_n:.2f}" for name, score in trial.scores.items())
        case = f"{TASKS[plan.task].name}, {'padded' if plan.padded else 'rigid'}, mass x{plan.mass_scale:g}"
        report.progress(f"{len(trials)}/{len(plans)} {case}: {trial.failure or errors + ' N'}")
    return trials


if __name__ == "__main__":
    sys.exit(main())
