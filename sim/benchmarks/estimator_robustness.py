"""Estimator benchmark outside of what the estimators were made for; without bars.

    python -m sim.benchmarks.estimator_robustness [--trials 6] [--workers N] [--quick] [--seed N] [--json PATH] [--plot DIR]

Cases: the nominal rollout for comparison, torque constants off by 5 %, torques 10 ms late, a 10 degree slope, a wheel
lifted by a bump, and a 20 N step at a standing robot, after which the time is taken until the error stays below 2 N.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from control.timing import CONTROL_PERIOD_S
from sim.benchmarks.estimator import add_workers
from sim.benchmarks.estimator_plots import COLORS
from sim.benchmarks.estimator_robustness_trials import (
    CASES,
    DURATION_S,
    RobustnessPlan,
    RobustnessTrial,
    run_robustness_trial,
)
from sim.benchmarks.estimator_scores import coverage, mean_and_deviation
from sim.benchmarks.report import Report, Row, argument_parser
from sim.processes.executors import map_unordered
from sim.trials.rollout_runner import DRIVER

QUICK_DURATION_S = 4.0


def case_rows(case: str, trials: Sequence[RobustnessTrial]) -> list[Row]:
    """One row per estimator: means over the trials in which the disturbance was met."""
    kept = [trial for trial in trials if trial.scores]
    rows: list[Row] = []
    for name in kept[0].scores if kept else ():
        scores = [trial.scores[name] for trial in kept]
        mean, deviation = mean_and_deviation([score.rmse_vector_n for score in scores])
        times = [trial.recovery_s[name] for trial in kept if trial.recovery_s]
        recovered = [time for time in times if time is not None]
        rows.append(
            {
                "case": case,
                "controller": DRIVER,
                "estimator": name,
                "trials": len(kept),
                "rejected": sum(len(trial.rejected) for trial in trials),
                "scored_s": CONTROL_PERIOD_S * sum(len(score.error) for score in scores),
                "rmse_vector_n": mean,
                "sd_n": deviation,
                "coverage_2sigma": coverage(scores, 2.0),
                "recovery_s": float(np.mean(recovered)) if recovered else None,
                "recovered": len(recovered) if times else None,
            }
        )
    return rows


def plot(folder: Path, rows: Sequence[Row]) -> None:
    """Mean vector RMSE: one group of bars per case, one bar per estimator."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    cases = list(dict.fromkeys(str(row["case"]) for row in rows))
    names = list(dict.fromkeys(str(row["estimator"]) for row in rows))
    figure, panel = pyplot.subplots(figsize=(11.0, 4.0), layout="constrained")
    for index, name in enumerate(names):
        by_case = {row["case"]: float(row["rmse_vector_n"] or 0.0) for row in rows if row["estimator"] == name}
        places = np.arange(len(cases)) + 0.8 * index / len(names)
        heights = [by_case.get(case, np.nan) for case in cases]
        bars = panel.bar(places, heights, 0.8 / len(names), label=name, color=COLORS.get(name))
        panel.bar_label(bars, fmt="%.1f", fontsize=7)
    panel.set_xticks(np.arange(len(cases)) + 0.35, cases, fontsize=8)
    panel.set_ylabel("vector RMSE [N]")
    panel.spines[["top", "right"]].set_visible(False)
    figure.legend(ncols=len(names), fontsize=8, loc="outside upper center")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "estimator_robustness.png", dpi=120)
    pyplot.close(figure)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Error of every force estimator where the model does not hold.")
    add_workers(parser)
    parser.add_argument("--trials", type=int, default=6, metavar="N", help="per case (default 6)")
    arguments = parser.parse_args()
    report = Report("estimator_robustness", arguments.seed)
    count, duration_s = (1, QUICK_DURATION_S) if arguments.quick else (arguments.trials, DURATION_S)
    plans = [RobustnessPlan(case, n, arguments.seed, duration_s) for case in range(len(CASES)) for n in range(count)]
    trials: dict[RobustnessPlan, RobustnessTrial] = {}
    for trial in map_unordered("local", run_robustness_trial, plans, arguments.workers):
        trials[trial.plan] = trial
        errors = ", ".join(f"{name} {score.rmse_vector_n:.2f}" for name, score in trial.scores.items())
        outcome = f"{errors} N" if errors else "the disturbance was not met"
        if trial.rejected:
            outcome += f"; rejected: {', '.join(trial.rejected)}"
        report.progress(f"{len(trials)}/{len(plans)} {CASES[trial.plan.case].name}: {outcome}")
    for number, case in enumerate(CASES):
        report.rows += case_rows(case.name, [trials[plan] for plan in plans if plan.case == number])
    report.finish(arguments.json)
    if arguments.plot is not None and report.rows:
        plot(arguments.plot, report.rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
