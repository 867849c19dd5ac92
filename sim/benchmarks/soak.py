"""Attack and soak of a console: `python -m sim.benchmarks.soak` (30 minutes; `--minutes`, or `--quick` for one).

Processes are stopped and killed in every order. Then one console stands generated calls, raw sockets, floods at the maximum of
wrenches, and random valid use in windows, while its e-stop is pressed all along. Quantiles and deadlines are meaningful on an
otherwise quiet machine only. It needs `pip install -e ".[soak]"`.
"""

import json
import math
import random
import threading
import time
from typing import Any

import numpy as np

from control.timing import TICK_S
from sim.benchmarks.report import Report, argument_parser, at_most
from sim.benchmarks.server_process import children
from sim.benchmarks.soak_attacks import KILLS, fill_with_wrenches, flood, raw_sockets
from sim.benchmarks.soak_calls import CHECKS, generated_calls
from sim.benchmarks.soak_console import Press, SoakConsole, anonymous_mb, lies
from sim.runtime.history import WINDOW_S

USE_S = 5.0
"""From one reset to the next under random valid use."""

MEMORY_MINUTES = 10.0
"""A shorter soak says nothing about growth per hour."""

WARM_UP_SHARE = 0.1
"""Of the time, for each attack once before memory counts: what is loaded at the first call, and room for the most connections,
is taken once and kept."""

_STEP_S = 5.0  # simulated per call, while the history fills

WORDS = 2000
"""Of the log that are shown of each traceback."""

SETTLE_S = 60.0
NOTICED_S = 1.0
"""A control process that was killed is known to be dead by then."""

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


def warm_up(report: Report, console: SoakConsole, duration_s: float) -> None:
    """Each attack and each kind of use once, and a history that is full."""
    generated_calls(console.port, report.seed + 1, 0.4 * duration_s)
    raw_sockets(console.port, report.seed + 1, 0.2 * duration_s)
    use(report, console, random.Random(report.seed + 1), 0.2 * duration_s)
    flood(console.port, report.seed + 1, 0.2 * duration_s)
    console.call("POST", "/estop/clear")
    console.call("POST", "/reset", {})
    console.call("POST", "/run", {"state": "paused"})
    for _ in range(round(WINDOW_S / _STEP_S)):
        console.call("POST", "/step", {"ticks": round(_STEP_S / TICK_S)})


class Phases:
    """What is done to a console, one thing after the other."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self.names: list[str] = []
        self._starts_s: list[float] = []

    def begin(self, name: str) -> None:
        """The one before is over."""
        self.names.append(name)
        self._starts_s.append(time.monotonic())
        self._report.progress(name)

    def during(self, name: str, times_s: np.ndarray) -> np.ndarray:
        """Which of some times lie in a phase."""
        return np.searchsorted(self._starts_s, times_s) - 1 == self.names.index(name)


class Growth:
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
        """Rows of the median in each phase, and of the slope of the least squares line; the slopes' sum in MB per hour."""
        self._ended.set()
        self._thread.join()
        times, *sizes = np.array(self._samples).T
        slopes_mb = 0.0
        for process, size in zip(("web process", "control process"), sizes, strict=True):
            for phase in phases.names:
                median = float(np.median(size[phases.during(phase, times)]))
                value(report, "memory", f"{process}, {phase}", median, "MB")
            slope = 3600.0 * float(np.polyfit(times - times[0], size, 1)[0])
            slopes_mb += value(report, "memory", f"growth, {process}", slope, "MB/h")
        return slopes_mb


def use(report: Report, console: SoakConsole, dice: random.Random, duration_s: float) -> tuple[int, int, int]:
    """Random valid use in windows that begin with a reset: windows, falls, and calls that were not answered as they should."""
    falls = failed = windows = 0
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
                falls += 1
                report.progress(f"fell in window {windows}: {json.dumps(calls)}")
            failed += sum(status == 0 or status >= 400 for status in answers)
            windows += 1
            console.press()
    return windows, falls, failed


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
    report.progress("warm-up")
    warm_up(report, console, WARM_UP_SHARE * duration_s)
    phases, growth = Phases(report), Growth(console)
    console.press_all_along()
    phases.begin("generated calls")
    generated = generated_calls(console.port, report.seed, 0.3 * duration_s)
    value(report, "generated calls", "calls", generated.calls, "")
    for check, words in CHECKS.items():
        value(report, "generated calls", words, generated.count(check), "")
    for failure in generated.failures:
        report.progress(failure)
    phases.begin("raw sockets")
    value(report, "raw sockets", "opened", raw_sockets(console.port, report.seed, 0.15 * duration_s), "")
    phases.begin("flood at the maximum of wrenches")
    lost_calls = overload(report, console, 0.2 * duration_s)
    phases.begin("random valid use")
    windows, falls, failed = use(report, console, random.Random(report.seed), 0.25 * duration_s)
    value(report, "random valid use", "windows", windows, "")
    growth_mb = growth.finish(report, phases)
    console.end_presses()
    lost_processes, tracebacks = console.lost_processes(), console.tracebacks()
    console.stop()
    lost_estops, p99 = estops(report, console.presses, phases)
    for words in tracebacks:
        report.progress(words[:WORDS])
    errors = generated.count("not_a_server_error") + len(tracebacks)
    report.bars += [
        at_most("server errors", errors, 0.0, ""),
        at_most("invalid inputs accepted", generated.count("negative_data_rejection"), 0.0, ""),
        at_most("other answers unlike the document", len(generated.failures) - errors + len(tracebacks), 0.0, ""),
        at_most("orders of kills not survived", dead, 0.0, ""),
        at_most("processes lost", lost_processes, 0.0, ""),
        at_most("e-stops lost", lost_estops + lost_at_kills, 0.0, ""),
        at_most("e-stop, p99 all along", p99, 20.0, "ms"),
        at_most("calls lost under flood", lost_calls, 0.0, ""),
        at_most("valid calls refused or lost", failed, 0.0, ""),
        at_most("falls under valid use", falls, 0.0, ""),
    ]
    if duration_s >= 60.0 * MEMORY_MINUTES:
        report.bars.append(at_most("growth of memory", growth_mb, 5.0, "MB/h"))


def estops(report: Report, presses: list[Press], phases: Phases) -> tuple[int, float]:
    """Rows of the presses; how many were not confirmed, and the 99th percentile of the others in ms."""
    times_s, durations_ms = np.array(presses).T * [[1.0], [1e3]]
    value(report, "e-stop", "presses", len(presses), "")
    value(report, "e-stop", "p50", float(np.nanmedian(durations_ms)), "ms")
    for phase in phases.names:
        value(report, "e-stop", f"p99, {phase}", float(np.nanpercentile(durations_ms[phases.during(phase, times_s)], 99)), "ms")
    p99 = value(report, "e-stop", "p99", float(np.nanpercentile(durations_ms, 99)), "ms")
    return int(np.isnan(durations_ms).sum()), p99


def overload(report: Report, console: SoakConsole, duration_s: float) -> int:
    """A flood of PATCHes while the most wrenches act; how many were not answered."""
    console.call("POST", "/estop/clear")
    console.call("POST", "/reset", {})
    console.call("POST", "/run", {"state": "running", "speed": 1.0})
    value(report, "flood", "wrenches", fill_with_wrenches(console, duration_s), "")
    before = console.call("GET", "/state").body["loop"]["overruns"]
    counts = flood(console.port, report.seed, duration_s)
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
