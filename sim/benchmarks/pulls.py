"""Pulls: how firmly a robot that yields may be pulled by its hand before it falls.

    python -m sim.benchmarks.pulls [--quick] [--controllers NAME ...] [--forces N ...] [--ramps S ...] [--mass-scale SCALE ...]
                                   [--slopes DEG ...] [--jerky] [--workers N] [--seed N] [--json PATH] [--plot DIR]

Every force in 26 directions of the heading frame, four seconds each, under guidance and with all axes on force at 0 N, on the
full stack as it ships; with `--jerky`, on and off instead of held. The plot is a map of the directions: the largest force in
each after which the robot stood.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from control.paths import WEIGHTS_DIRECTORY
from sim.benchmarks.estimator import add_workers
from sim.benchmarks.report import Report, Row, argument_parser, at_most
from sim.processes.executors import map_unordered
from sim.trials.pull import DIRECTIONS, MODES, Pull, PullResult, pull
from sim.trials.trial import controller_setups

FORCES_N = (10.0, 20.0, 30.0, 40.0)
MASS_SCALES = (0.8, 1.0, 1.2)
RAMPS_S = (0.05, 0.5)
SLOPES_DEG = (0.0, 5.0)
TILT_LIMIT_DEG = 10.0
QUICK = 3
"""Directions under --quick."""


def play(job: tuple[int, Pull]) -> tuple[int, PullResult]:
    """One pull by its number; importable by an executor's processes."""
    return job[0], pull(job[1])


def row(plan: Pull, result: PullResult) -> dict[str, Any]:
    """One row of the table; direction and flags are lists."""
    return {
        "controller": plan.setup.controller,
        "mode": plan.mode,
        "force_n": plan.force_n,
        "direction": list(plan.direction),
        "ramp_s": plan.ramp_s,
        "jerky": plan.jerky,
        "mass_scale": plan.setup.mass_scale,
        "slope_deg": plan.slope_deg,
        "fell": result.fell,
        "tilt_deg": result.tilt_deg,
        "excursion_m": result.excursion_m,
        "outside_s": result.outside_s,
        "self_contact": result.self_contact,
        "estimate_rmse_n": result.estimate_rmse_n,
        "flags": list(result.flags),
    }


def summaries(plans: Sequence[Pull], results: Sequence[PullResult]) -> list[Row]:
    """All directions, ramps and slopes of one controller, mode, force and mass together."""
    cells: dict[tuple[str, str, float, float], list[PullResult]] = {}
    for plan, result in zip(plans, results, strict=True):
        cells.setdefault((plan.setup.controller, plan.mode, plan.force_n, plan.setup.mass_scale), []).append(result)
    return [
        {
            "controller": controller,
            "mode": mode,
            "force_n": force,
            "mass_scale": mass,
            "pulls": len(cell),
            "falls": sum(r.fell for r in cell),
            "tilt_max_deg": max(r.tilt_deg for r in cell),
            "excursion_max_m": max(r.excursion_m for r in cell),
            "self_contacts": sum(r.self_contact for r in cell),
            "estimate_rmse_n": float(np.sqrt(np.mean([r.estimate_rmse_n**2 for r in cell]))),
        }
        for (controller, mode, force, mass), cell in cells.items()
    ]


