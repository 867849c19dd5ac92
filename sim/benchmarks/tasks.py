"""Tasks: the paper's demonstrations, played by themselves and scored by truth.

    python -m sim.benchmarks.tasks [--task NAME ...] [--trials N] [--controller NAME] [--rigid] [--workers N] [--quick]
                                   [--seed N] [--json PATH] [--plot DIR]

Ten seeds each, which no recipe was tuned on; each draws the sensors' errors, friction, damping and masses of what is touched,
and where the task believes it: within 2 cm and 2 degrees. Force errors are RMSE at 500 Hz. The figure has one panel per task
with the forces of its first trial, as the paper's has.
"""

import sys
from pathlib import Path

from control.paths import WEIGHTS_DIRECTORY
from sim.benchmarks.estimator import add_workers
from sim.benchmarks.report import Report, Row, argument_parser
from sim.benchmarks.task_bars import add_bars
from sim.benchmarks.task_plots import plot
from sim.benchmarks.task_rows import row
from sim.processes.executors import map_unordered
from sim.tasks import TASKS
from sim.trials.task_trial import TaskPlan, TaskTrace, play

DEFAULT_SEED = 700
QUICK_OPTIONS: dict[str, dict[str, float]] = {
    "wipe": {"loops": 1.0, "period_s": 5.0},
    "valve": {"place_s": 3.0, "drive_s": 3.0},
    "box": {"periods": 1.0},
    "guidance": {"lead_s": 10.0},
    "sequence": {"first": 2.0, "second": 0.0, "third": 0.0},
}
MASS_SCALES = (0.8, 1.0, 1.2)
"""Of the robot in box dragging, as in the paper; one after the other."""
SPRINGS = (1.0, 2.0)


def plans(task: str, seeds: range, controller: str, rigid: bool, quick: bool) -> list[TaskPlan]:
    """The trials of one task."""
    options = QUICK_OPTIONS.get(task, {}) if quick else {}
    if task == "door":
        springs = SPRINGS[: 1 if quick else 2]
        cases = [(seed, 1.0, {"spring_scale": spring}) for seed in seeds for spring in springs]
    elif task == "box":
        cases = [(seed, MASS_SCALES[index % 3], {}) for index, seed in enumerate(seeds)]
    else:
        cases = [(seed, 1.0, {}) for seed in seeds]
    return [TaskPlan(task, seed, rigid, controller, mass, options, parameters) for seed, mass, parameters in cases]


def attempt(job: tuple[int, TaskPlan, Path]) -> tuple[int, Row, TaskTrace]:
    """One trial by its number; importable by an executor's processes."""
    number, plan, weights = job
    trace = play(plan, weights)
    return number, row(plan, trace), trace


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("The paper's demonstrations as tasks, scored by truth.")
    parser.set_defaults(seed=DEFAULT_SEED)
    parser.add_argument("--task", nargs="+", choices=tuple(TASKS), metavar="NAME", help=f"of {', '.join(TASKS)} (default: all)")
    parser.add_argument("--trials", type=int, default=10, help="seeds per task (default 10)")
    parser.add_argument("--controller", default="policy", help="of the pipeline (default policy)")
    parser.add_argument("--weights", type=Path, default=WEIGHTS_DIRECTORY, help="folder of the policies")
    parser.add_argument("--rigid", action="store_true", help="without padding on what the hand touches")
    add_workers(parser)
    arguments = parser.parse_args()
    report = Report("tasks", arguments.seed)
    seeds = range(arguments.seed, arguments.seed + (1 if arguments.quick else arguments.trials))
    chosen = [
        plan
        for task in arguments.task or TASKS
        for plan in plans(task, seeds, arguments.controller, arguments.rigid, arguments.quick)
    ]
    jobs = [(number, plan, arguments.weights) for number, plan in enumerate(chosen)]
    rows: dict[int, Row] = {}
    first: dict[str, tuple[int, TaskTrace]] = {}
    for number, result, trace in map_unordered("local", attempt, jobs, arguments.workers):
        rows[number] = result
        task = chosen[number].task
        if task not in first or number < first[task][0]:
            first[task] = number, trace
        figures = (f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in result.items())
        report.progress(", ".join(figures))
    report.rows = [rows[number] for number in sorted(rows)]
    add_bars(report)
    report.finish(arguments.json)
    if arguments.plot is not None:
        plot(arguments.plot, {task: trace for task, (_, trace) in first.items()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
