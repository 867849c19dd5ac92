"""Attack and soak of a console: `python -m sim.benchmarks.soak` (30 minutes; `--minutes`, or `--quick` for one).

Processes are stopped and killed in every order. Then, in three rounds, one console stands generated calls, raw sockets,
floods at the maximum of wrenches, and random valid use in windows, while its e-stop is pressed all along. Memory is judged by
what the last round ends with more than the one before: what is taken once, at the first of anything, is no growth. Quantiles
and deadlines are meaningful on an otherwise quiet machine only. It needs `pip install -e ".[soak]"`.
"""

import json
import math
import random
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim.benchmarks.report import Report, argument_parser, at_most
from sim.benchmarks.server_process import children
from sim.benchmarks.soak_attacks import KILLS, fill_with_wrenches, flood, raw_sockets
from sim.benchmarks.soak_calls import CHECKS, Generated, generated_calls
from sim.benchmarks.soak_console import Press, SoakConsole, anonymous_mb, lies

USE_S = 5.0
"""From one reset to the next under random valid use."""

MEMORY_MINUTES = 10.0
"""A shorter soak says nothing about growth per hour."""

ROUNDS = 3
SHARES = {"generated calls": 0.3, "raw sockets": 0.2, "flood at the maximum of wrenches": 0.2, "random valid use": 0.3}
"""Of a round."""

WORDS = 2000
"""Of the log that are shown of each traceback."""

SETTLE_S = 60.0
NOTICED_S = 1.0
"""A control process that was killed is known to be dead by then."""

LASTING = ("/scene", "/mismatch", "/estimator", "/estimator/tool")
"""What generated calls leave behind, and a fall may come of."""

CONTROLLERS, ESTIMATORS, SCENES = ("policy", "model_based"), ("hybrid", "adaptive", "gmo_cqp"), ("free", "box", "board")


def value(report: Report, case: str, metric: str, figure: float, unit: str) -> float:
    """Add a row of one figure."""
    report.rows.append({"case": case, "metric": metric, "value": figure, "unit": unit})
    return figure


def kills(report: Report) -> tuple[int, int]:
    """Stop and kill processes in every order, one console for all; how many orders it did not survive, and lost e-stops."""
    console = SoakConsole()
    lost = 0
    for name, attack in KILLS.items():
        report.progress(name)
        attack(console)
        time.sleep(NOTICED_S)
        survived = _usable_again(console)
        if survived:
            console.press()
        console.server.control_pid = _control_pid(console)
        lost += not survived
        value(report, "kills", name, float(survived), "survived")
    console.stop()
    return lost, sum(math.isnan(press.duration_s) for press in console.presses)


def _usable_again(console: SoakConsole) -> bool:
    """Whether the console steps again, after a restart where its control process has died."""
    deadline = time.monotonic() + SETTLE_S
    while time.monotonic() < deadline:
        health = console.call("GET", "/health")
        if health.status == 503 and health.body["status"] == "dead":
            console.call("POST", "/control/restart", {})
            console.call("POST", "/run", {"state": "running"})
        elif health.status == 200 and health.body["status"] == "ok":
            return True
        time.sleep(0.2)
    return False


def _control_pid(console: SoakConsole) -> int:
    return next((pid for pid in children(console.server.pid) if _is_control(pid)), console.server.control_pid)


def _is_control(pid: int) -> bool:
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as command:
            return b"spawn_main" in command.read()
    except FileNotFoundError:
        return False


