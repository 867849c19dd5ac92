"""Policy benchmark: whole-body tracking and force regulation on the full stack, for each controller and force input.

    python -m sim.benchmarks.policy [--quick] [--controllers NAME ...] [--cases CASE ...] [--weights DIR]
                                    [--minutes M] [--workers N] [--json PATH] [--plot DIR]

Random commands with every mask against virtual springs at +-10 and +-20 N, with noisy sensors and the real estimators:
tracking errors, falls, power, overshoot where an axis changes to force control in motion; then +-30 N, which on three axes
at once tips a moving robot, pushes at the hand, wrong masses, and the force input replaced by truth, zero and other
estimators. A case is played in pieces with seeds of their own.
Last, how light each controller is to lead by the hand.
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from control.estimation.momentum_observer import PAPER_GAINS
from control.frames import AXES
from control.paths import WEIGHTS_DIRECTORY
from control.whole_body.controller import ControllerInput
from sim.benchmarks import policy_guidance
from sim.benchmarks.estimator import add_workers
from sim.benchmarks.report import Report, Row, argument_parser, at_most
from sim.processes.executors import map_unordered
from sim.trials.guidance_trials import LeadResult
from sim.trials.random_commands import Errors, random_commands, rms, settled_position_cm
from sim.trials.trial import Trial, TrialSetup, controller_setups

ANY_MASK = "any"
LEVELS_N = (10.0, 20.0)
STRONG_N = 30.0
MASS_SCALES = (0.8, 1.2)
STRONG_CASE = f"forces {STRONG_N:g} N"
PUSH_N = 15.0
INFERENCE_REPEATS = 300
PIECE_MINUTES = 2.0


@dataclass(frozen=True, slots=True)
class Piece:
    """A part of a case, played by one process with forces of `levels_n`."""

    case: str
    setup: TrialSetup
    seed: int
    minutes: float
    levels_n: tuple[float, ...] = LEVELS_N


def cases(plain: TrialSetup) -> Iterator[tuple[str, TrialSetup]]:
    """What is run with a controller: name of the case, and its setup."""
    yield "random", plain
    yield f"pushes {PUSH_N:g} N", replace(plain, push_n=PUSH_N)
    yield STRONG_CASE, plain
    for scale in MASS_SCALES:
        yield f"mass {scale:g}", replace(plain, mass_scale=scale)
    for force_input in ("truth", "zero"):
        yield f"force input {force_input}", replace(plain, force_input=force_input)
    gains = (PAPER_GAINS.k1, PAPER_GAINS.k2)
    yield "force input gmo_cqp", replace(plain, estimator="gmo_cqp", gains=gains)
    for estimator in ("tcn", "adaptive"):
        yield f"force input {estimator}", replace(plain, estimator=estimator)


def pieces(plain: TrialSetup, seed: int, minutes: float, quick: bool) -> list[Piece]:
    """All cases of a controller, cut up; those without a bar get a tenth of the time."""
    result = []
    for case, setup in cases(plain):
        total = minutes if quick or case == "random" or setup.push_n else 0.1 * minutes
        count = max(1, round(total / PIECE_MINUTES))
        # Every case meets the same commands.
        levels_n = (STRONG_N,) if case == STRONG_CASE else LEVELS_N
        result += [Piece(case, setup, seed + 100 * index, total / count, levels_n) for index in range(count)]
        if quick and setup.push_n:
            break
    return result


def play(piece: Piece) -> tuple[Piece, Errors]:
    """Run a piece; importable by an executor's processes."""
    return piece, random_commands(piece.setup, piece.seed, piece.minutes, piece.levels_n)


def case_rows(case: str, setup: TrialSetup, errors: Errors) -> list[Row]:
    """Rows of a case: one for each force level over all masks, then one for each mask and level with force axes.

    Velocity, position, falls and minutes are those of the whole case.
    """
    common: Row = {
        "rmse_velocity_mps": rms(np.array(errors.forward)),
        "rmse_yaw_rps": rms(np.array(errors.yaw)),
        "settled_position_cm": settled_position_cm(errors),
        "settled_orientation_deg": float(np.degrees(rms(np.array(errors.orientation)))),
        "rmse_estimate_n": rms(np.array(errors.estimate)),
        "rmse_own_estimate_n": rms(np.array(errors.own)),
        "overshoot_median_n": float(np.median(errors.overshoot)) if errors.overshoot else None,
        "overshoot_p95_n": float(np.percentile(errors.overshoot, 95)) if errors.overshoot else None,
        "power_w": float(np.mean(errors.power)) if errors.power else None,
        "falls": errors.falls,
        "pushes": errors.pushes,
        "robot_minutes": errors.robot_minutes,
    }

    def row(mask: str, level: float, force: np.ndarray) -> Row:
        what: Row = {
            "case": case,
            "controller": setup.controller,
            "estimator": setup.estimator,
            "mask": mask,
            "force_level_n": level,
            "mass_scale": setup.mass_scale,
            "rmse_force_n": rms(force),
        }
        return what | {f"rmse_force_{axis}_n": rms(force[:, index]) for index, axis in enumerate(AXES)} | common

    rows = [row(ANY_MASK, level, errors.force_at(level)) for level in sorted({level for _, level in errors.force})]
    masks = [(key, np.array(samples)) for key, samples in sorted(errors.force.items()) if key[0] != "000" and samples]
    return rows + [row(mask, level, samples) for (mask, level), samples in masks]


