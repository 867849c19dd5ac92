"""Control benchmark: position, force, falls and guidance of the model-based controller on the full stack.

    python -m sim.benchmarks.control [--quick] [--json PATH] [--plot DIR]

The robot runs its real estimators on noisy sensors. Bars: settled position, force on masked axes against a virtual
spring-damper, falls in ten minutes of random commands, half a metre of guidance in eight directions, rest.
"""

import sys
from pathlib import Path

import numpy as np

from control.frames import AXES
from control.pipeline import PipelineConfig
from sim.benchmarks.report import Report, Row, argument_parser, at_least, at_most
from sim.trials.control_trials import Tracking, Trial, random_run
from sim.trials.guidance_trials import LeadResult, lead, rest_drift
from sim.trials.policy_score import rms


def add_random_commands(report: Report, tracking: Tracking, estimator: str) -> None:
    """Rows and bars of the random run: one row per force level."""
    position = np.array(tracking.position)
    # Length of the error over the position axes of each sample; samples without a position axis do not count.
    held = np.isfinite(position).any(axis=1)
    length_cm = 100.0 * np.sqrt(np.nansum(position[held] ** 2, axis=1))
    settled_cm = rms(length_cm)
    common: Row = {
        "rmse_velocity_mps": rms(np.array(tracking.forward)),
        "rmse_yaw_rps": rms(np.array(tracking.yaw)),
        "settled_position_cm": settled_cm,
        "settled_position_p95_cm": float(np.percentile(length_cm, 95)) if length_cm.size else None,
        "rmse_estimate_n": rms(np.array(tracking.estimate)),
        "falls": tracking.falls,
        "robot_minutes": tracking.robot_minutes,
    }
    for level in sorted(tracking.force):
        error = np.array(tracking.force[level])
        row: Row = {"case": "random", "controller": "model_based", "estimator": estimator, "force_level_n": level}
        row |= {f"rmse_force_{axis}_n": rms(error[:, index]) for index, axis in enumerate(AXES)}
        row |= {"rmse_force_n": rms(error)} | common
        report.rows.append(row)
        report.bars.append(at_most(f"force RMSE on masked axes at {level:g} N", rms(error), 2.0, "N"))
    report.bars.append(at_most("settled position", settled_cm, 1.5, "cm"))
    report.bars.append(at_most("falls in random commands", tracking.falls, 0, "1"))


def add_guidance(report: Report, results: dict[int, LeadResult], drifts: list[tuple[float, float]]) -> None:
    """Rows and bars of guidance."""
    for angle, result in results.items():
        report.rows.append(
            {
                "case": f"lead {angle} deg",
                "controller": "model_based",
                "hand_progress_m": result.hand_progress_m,
                "base_travel_m": result.base_travel_m,
                "largest_force_n": result.largest_force_n,
                "stretch_m": result.stretch_m,
                "stop_s": result.stop_s,
                "falls": int(result.fallen),
            }
        )
    for base, hand in drifts:
        report.rows.append({"case": "rest", "controller": "model_based", "base_drift_m": base, "hand_drift_m": hand})
    outcomes = list(results.values())
    report.bars += [
        at_least("hand led by", min(result.hand_progress_m for result in outcomes), 0.5, "m"),
        at_most("force of the leading hand", max(result.largest_force_n for result in outcomes), 15.0, "N"),
        at_most("stop after letting go", max(result.stop_s for result in outcomes), 1.0, "s"),
        at_most("falls in guidance", sum(result.fallen for result in outcomes), 0, "1"),
        at_most("base drift at rest", max(base for base, _ in drifts), 0.01, "m"),
    ]


def plot(folder: Path, tracking: Tracking) -> None:
    """Histogram of the force error per axis."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(1, len(AXES), sharey=True, figsize=(9, 3))
    for index, panel in enumerate(axes):
        for level in sorted(tracking.force):
            error = np.array(tracking.force[level])[:, index]
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
    tracking = random_run(arguments.seed, minutes, report.progress)
    add_random_commands(report, tracking, PipelineConfig().estimator)
    results = {}
    for angle in angles:
        results[angle] = lead(Trial(arguments.seed + angle), float(np.radians(angle)))
        report.progress(f"lead {angle} deg: {results[angle]}")
    rest_s, rests = (5.0, 1) if arguments.quick else (20.0, 3)
    drifts = [rest_drift(Trial(arguments.seed + index), rest_s) for index in range(rests)]
    add_guidance(report, results, drifts)
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, tracking)
    return 0


if __name__ == "__main__":
    sys.exit(main())
