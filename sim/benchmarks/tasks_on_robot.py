"""Tasks on the emulated robot, over its wire: the console as people run it, REST, and a robot that stands in the scene.

    python -m sim.benchmarks.tasks_on_robot [--task NAME ...] [--trials N] [--quick] [--seed N] [--json PATH]

In real time and three processes, as on a robot, so only on a quiet machine. The console knows nothing of the scene: the site is
typed in with the error of `sim.benchmarks.tasks`. No truth scores: a row tells the task's outcome, the phases seen on the way,
the largest force estimated, and how far what can be read off the emulator's world went. Protocol-verified, not robot-verified.
"""

import math
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from sim.backends.hardware.backend import HONESTY, unavailable_because
from sim.benchmarks.report import Report, Row, argument_parser, at_least
from sim.benchmarks.server_process import ServerProcess
from sim.benchmarks.tasks import DEFAULT_SEED, QUICK_OPTIONS
from sim.emulator.process import EmulatorProcess
from sim.tasks import TASKS
from sim.trials.task_trial import LIMIT_S, TaskPlan

TRIALS = 3
LEAD_S = 60.0
BEHIND_M = 0.4
"""The robot is switched on so far behind where the task begins, and driven there: the arm needs room to unfold."""
DRIVE_MPS = 0.2
REST_S = 1.5
PATIENCE_S = 60.0
LOOK_S = 0.05
ONWARD = {"observe": "engage", "damped": "stand", "ready": "start", "fault": "clear"}
"""What leads on from a state of the drives."""


class RobotTrial:
    """A robot switched on in a scene, and a console that has made it stand by the controller; ends with `close`."""

    def __init__(self, plan: TaskPlan, domain: int) -> None:
        self._plan = plan
        self.robot = EmulatorProcess(domain, None, "--scene", plan.scene, "--seed", str(plan.seed), "--behind", str(BEHIND_M))
        self.console = ServerProcess(*self.robot.arguments)
        self.call("PUT", "backend", {"name": "hardware", "options": {"dry_run": False}})

    def close(self) -> None:
        """End both."""
        self.console.stop()
        self.robot.close()

    def call(self, method: str, path: str, body: Any = None) -> Any:
        """A call of the console's REST interface."""
        return self.console.request(method, f"/api/v1/{path}", body)

    def stand(self) -> dict[str, float]:
        """Lead the drives to where the controller moves the robot, and drive to where the task begins; the options of the site.

        Raises:
            TimeoutError: they did not get there.
        """

        def moves() -> bool:
            hardware = self.call("GET", "hardware")
            request = ONWARD.get(hardware["state"])
            if request in hardware["requests"] and not hardware["engaging"]:
                self.call("POST", "hardware", {"request": request})
            return hardware["state"] == "policy"

        _await(moves, "the controller moves the robot")
        site = self._site()
        self.call("PATCH", "command", {"base_velocity": [DRIVE_MPS, 0.0, 0.0]})
        _await(lambda: self.console.state()["odometry"]["position_m"][0] >= BEHIND_M, "it drives there")
        self.call("PATCH", "command", {"base_velocity": [0.0, 0.0, 0.0]})
        time.sleep(REST_S)
        return site

    def _site(self) -> dict[str, float]:
        """Options that tell where the scene is believed to be, in the odometry's frame, which begins where the robot stands."""
        stands = self.robot.report()
        x, y, yaw = *stands["base_position_m"][:2], stands["base_yaw_rad"]
        error_x, error_y, error_yaw = self._plan.site_error()
        cosine, sine = math.cos(yaw), math.sin(yaw)
        ahead, aside = error_x - x, error_y - y
        return {
            "site_x_m": cosine * ahead + sine * aside,
            "site_y_m": cosine * aside - sine * ahead,
            "site_yaw_rad": error_yaw - yaw,
        }

    def play(self, site: dict[str, float]) -> Row:
        """The task, from its start to its end, with the options of `stand`."""
        known = next(task for task in self.call("GET", "tasks") if task["name"] == self._plan.task)["options"]
        options = site | self._plan.options
        before: dict[str, float] = self.robot.report()["readings"]
        farthest = dict(before)
        started = time.monotonic()
        self.call("POST", "tasks", {"name": self._plan.task, "options": {k: v for k, v in options.items() if k in known}})
        if self._plan.task == "guidance":
            self.robot.order(lead={"seed": self._plan.seed, "duration_s": options.get("lead_s", LEAD_S)})
        phases: list[str] = []
        largest_n = 0.0
        while True:
            task = self.call("GET", "tasks/current")
            if task["phase"] not in phases:
                phases.append(task["phase"])
            force = self.console.state()["end_effector"]["force_estimated_n"]
            largest_n = max(largest_n, math.hypot(*force))
            for name, value in self.robot.report()["readings"].items():
                farthest[name] = max(farthest[name], value, key=partial(_way, before[name]))
            if task["outcome"] is not None or time.monotonic() - started > LIMIT_S:
                break
            time.sleep(LOOK_S)
        faults = "; ".join(self.call("GET", "hardware")["faults"])
        return {
            "task": self._plan.task,
            "controller": self._plan.controller,
            "seed": self._plan.seed,
            "success": task["outcome"] == "succeeded",
            "reason": task["reason"] if not faults else f"{task['reason']} ({faults})",
            "duration_s": round(time.monotonic() - started, 1),
            "phases": ", ".join(phases),
            "largest_estimate_n": largest_n,
            "readings": ", ".join(f"{name} {before[name]:.3g} -> {farthest[name]:.3g}" for name in before),
        }


def _way(start: float, now: float) -> float:
    return abs(now - start)


def _await(condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f"never happened: {what}")
        time.sleep(LOOK_S)


def main() -> int:
    """Run the benchmark and report."""
    parser = argument_parser("The paper's demonstrations on the emulated robot, over its wire.")
    parser.set_defaults(seed=DEFAULT_SEED)
    names = [name for name in TASKS if name != "sequence"]
    parser.add_argument("--task", nargs="+", choices=names, metavar="NAME", help=f"of {', '.join(names)} (default: all)")
    parser.add_argument("--trials", type=int, default=TRIALS, help=f"seeds per task (default {TRIALS})")
    arguments = parser.parse_args()
    if (reason := unavailable_because()) is not None:
        raise SystemExit(reason)
    report = Report("tasks_on_robot", arguments.seed)
    domain = 2 + arguments.seed % 200
    for task in arguments.task or names[: 1 if arguments.quick else None]:
        options = QUICK_OPTIONS.get(task, {}) if arguments.quick else {}
        rows: list[Row] = []
        for seed in range(arguments.seed, arguments.seed + (1 if arguments.quick else arguments.trials)):
            trial = RobotTrial(TaskPlan(task, seed, options=options), domain)
            try:
                rows.append(trial.play(trial.stand()))
            finally:
                trial.close()
            report.progress(", ".join(f"{key} {value}" for key, value in rows[-1].items()))
        report.rows += rows
        report.bars.append(at_least(f"{task}: succeeded", sum(bool(row["success"]) for row in rows), len(rows), ""))
    report.finish(arguments.json)
    print(f"\n{HONESTY}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