def plot(folder: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Largest force stood in each direction, of each controller and mode: azimuth around, elevation from the rim inwards."""
    # Plots are optional, so the library is only needed for them.
    from matplotlib import pyplot

    kinds = list(dict.fromkeys((str(r["controller"]), str(r["mode"])) for r in rows))
    figure, panels = pyplot.subplots(
        1, len(kinds), figsize=(4.2 * len(kinds), 4.6), subplot_kw={"projection": "polar"}, squeeze=False, layout="constrained"
    )
    most = max(float(r["force_n"] or 0.0) for r in rows)
    for panel, kind in zip(panels[0], kinds, strict=True):
        for level, name, color in ((-1, "down", "tab:brown"), (0, "level", "tab:blue"), (1, "up", "tab:green")):
            ring: dict[float, float] = {}
            for r in rows:
                direction = r["direction"]
                if (r["controller"], r["mode"]) != kind or not isinstance(direction, list) or direction[2] != level:
                    continue
                if direction[0] == direction[1] == 0.0:
                    continue
                azimuth, force = float(np.arctan2(direction[1], direction[0])), float(r["force_n"] or 0.0)
                ring[azimuth] = min(ring.get(azimuth, most), force if r["fell"] else most)
            angles = sorted(ring)
            panel.plot([*angles, *angles[:1]], [ring[a] for a in [*angles, *angles[:1]]], marker="o", color=color, label=name)
        panel.set(title=f"{kind[0]}, {kind[1].replace('_', ' ')}", ylim=(0.0, 1.1 * most), theta_zero_location="N")
    panels[0][0].legend(loc="lower left", title="pulled")
    figure.suptitle("Force [N] at which it first fell, or the largest tried (0 deg: ahead)")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "pulls.png", dpi=120)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("How firmly a robot that yields may be pulled by its hand before it falls.")
    parser.add_argument("--controllers", nargs="+", metavar="NAME", default=["policy"], help="default: policy")
    parser.add_argument("--modes", nargs="+", choices=MODES, default=list(MODES), help="default: both")
    parser.add_argument("--forces", nargs="+", type=float, default=FORCES_N, metavar="N", help="default: 10 20 30 40")
    parser.add_argument("--ramps", nargs="+", type=float, default=RAMPS_S, metavar="S", help="to the full force")
    parser.add_argument("--mass-scale", nargs="+", type=float, default=MASS_SCALES, metavar="SCALE", help="of the robot")
    parser.add_argument("--slopes", nargs="+", type=float, default=SLOPES_DEG, metavar="DEG", help="of the floor")
    parser.add_argument("--jerky", action="store_true", help="on and off instead of held")
    add_workers(parser)
    arguments = parser.parse_args()
    setups = controller_setups(WEIGHTS_DIRECTORY)
    if unknown := set(arguments.controllers) - set(setups):
        parser.error(f"no controller {', '.join(sorted(unknown))}; there are {', '.join(setups)}")
    directions = [(float(x), float(y), float(z)) for x, y, z in DIRECTIONS]
    masses, forces, ramps, slopes = arguments.mass_scale, arguments.forces, arguments.ramps, arguments.slopes
    if arguments.quick:
        directions, masses, forces, ramps, slopes = directions[:QUICK], (1.0,), (20.0,), (0.5,), (5.0,)
    setups_tried = [replace(setups[name], mass_scale=mass) for name in arguments.controllers for mass in masses]
    plans = [
        Pull(setup, mode, force, direction, ramp, arguments.jerky, arguments.seed + index, slope)
        for setup in setups_tried
        for mode in arguments.modes
        for force in forces
        for ramp in ramps
        for slope in slopes
        for index, direction in enumerate(directions)
    ]
    report = Report("pulls", arguments.seed)
    results: dict[int, PullResult] = {}
    for index, result in map_unordered("local", play, list(enumerate(plans)), arguments.workers):
        results[index] = result
        plan = plans[index]
        report.progress(
            f"{len(results)}/{len(plans)} {plan.setup.controller} {plan.mode} {plan.force_n:g} N along {plan.direction}"
            f" at mass {plan.setup.mass_scale:g}, slope {plan.slope_deg:g} deg: {'FELL' if result.fell else 'stood'},"
            f" {result.tilt_deg:.1f} deg, hand {result.excursion_m:.2f} m"
        )
    done = [results[index] for index in range(len(plans))]
    report.rows = [row(plan, result) for plan, result in zip(plans, done, strict=True)]
    report.summaries = summaries(plans, done)
    for controller in arguments.controllers:
        mine = [r for r in report.summaries if r["controller"] == controller]
        report.bars += [
            at_most(f"{controller}: falls", sum(int(r["falls"] or 0) for r in mine), 0.0, "1"),
            at_most(f"{controller}: largest tilt", max(float(r["tilt_max_deg"] or 0.0) for r in mine), TILT_LIMIT_DEG, "deg"),
            at_most(f"{controller}: pulls with self-contact", sum(int(r["self_contacts"] or 0) for r in mine), 0.0, "1"),
        ]
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, report.rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