class Phases:
    """What is done to a console, one thing after the other, and some of it again."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._names: list[str] = []
        self._starts_s: list[float] = []

    def begin(self, name: str) -> None:
        """The one before is over."""
        self._names.append(name)
        self._starts_s.append(time.monotonic())
        self._report.progress(name)

    def during(self, name: str, times_s: np.ndarray) -> list[np.ndarray]:
        """Which of some times lie in a phase, for each time that it was done."""
        phases = np.searchsorted(self._starts_s, times_s) - 1
        return [phases == index for index, other in enumerate(self._names) if other == name]


class Memory:
    """Anonymous memory of the two processes of a console, once a second. Code that comes and goes with the file cache is no
    leak.
    """

    def __init__(self, console: SoakConsole) -> None:
        self._console = console
        self._samples: list[tuple[float, float, float]] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        server = self._console.server
        while not self._ended.wait(1.0):
            try:
                self._samples.append((time.monotonic(), anonymous_mb(server.pid), anonymous_mb(server.control_pid)))
            except (FileNotFoundError, StopIteration):
                return

    def finish(self, report: Report, phases: Phases) -> float:
        """Rows of the median in each phase and round; the growth of both processes together, in MB per hour, between the
        last phases of the last two rounds.
        """
        self._ended.set()
        self._thread.join()
        times, *sizes = np.array(self._samples).T
        grown_mb = 0.0
        for process, size in zip(("web process", "control process"), sizes, strict=True):
            medians: list[float] = []
            for phase in SHARES:
                medians = [float(np.median(size[samples])) for samples in phases.during(phase, times)]
                for turn, median in enumerate(medians, start=1):
                    value(report, "memory", f"{process}, {phase}, round {turn}", median, "MB")
            grown_mb += medians[-1] - medians[-2]
        *_, first, last = (times[samples].mean() for samples in phases.during(list(SHARES)[-1], times))
        return value(report, "memory", "growth", 3600.0 * grown_mb / (last - first), "MB/h")


@dataclass
class Tally:
    """What the rounds came to."""

    generated: list[Generated] = field(default_factory=list)
    opened: int = 0
    lost_calls: int = 0
    windows: int = 0
    falls: int = 0
    refused: int = 0

    def failures(self, check: str) -> int:
        """Of generated calls, of one of CHECKS."""
        return sum(generated.count(check) for generated in self.generated)


def attack(report: Report, console: SoakConsole, phases: Phases, seed: int, duration_s: float, tally: Tally) -> None:
    """One round."""
    calls_s, sockets_s, flood_s, use_s = (share * duration_s for share in SHARES.values())
    calls, sockets, flooded, used = SHARES
    phases.begin(calls)
    tally.generated.append(generated_calls(console.port, seed, calls_s))
    for failure in tally.generated[-1].failures:
        report.progress(failure)
    phases.begin(sockets)
    tally.opened += raw_sockets(console.port, seed, sockets_s)
    phases.begin(flooded)
    tally.lost_calls += overload(report, console, seed, flood_s)
    phases.begin(used)
    use(report, console, random.Random(seed), use_s, tally)


def use(report: Report, console: SoakConsole, dice: random.Random, duration_s: float, tally: Tally) -> None:
    """Random valid use in windows that begin with a reset."""
    end = time.monotonic() + duration_s
    with console.undisturbed():
        while time.monotonic() < end:
            console.call("POST", "/estop/clear")
            answers = [console.call("PUT", "/scene", {"name": dice.choice(SCENES)}).status]
            answers.append(console.call("POST", "/run", {"state": "running", "speed": 1.0}).status)
            calls: list[Any] = []
            until = time.monotonic() + USE_S
            while time.monotonic() < until:
                calls.append(_valid_call(dice))
                answers.append(console.call(*calls[-1]).status)
                time.sleep(dice.uniform(0.05, 0.4))
            state = console.call("GET", "/state")
            if state.status == 200 and lies(state.body):
                tally.falls += 1
                found = {path: console.call("GET", path).body for path in LASTING}
                report.progress(f"fell: {json.dumps(calls)}, with {json.dumps(found)}")
            tally.refused += sum(status == 0 or status >= 400 for status in answers)
            tally.windows += 1
            console.press()


def _valid_call(dice: random.Random) -> tuple[str, str, dict[str, Any]]:
    def some(limit: float) -> list[float]:
        return [round(dice.uniform(-limit, limit), 3) for _ in range(3)]

    kind = dice.randrange(8)
    if kind < 3:
        return "PATCH", "/command", {"mask": [dice.randrange(2) for _ in range(3)], "force_n": some(20.0)}
    if kind == 3:
        return "PATCH", "/command", {"base_velocity": [dice.uniform(-0.5, 0.5), 0.0, dice.uniform(-0.5, 0.5)]}
    if kind == 4:
        return "POST", "/wrenches", {"force_n": some(15.0), "frame": "heading", "duration_s": 1.0, "ramp_s": 0.2}
    if kind == 5:
        return "PUT", "/mismatch", {"mass_scale": round(dice.uniform(0.8, 1.2), 3)}
    if kind == 6:
        return "PUT", "/controller", {"name": dice.choice(CONTROLLERS)}
    return "PUT", "/estimator", {"name": dice.choice(ESTIMATORS)}


def soak(report: Report, duration_s: float) -> None:
    """Everything on one console, and the bars."""
    dead, lost_at_kills = kills(report)
    console = SoakConsole("--seed", str(report.seed))
    phases, memory, tally = Phases(report), Memory(console), Tally()
    console.press_all_along()
    for turn in range(ROUNDS):
        attack(report, console, phases, ROUNDS * report.seed + turn, duration_s / ROUNDS, tally)
    growth_mb = memory.finish(report, phases)
    console.end_presses()
    lost_processes, tracebacks = console.lost_processes(), console.tracebacks()
    console.stop()
    for words in tracebacks:
        report.progress(words[:WORDS])
    value(report, "generated calls", "calls", sum(generated.calls for generated in tally.generated), "")
    for check, words in CHECKS.items():
        value(report, "generated calls", words, tally.failures(check), "")
    value(report, "raw sockets", "opened", tally.opened, "")
    value(report, "random valid use", "windows", tally.windows, "")
    lost_estops, p99 = estops(report, console.presses, phases)
    errors = tally.failures("not_a_server_error")
    failures = sum(len(generated.failures) for generated in tally.generated)
    report.bars += [
        at_most("server errors", errors + len(tracebacks), 0.0, ""),
        at_most("invalid inputs accepted", tally.failures("negative_data_rejection"), 0.0, ""),
        at_most("other answers unlike the document", failures - errors, 0.0, ""),
        at_most("orders of kills not survived", dead, 0.0, ""),
        at_most("processes lost", lost_processes, 0.0, ""),
        at_most("e-stops lost", lost_estops + lost_at_kills, 0.0, ""),
        at_most("e-stop, p99 all along", p99, 20.0, "ms"),
        at_most("calls lost under flood", tally.lost_calls, 0.0, ""),
        at_most("valid calls refused or lost", tally.refused, 0.0, ""),
        at_most("falls under valid use", tally.falls, 0.0, ""),
    ]
    if duration_s >= 60.0 * MEMORY_MINUTES:
        report.bars.append(at_most("growth of memory", growth_mb, 5.0, "MB/h"))


def estops(report: Report, presses: list[Press], phases: Phases) -> tuple[int, float]:
    """Rows of the presses; how many were not confirmed, and the 99th percentile of the others in ms."""
    times_s, durations_ms = np.array(presses).T * [[1.0], [1e3]]
    value(report, "e-stop", "presses", len(presses), "")
    value(report, "e-stop", "p50", float(np.nanmedian(durations_ms)), "ms")
    for phase in SHARES:
        during = np.any(phases.during(phase, times_s), axis=0)
        value(report, "e-stop", f"p99, {phase}", float(np.nanpercentile(durations_ms[during], 99)), "ms")
    p99 = value(report, "e-stop", "p99", float(np.nanpercentile(durations_ms, 99)), "ms")
    return int(np.isnan(durations_ms).sum()), p99


def overload(report: Report, console: SoakConsole, seed: int, duration_s: float) -> int:
    """A flood of PATCHes while the most wrenches act; how many were not answered."""
    console.call("POST", "/estop/clear")
    console.call("POST", "/reset", {})
    console.call("POST", "/run", {"state": "running", "speed": 1.0})
    value(report, "flood", "wrenches", fill_with_wrenches(console, duration_s), "")
    before = console.call("GET", "/state").body["loop"]["overruns"]
    counts = flood(console.port, seed, duration_s)
    loop = console.call("GET", "/state").body["loop"]
    for status, count in sorted(counts.items()):
        value(report, "flood", f"calls answered {status}", count, "")
    value(report, "flood", "tick median", loop["tick_median_us"], "us")
    value(report, "flood", "missed deadlines", loop["overruns"] - before, "")
    return counts.get("lost", 0)


def main() -> None:
    """Run the benchmark."""
    parser = argument_parser(__doc__ or "")
    parser.add_argument("--minutes", type=float, default=30.0, help="after the kills (default 30)")
    arguments = parser.parse_args()
    report = Report("soak", arguments.seed)
    soak(report, 60.0 if arguments.quick else 60.0 * arguments.minutes)
    report.finish(arguments.json)


if __name__ == "__main__":
    main()
