"""Control benchmark: position, force, falls and guidance of the model-based controller on the full stack.

    python -m sim.benchmarks.control [--quick] [--json PATH] [--plot DIR]

`sim.benchmarks.policy` for this one controller and ten minutes, and what only guidance shows: eight leads of half a metre one
by one, and rest.
"""

import sys
from pathlib import Path

import numpy as np

from control.frames import AXES
from sim.benchmarks.policy import LEVELS_N, case_rows
from sim.benchmarks.report import Report, argument_parser, at_least, at_most
from sim.trials.guidance_trials import LeadResult, lead, rest_drift
from sim.trials.random_commands import Errors, random_commands, rms, settled_position_cm
from sim.trials.trial import Trial, TrialSetup

SETUP = TrialSetup(controller="model_based")


def add_random_commands(report: Report, errors: Errors) -> None:
    """Rows and bars of the random run."""
    report.rows += case_rows("random", SETUP, errors)
    for level in LEVELS_N:
        report.bars.append(at_most(f"force RMSE on masked axes at {level:g} N", rms(errors.force_at(level)), 2.0, "N"))
    report.bars.append(at_most("settled position", settled_position_cm(errors), 1.5, "cm"))
    report.bars.append(at_most("falls in random commands", errors.falls, 0, "1"))


def add_guidance(report: Report, results: dict[int, LeadResult], drifts: list[tuple[float, float]]) -> None:
    """Rows and bars of guidance."""
    who = {"controller": SETUP.controller, "estimator": SETUP.estimator}
    for angle, result in results.items():
        report.rows.append(
            {
                "case": f"lead {angle} deg",
                **who,
                "hand_progress_m": result.hand_progress_m,
                "base_travel_m": result.base_travel_m,
                "largest_force_n": result.largest_force_n,
                "stretch_m": result.stretch_m,
                "stop_s": result.stop_s,
                "falls": int(result.fallen),
            }
        )
    for base, hand in drifts:
        report.rows.append({"case": "rest", **who, "base_drift_m": base, "hand_drift_m": hand})
    outcomes = list(results.values())
    report.bars += [
        at_least("hand led by", min(result.hand_progress_m for result in outcomes), 0.5, "m"),
        at_most("force of the leading hand", max(result.largest_force_n for result in outcomes), 15.0, "N"),
        at_most("stop after letting go", max(result.stop_s for result in outcomes), 1.0, "s"),
        at_most("falls in guidance", sum(result.fallen for result in outcomes), 0, "1"),
        at_most("base drift at rest", max(base for base, _ in drifts), 0.01, "m"),
    ]


def plot(folder: Path, errors: Errors) -> None:
    """Histogram of the force error per axis."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(1, len(AXES), sharey=True, figsize=(9, 3))
    for index, panel in enumerate(axes):
        for level in LEVELS_N:
            error = errors.force_at(level)[:, index]
            panel.hist(error[np.isfinite(error)], bins=60, density=True, histtype="step", label=f"{level:g} N")
        panel.set_xlabel(f"force error {AXES[index]} [N]")
        panel.legend()
    figure.tight_layout()
    figure.savefig(folder / "control_force_error.png", dpi=120)
    pyplot.close(figure)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Position, force, falls and guidance of the model-based controller on the full stack.")
    arguments = parser.parse_args()
    report = Report("control", arguments.seed)
    minutes = 0.25 if arguments.quick else 10.0
    angles = (0, 90) if arguments.quick else tuple(range(0, 360, 45))
    report.progress(f"random commands for {minutes:g} robot minutes")
    errors = random_commands(SETUP, arguments.seed, minutes, LEVELS_N)
    add_random_commands(report, errors)
    results = {}
    for angle in angles:
        results[angle] = lead(Trial(SETUP, arguments.seed + angle), float(np.radians(angle)))
        report.progress(f"lead {angle} deg: {results[angle]}")
    rest_s, rests = (5.0, 1) if arguments.quick else (20.0, 3)
    drifts = [rest_drift(Trial(SETUP, arguments.seed + index), rest_s) for index in range(rests)]
    add_guidance(report, results, drifts)
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, errors)
    return 0


if __name__ == "__main__":
    sys.exit(main())
