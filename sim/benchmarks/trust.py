"""Trust: what a robot does that nobody touches, and what it tells that is not there.

    python -m sim.benchmarks.trust [--quick] [--controllers NAME ...] [--mass-scale SCALE ...] [--repeats N] [--workers N]
                                   [--seed N] [--json PATH] [--plot DIR]

On the full stack as it ships, at each mass: a minute untouched with every axis on force at 0 N, the base velocity told of a
robot at rest, the odometry after 20 m of random driving, 15 N on the box with two axes that hold their position, and the
estimate while a wrist is turned into its end and pulled. The plot is the error of that estimate against the sigma stated.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from control.paths import WEIGHTS_DIRECTORY
from sim.benchmarks.estimator import add_workers
from sim.benchmarks.report import Bar, Report, Row, argument_parser, at_least, at_most
from sim.benchmarks.trust_trials import Metrics, at_rest, driven, pressed, pulled_at_stop, untouched
from sim.processes.executors import map_unordered
from sim.trials.pull import DIRECTIONS
from sim.trials.trial import TrialSetup, controller_setups

MASS_SCALES = (0.8, 1.0, 1.2)
REPEATS = 3
"""Seeds of each case at each mass."""
LIMITS = {
    "hand wanders": 5.0,
    "base velocity told": 0.01,
    "odometry error over way": 2.0,
    "odometry yaw error": 2.0,
    "largest force on still axes": 2.0,
    "falls": 0.0,
}
STOP_CASE = "joint at stop"
STOP_RMSE_N, STOP_COVERAGE = 1.5, 0.92
"""Bars of the estimate at a stop, of which one has to hold."""

Stopped = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """One trial: its case, and what plays it given setup and seed."""

    case: str
    setup: TrialSetup
    seed: int
    play: Callable[[TrialSetup, int], Metrics | Stopped]


def plans(setups: Sequence[TrialSetup], seed: int, repeats: int, quick: bool) -> list[TrialPlan]:
    """All trials, each with a seed of its own at a mass and the same seeds at every mass."""
    cases: dict[str, Callable[[TrialSetup, int], Metrics]] = {
        "untouched": partial(untouched, seconds=3.0 if quick else 60.0),
        "at rest": partial(at_rest, seconds=1.0 if quick else 5.0),
        "driven": partial(driven, way_m=1.0 if quick else 20.0),
        "pressed": partial(pressed, seconds=1.0 if quick else 8.0),
    }
    directions = range(0, len(DIRECTIONS), 13 if quick else 3)
    planned = []
    for setup in setups:
        numbers = iter(range(seed, seed + 1000))
        planned += [TrialPlan(case, setup, next(numbers), play) for case, play in cases.items() for _ in range(repeats)]
        planned += [TrialPlan(STOP_CASE, setup, next(numbers), partial(pulled_at_stop, direction=d)) for d in directions]
    return planned


def play(job: tuple[int, TrialPlan]) -> tuple[int, Metrics | Stopped]:
    """One trial by its number; importable by an executor's processes."""
    number, plan = job
    return number, plan.play(plan.setup, plan.seed)


def stop_metrics(errors: np.ndarray, sigmas: np.ndarray) -> Metrics:
    """What the flagged control periods of any number of trials say together; NaN where there are none.

    Args:
        errors: (n, 3) N.
        sigmas: (n, 3) N, stated.
    """
    if not len(errors):
        return {"estimate, RMSE": (np.nan, "N"), "axes within 2 sigma": (np.nan, "1"), "control periods": (0.0, "1")}
    return {
        "estimate, RMSE": (float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))), "N"),
        "axes within 2 sigma": (float(np.mean(np.abs(errors) <= 2.0 * sigmas)), "1"),
        "control periods": (float(len(errors)), "1"),
    }


def rows_of(plan: TrialPlan, metrics: Metrics) -> list[Row]:
    """One row for each metric of a trial."""
    head: Row = {
        "case": plan.case,
        "controller": plan.setup.controller,
        "estimator": plan.setup.estimator,
        "mass_scale": plan.setup.mass_scale,
        "seed": plan.seed,
    }
    return [{**head, "metric": name, "value": value, "unit": unit} for name, (value, unit) in metrics.items()]


def summaries(rows: Sequence[Row]) -> list[Row]:
    """Mean and largest over the seeds of every controller, mass, case and metric."""
    keys = ("case", "controller", "estimator", "mass_scale", "metric", "unit")
    cells: dict[tuple[str | int | float | bool | None, ...], list[float]] = {}
    for row in rows:
        cells.setdefault(tuple(row[key] for key in keys), []).append(float(row["value"] or 0.0))
    condensed: list[Row] = []
    for cell, values in cells.items():
        if cell[0] != STOP_CASE:
            row: Row = dict(zip(keys, cell, strict=True))
            condensed.append(row | {"trials": len(values), "mean": float(np.mean(values)), "largest": max(values)})
    return condensed