def inference_ms(setup: TrialSetup) -> float:
    """Median time of one controller step at a standing robot, ms."""
    trial = Trial(setup, seed=1, settle_s=0.2)
    pipeline, output = trial.session.pipeline, trial.session.output
    inputs = ControllerInput(
        sensor=trial.session.backend.read(),
        base=output.base,
        model=pipeline.model,
        command=output.applied_command,
        force_estimated_n=output.hand.force_estimated_n,
    )
    controller, times = pipeline.controllers[setup.controller], []
    for _ in range(INFERENCE_REPEATS):
        start = time.perf_counter()
        controller.step(inputs)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def add_bars(report: Report, setup: TrialSetup, errors: Errors) -> None:
    """The bars of the random run."""
    name = setup.controller
    report.bars += [
        at_most(f"{name}: velocity RMSE", rms(np.array(errors.forward)), 0.05, "m/s"),
        at_most(f"{name}: yaw rate RMSE", rms(np.array(errors.yaw)), 0.10, "rad/s"),
        at_most(f"{name}: settled position", settled_position_cm(errors), 1.2, "cm"),
        at_most(f"{name}: force RMSE at 10 N", rms(errors.force_at(10.0)), 1.5, "N"),
        at_most(f"{name}: force RMSE at 20 N", rms(errors.force_at(20.0)), 2.0, "N"),
        at_most(f"{name}: falls", errors.falls, 0, "1"),
        at_most(f"{name}: inference", inference_ms(setup), 0.5, "ms"),
    ]


def plot(folder: Path, rows: list[Row]) -> None:
    """Force error by force input, for each controller."""
    # Plots are optional, so the library is only needed for them.
    from matplotlib import pyplot

    names = list(dict.fromkeys(str(row["controller"]) for row in rows))
    strong = [row for row in rows if row.get("mask") == ANY_MASK and row["force_level_n"] == LEVELS_N[-1]]
    labels = list(dict.fromkeys(str(row["case"]) for row in strong))
    figure, panel = pyplot.subplots(figsize=(9, 3.5), layout="constrained")
    for index, name in enumerate(names):
        values = {str(row["case"]): row["rmse_force_n"] for row in strong if row["controller"] == name}
        heights = [float(values.get(label) or np.nan) for label in labels]
        panel.bar(np.arange(len(labels)) + 0.8 * index / len(names), heights, 0.8 / len(names), label=name)
    panel.set_xticks(np.arange(len(labels)) + 0.3, labels, rotation=20, ha="right")
    panel.set_ylabel(f"force RMSE at {LEVELS_N[-1]:g} N [N]")
    panel.legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "policy_force_inputs.png", dpi=120)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("Whole-body tracking and force regulation of every controller on the full stack.")
    parser.add_argument("--controllers", nargs="+", metavar="NAME", help="default: all there are")
    known = [*(case for case, _ in cases(TrialSetup())), policy_guidance.CASE]
    parser.add_argument("--cases", nargs="+", metavar="CASE", choices=known, default=known, help=f"of: {', '.join(known)}")
    parser.add_argument("--weights", type=Path, default=WEIGHTS_DIRECTORY, help="folder of the policies")
    parser.add_argument("--minutes", type=float, default=60.0, help="robot-minutes of random commands; a tenth in other cases")
    add_workers(parser)
    arguments = parser.parse_args()
    setups = controller_setups(arguments.weights)
    unknown = set(arguments.controllers or ()) - set(setups)
    if unknown:
        parser.error(f"no controller {', '.join(sorted(unknown))}; there are {', '.join(setups)}")
    report = Report("policy", arguments.seed)
    minutes = 0.1 if arguments.quick else arguments.minutes
    guidance: dict[str, list[LeadResult]] = {}
    for name in arguments.controllers or setups:
        plan = pieces(setups[name], arguments.seed, minutes, arguments.quick)
        plan = [piece for piece in plan if piece.case in arguments.cases]
        results = {piece.case: Errors() for piece in plan}
        for piece, errors in map_unordered("local", play, plan, arguments.workers):
            results[piece.case].add(errors)
            report.progress(f"{name}, {piece.case}, seed {piece.seed}: {errors.falls} falls")
        for piece in plan:
            if piece.seed == arguments.seed:
                report.rows += case_rows(piece.case, piece.setup, results[piece.case])
        if "random" in results:
            add_bars(report, setups[name], results["random"])
        pushed = results.get(f"pushes {PUSH_N:g} N")
        if pushed is not None:
            report.bars.append(at_most(f"{name}: falls with pushes", pushed.falls, 1, "1"))
        if policy_guidance.CASE in arguments.cases:
            guidance[name] = policy_guidance.guide(setups[name], arguments.seed, arguments.quick, arguments.workers)
            row = policy_guidance.guidance_row(setups[name], guidance[name])
            report.rows.append(row)
            report.progress(f"{name}, guidance: led with at most {row['largest_force_n']:.1f} N")
            if "model_based" in guidance and name != "model_based":
                report.bars += policy_guidance.guidance_bars(name, guidance[name], guidance["model_based"])
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, report.rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
