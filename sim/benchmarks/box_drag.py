"""Box dragging (paper Sec. III.D, Table II): press on a box with 20 N and drag it sideways by a sinusoidal force of 8 N.

    python -m sim.benchmarks.box_drag [--quick] [--controllers NAME ...] [--weights DIR] [--trials N] [--workers N]
                                      [--json PATH] [--plot DIR]

Ten trials for each controller at mass scales 0.8, 1.0 and 1.2, on the full stack as it ships: a row for each trial, a summary
of each ten, and the paper's table. The paper does not give its box; ours is chosen to move by its +-0.2 m, so its figures
(0.98 N, 3.98 N, [-0.205, 0.220] m) are a reference, not a contest. Controllers: `model_based`, ours (`policy`, `policy_paper`),
and those that the paper compares with (`portela`, `zhi`), whose rows say how far their training got.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from control.paths import WEIGHTS_DIRECTORY
from sim.benchmarks.box_drag_table import estimate_row, manifests, plot_forces, plot_learning, table_two, training_row
from sim.benchmarks.estimator import add_workers
from sim.benchmarks.report import Report, Row, argument_parser, at_most
from sim.processes.executors import map_unordered
from sim.trials.box_drag import DragResult, drag_box
from sim.trials.trial import SHIPPED_ESTIMATOR, TrialSetup, controller_setups

MASS_SCALES = (0.8, 1.0, 1.2)
TRAVEL_M = 0.2
PAPER_ERRORS_N = (0.98, 3.98)
"""Of the paper's own controller, lateral and vertical."""


def play(job: tuple[TrialSetup, int, int]) -> tuple[TrialSetup, int, DragResult]:
    """One drag `(setup, trial, seed)`; importable by an executor's processes."""
    setup, trial, seed = job
    return setup, trial, drag_box(setup, seed)


def trial_row(setup: TrialSetup, trial: int, result: DragResult) -> Row:
    """One row: force errors and extrema of the box in one trial."""
    return {
        "controller": setup.controller,
        "estimator": setup.estimator,
        "mass_scale": setup.mass_scale,
        "trial": trial,
        "e_y_n": result.error_y_n,
        "e_z_n": result.error_z_n,
        "y_min_m": result.box_low_m,
        "y_max_m": result.box_high_m,
        "contact_kept": result.kept,
        **(estimate_row([result.trace]) if result.trace else {}),
    }


def summary(setup: TrialSetup, results: list[DragResult]) -> Row:
    """Means and sample standard deviations over the trials of a setup."""
    error_y, error_z = np.array([r.error_y_n for r in results]), np.array([r.error_z_n for r in results])
    several = len(results) > 1
    return {
        "controller": setup.controller,
        "estimator": setup.estimator,
        "mass_scale": setup.mass_scale,
        "e_y_n": float(error_y.mean()),
        "e_y_sd_n": float(error_y.std(ddof=1)) if several else None,
        "e_z_n": float(error_z.mean()),
        "e_z_sd_n": float(error_z.std(ddof=1)) if several else None,
        "y_min_m": float(np.mean([r.box_low_m for r in results])),
        "y_max_m": float(np.mean([r.box_high_m for r in results])),
        "contact_lost": sum(not r.kept for r in results),
        "trials": len(results),
        **estimate_row([r.trace for r in results if r.trace]),
    }


def add_bars(report: Report, row: Row) -> None:
    """The bars of one controller at one mass scale."""
    label = f"{row['controller']} at mass {row['mass_scale']}"
    extremum = max(abs(float(row["y_min_m"] or 0.0) + TRAVEL_M), abs(float(row["y_max_m"] or 0.0) - TRAVEL_M))
    report.bars += [
        at_most(f"{label}: lateral force RMSE", float(row["e_y_n"] or np.nan), 0.8, "N"),
        at_most(f"{label}: vertical force RMSE", float(row["e_z_n"] or np.nan), 1.5, "N"),
        at_most(f"{label}: extrema of the box off +-0.2 m", extremum, 0.02, "m"),
        at_most(f"{label}: drags that lost contact", float(row["contact_lost"] or 0), 0, "1"),
    ]
    if row["controller"] == "policy_paper" and row["mass_scale"] == 1.0:
        report.bars += [
            at_most(f"{label}: lateral force RMSE, the paper's", float(row["e_y_n"] or np.nan), PAPER_ERRORS_N[0], "N"),
            at_most(f"{label}: vertical force RMSE, the paper's", float(row["e_z_n"] or np.nan), PAPER_ERRORS_N[1], "N"),
        ]


def plot(folder: Path, rows: list[Row]) -> None:
    """Vertical force error over the mass scale, for each controller."""
    # Plots are optional, so the library is only needed for them.
    from matplotlib import pyplot

    figure, panel = pyplot.subplots(figsize=(5, 3.5), layout="constrained")
    for name in dict.fromkeys(str(row["controller"]) for row in rows):
        mine = [row for row in rows if row["controller"] == name]
        panel.plot(*np.array([(row["mass_scale"], row["e_z_n"]) for row in mine], float).T, marker="o", label=name)
    panel.set(xlabel="mass scale", ylabel="vertical force RMSE [N]", ylim=(0.0, None))
    panel.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "box_drag.png", dpi=120)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Box dragging by force alone, for every controller and mass scale.")
    parser.add_argument("--controllers", nargs="+", metavar="NAME", help="default: all there are")
    parser.add_argument("--weights", type=Path, default=WEIGHTS_DIRECTORY, help="folder of the policies")
    parser.add_argument("--trials", type=int, default=10, help="at each mass scale")
    parser.add_argument("--estimator", default=SHIPPED_ESTIMATOR, help="that feeds the controller (default: the shipped one)")
    add_workers(parser)
    arguments = parser.parse_args()
    setups = controller_setups(arguments.weights)
    unknown = set(arguments.controllers or ()) - set(setups)
    if unknown:
        parser.error(f"no controller {', '.join(sorted(unknown))}; there are {', '.join(setups)}")
    report = Report("box_drag", arguments.seed)
    trials = 1 if arguments.quick else arguments.trials
    plan = [
        replace(setups[name], estimator=arguments.estimator, mass_scale=mass_scale)
        for name in arguments.controllers or setups
        for mass_scale in ((1.0,) if arguments.quick else MASS_SCALES)
    ]
    jobs = [(setup, index, arguments.seed + index) for setup in plan for index in range(trials)]
    trained = manifests(arguments.weights, [setup.controller for setup in plan])
    results: dict[tuple[str, float, int], DragResult] = {}
    for setup, trial, result in map_unordered("local", play, jobs, arguments.workers):
        results[setup.controller, setup.mass_scale, trial] = result
        report.progress(f"{setup.controller} at mass {setup.mass_scale}, trial {trial}: {result}")
    for setup in plan:
        mine = [results[setup.controller, setup.mass_scale, trial] for trial in range(trials)]
        report.rows += [trial_row(setup, trial, result) for trial, result in enumerate(mine)]
        report.summaries.append(summary(setup, mine) | training_row(trained.get(setup.controller)))
        add_bars(report, report.summaries[-1])
    report.finish(arguments.json)
    print(f"\n{table_two(report.summaries)}")
    if arguments.plot is not None:
        plot(arguments.plot, report.summaries)
        plot_forces(arguments.plot, {setup.controller: results[setup.controller, 1.0, 0] for setup in plan})
        plot_learning(arguments.plot, trained)
    return 0


if __name__ == "__main__":
    sys.exit(main())
