"""Estimator benchmark: error of every force estimator under mass mismatch that it is not told (the paper's Table I).

    python -m sim.benchmarks.estimator [--profile hold sine slow] [--rollouts 10] [--mass-scale 0.8 1.0 1.2] [--per-link]
                                       [--ablations] [--workers N] [--quick] [--seed N] [--json PATH] [--plot DIR]

The seed draws a fresh test set; all estimators see the same rollouts. One that is no fair sample (a fall, a contact of
anything but wheels, a joint at its limit) is drawn again and counted, so the sample is conditioned on none of these.
"""

import argparse
import os
import sys
from functools import partial

from sim import scenes
from sim.benchmarks.estimator_ablations import ABLATIONS
from sim.benchmarks.estimator_plots import plot_bars, plot_force_over_time
from sim.benchmarks.estimator_rows import Cell, cell_bars, cell_rows, coverage_bars
from sim.benchmarks.estimator_trials import RolloutTrial, draw_plan, run_trial
from sim.benchmarks.report import Report, argument_parser
from sim.processes.executors import map_unordered
from sim.trials.rollout_plans import EVALUATION_PROFILES, MASS_SCALES, RolloutPlan

DURATION_S = 20.0
QUICK_DURATION_S = 4.0


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argument_parser("Error of every force estimator under mass mismatch that it is not told.")
    add_workers(parser)
    parser.add_argument("--profile", nargs="+", choices=EVALUATION_PROFILES, default=["hold"], help="of the force")
    parser.add_argument("--rollouts", type=int, default=10, metavar="N", help="per profile and mass scale (default 10)")
    parser.add_argument(
        "--mass-scale", type=float, nargs="+", metavar="SCALE", help="of every link (0.8 1.0 1.2; per link 1.0)"
    )
    parser.add_argument("--per-link", action="store_true", help="besides, scale every link by its own random 0.8-1.2")
    parser.add_argument("--ablations", action="store_true", help="besides, every estimator with one switch turned")
    arguments = parser.parse_args(words)
    if arguments.mass_scale is None:
        arguments.mass_scale = [1.0] if arguments.per_link else list(MASS_SCALES)
    return arguments


def add_workers(parser: argparse.ArgumentParser) -> None:
    """The option of benchmarks that play many trials."""
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="trials at a time (default: one per core)")


def cell_plans(arguments: argparse.Namespace) -> dict[Cell, list[RolloutPlan]]:
    """The rollouts of every line of the table."""
    links = scenes.build("free").robot_bodies if arguments.per_link else ()
    rollouts, duration_s = (1, QUICK_DURATION_S) if arguments.quick else (arguments.rollouts, DURATION_S)
    return {
        Cell(profile, mass_scale, arguments.per_link): [
            draw_plan(arguments.seed, number, profile, mass_scale, links, duration_s) for number in range(rollouts)
        ]
        for profile in arguments.profile
        for mass_scale in arguments.mass_scale
    }


def play(plans: list[RolloutPlan], ablations: bool, workers: int, report: Report) -> list[RolloutTrial]:
    """Trials of all plans, in order of profile, mass scale and number."""
    trials: list[RolloutTrial] = []
    run = partial(run_trial, ablations=ABLATIONS if ablations else ())
    for trial in map_unordered("local", run, plans, workers):
        trials.append(trial)
        errors = ", ".join(f"{name} {score.rmse_vector_n:.2f}" for name, score in trial.scores.items() if ":" not in name)
        outcome = f"{errors} N" if errors else "given up"
        if trial.rejected:
            outcome += f"; rejected: {', '.join(trial.rejected)}"
        plan = trial.plan
        report.progress(f"{len(trials)}/{len(plans)} {plan.profile} mass x{plan.mass_scale:g} no. {plan.index}: {outcome}")
    return sorted(trials, key=lambda trial: (trial.plan.profile, trial.plan.mass_scale, trial.plan.index))


def main() -> int:
    """Run the benchmark and report."""
    arguments = parse()
    report = Report("estimator", arguments.seed)
    cells = cell_plans(arguments)
    plans = [plan for cell in cells.values() for plan in cell]
    trials = play(plans, arguments.ablations, arguments.workers, report)
    for cell in cells:
        mine = [t for t in trials if (t.plan.profile, t.plan.mass_scale) == (cell.profile, cell.mass_scale)]
        rows = cell_rows(cell, mine)
        if not rows:
            report.progress(f"{cell}: every rollout was rejected, no row")
        report.rows += rows
        report.bars += cell_bars(cell, rows)
    report.bars += coverage_bars(trials)
    report.finish(arguments.json)
    if arguments.plot is not None and report.rows:
        plot_bars(arguments.plot, report.rows)
        for profile in arguments.profile:
            kept = {
                trial.plan.mass_scale: trial for trial in reversed(trials) if trial.scores and trial.plan.profile == profile
            }
            plot_force_over_time(arguments.plot, [kept[scale] for scale in sorted(kept)])
    return 0


if __name__ == "__main__":
    sys.exit(main())