def bars(controller: str, rows: Sequence[Row], stopped: Metrics) -> list[Bar]:
    """The worst of each metric against its limit, and of the estimate at a stop what is nearer to its own."""
    mine = [row for row in rows if row["controller"] == controller]
    held = []
    for metric, limit in LIMITS.items():
        found = [row for row in mine if row["metric"] == metric]
        worst = max(float(row["value"] or 0.0) for row in found)
        held.append(at_most(f"{controller}: {metric}", worst, limit, str(found[0]["unit"])))
    rmse, coverage = stopped["estimate, RMSE"][0], stopped["axes within 2 sigma"][0]
    if rmse <= STOP_RMSE_N or not coverage >= STOP_COVERAGE:
        held.append(at_most(f"{controller}: estimate at a stop, RMSE", rmse, STOP_RMSE_N, "N"))
    else:
        held.append(at_least(f"{controller}: estimate at a stop, axes within 2 sigma", coverage, STOP_COVERAGE, "1"))
    return held


def plot(folder: Path, stopped: dict[str, Stopped]) -> None:
    """Error of every axis at a stop against the standard deviation stated, and twice that."""
    # Plots are optional, so the library is only needed for them.
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.0, 4.5), layout="constrained")
    for name, (errors, sigmas) in stopped.items():
        axes.plot(sigmas.ravel(), np.abs(errors).ravel(), ".", markersize=2.0, label=name)
    reach = np.array([0.0, axes.get_xlim()[1]])
    axes.plot(reach, 2.0 * reach, color="gray", label="2 sigma")
    axes.set(
        xlabel="standard deviation stated [N]", ylabel="error of an axis [N]", title="A joint at its stop", xlim=(0.0, None)
    )
    axes.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "trust.png", dpi=120)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("What a robot does that nobody touches, and what it tells that is not there.")
    parser.add_argument("--controllers", nargs="+", metavar="NAME", default=["policy"], help="default: policy")
    parser.add_argument("--mass-scale", nargs="+", type=float, default=MASS_SCALES, metavar="SCALE", help="of the robot")
    parser.add_argument("--repeats", type=int, default=REPEATS, metavar="N", help=f"seeds of each case (default {REPEATS})")
    add_workers(parser)
    arguments = parser.parse_args()
    known = controller_setups(WEIGHTS_DIRECTORY)
    if unknown := set(arguments.controllers) - set(known):
        parser.error(f"no controller {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    masses, repeats = ((1.0,), 1) if arguments.quick else (arguments.mass_scale, arguments.repeats)
    setups = [replace(known[name], mass_scale=mass) for name in arguments.controllers for mass in masses]
    planned = plans(setups, arguments.seed, repeats, arguments.quick)
    report = Report("trust", arguments.seed)
    results: dict[int, Metrics | Stopped] = {}
    for number, result in map_unordered("local", play, list(enumerate(planned)), arguments.workers):
        results[number] = result
        plan = planned[number]
        metrics = result if isinstance(result, dict) else stop_metrics(*result)
        said = ", ".join(f"{name} {value:.3g} {unit}".removesuffix(" 1") for name, (value, unit) in metrics.items())
        report.progress(
            f"{len(results)}/{len(planned)} {plan.setup.controller} {plan.case} at mass {plan.setup.mass_scale:g}: {said}"
        )
    stopped = {}
    for name in arguments.controllers:
        mine = [(plan, results[number]) for number, plan in enumerate(planned) if plan.setup.controller == name]
        pairs = [result for _, result in mine if not isinstance(result, dict)]
        stopped[name] = (np.concatenate([errors for errors, _ in pairs]), np.concatenate([sigmas for _, sigmas in pairs]))
        for plan, result in mine:
            report.rows += rows_of(plan, result if isinstance(result, dict) else stop_metrics(*result))
    report.summaries = summaries(report.rows)
    for name, (errors, sigmas) in stopped.items():
        together = stop_metrics(errors, sigmas)
        report.summaries += [
            {"case": STOP_CASE, "controller": name, "metric": metric, "unit": unit, "mean": value}
            for metric, (value, unit) in together.items()
        ]
        report.bars += bars(name, report.rows, together)
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, stopped)
    return 0


if __name__ == "__main__":
    sys.exit(main())
