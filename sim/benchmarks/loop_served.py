"""How well a real server keeps time, and how soon it obeys, seen from outside as browsers see it."""

import os
import time

import numpy as np

from control.timing import TICK_S
from sim.benchmarks.loop_headless import ESTIMATOR
from sim.benchmarks.loop_reference import FIFO_PRIORITY, missed_by_physics
from sim.benchmarks.loop_rows import row, value
from sim.benchmarks.report import Report, at_most
from sim.benchmarks.server_process import ServerProcess, resident_mb, watch

FIFO, NO_FIFO = "SCHED_FIFO", "no real-time scheduling"


def served(report: Report, watched_s: float, calls: int, slow_machine: bool) -> None:
    """Start-up, latencies, deadlines, processor and memory of a real server.

    Args:
        report: rows and bars go here.
        watched_s: for which deadlines are watched, with and without real-time scheduling; the processor for a sixth of it.
        calls: of each kind whose latency is measured.
        slow_machine: more deadlines may be missed.
    """
    arguments = ("--estimator", ESTIMATOR, "--seed", str(report.seed))
    ServerProcess(*arguments).stop()  # the first start after a change compiles the laws
    server = ServerProcess(*arguments)
    ticks_s: dict[bool, float] = {}
    try:
        value(report, "server", "command to usable page", server.start_s, "s")
        latencies(report, server, calls)
        realtime = bool(server.state()["loop"]["realtime_scheduling"])
        if realtime:
            missed_fifo, ticks_s[True] = deadlines(report, server, watched_s, FIFO)
            limit = 0.5 if slow_machine else 0.1
            report.bars.append(at_most("missed deadlines with SCHED_FIFO, one client at 30 Hz", missed_fifo, limit, "%"))
            os.sched_setscheduler(server.control_pid, os.SCHED_OTHER, os.sched_param(0))
        missed, ticks_s[False] = deadlines(report, server, watched_s, NO_FIFO)
        report.bars.append(at_most("missed deadlines without real-time scheduling, one client at 30 Hz", missed, 1.0, "%"))
        if realtime:
            os.sched_setscheduler(server.control_pid, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
        for clients, limit in ((1, 30.0), (16, 50.0)):
            share = processor(report, server, clients, watched_s / 6.0)
            report.bars.append(at_most(f"web process with {clients} client(s) at 30 Hz", share, limit, "% of a core"))
        control = value(report, "server", "resident memory, control process", resident_mb(server.control_pid), "MB")
        memory = value(report, "server", "resident memory, all processes", server.resident_mb(), "MB")
        report.bars += [
            at_most("resident memory, control process", control, 300.0, "MB"),
            at_most("command to usable page", server.start_s, 10.0, "s"),
            at_most("resident memory, all processes", memory, 1500.0, "MB"),
        ]
    finally:
        server.stop()
    for fifo, tick_s in ticks_s.items():
        metric = "missed deadlines of bare mj_steps that take as long"
        value(report, FIFO if fifo else NO_FIFO, metric, missed_by_physics(watched_s, tick_s, fifo), "%")


def latencies(report: Report, server: ServerProcess, calls: int) -> None:
    """From a PATCH to the snapshot that took it, and from a POST of the e-stop to its confirmation."""
    command = np.empty(calls)
    for i in range(calls):
        sent = time.time()
        force = [0.0, 0.0, float(i % 5)]
        sequence = server.request("PATCH", "/api/v1/command", {"force_n": force})["sequence"]
        while (state := server.state())["command_sequence"] < sequence:
            pass
        command[i] = 1e3 * (state["wall_time_s"] - sent)
    estop = np.empty(calls)
    for i in range(calls):
        started = time.perf_counter()
        answer = server.request("POST", "/api/v1/estop")
        estop[i] = 1e3 * (time.perf_counter() - started)
        assert answer["latched"], answer
        server.request("POST", "/api/v1/estop/clear")
    server.request("POST", "/api/v1/reset", {})
    row(report, "server", "command to simulation", command, "ms")
    row(report, "server", "e-stop to confirmation", estop, "ms")
    report.bars += [
        at_most("command to simulation, p95", float(np.percentile(command, 95)), 10.0, "ms"),
        at_most("e-stop to confirmation, p99", float(np.percentile(estop, 99)), 20.0, "ms"),
    ]


def deadlines(report: Report, server: ServerProcess, seconds: float, case: str) -> tuple[float, float]:
    """Share of ticks that missed their deadline while one browser's worth of sockets is read, %, and their median, s."""
    counts: list[int] = []

    def measure() -> None:
        counts.append(server.state()["loop"]["overruns"])
        time.sleep(seconds)
        counts.append(server.state()["loop"]["overruns"])

    watch(server.port, 1, 30.0, measure)
    loop = server.state()["loop"]
    value(report, case, "lateness p99 over 5 s", loop["lateness_p99_ms"], "ms")
    value(report, case, "tick median over 5 s", loop["tick_median_us"], "us")
    missed = value(report, case, "missed deadlines", 100 * (counts[1] - counts[0]) * TICK_S / seconds, "%")
    return missed, 1e-6 * loop["tick_median_us"]


def processor(report: Report, server: ServerProcess, clients: int, seconds: float) -> float:
    """Share of a core that the web process takes while `clients` browsers' worth of sockets are read, %."""
    spent: list[float] = []

    def measure() -> None:
        before = server.web_cpu_s()
        time.sleep(seconds)
        spent.append(server.web_cpu_s() - before)

    received = watch(server.port, clients, 30.0, measure)
    value(report, f"{clients} client(s)", "states per client", received / seconds, "Hz")
    return value(report, f"{clients} client(s)", "web process", 100 * spent[0] / seconds, "% of a core")
