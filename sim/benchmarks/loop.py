"""How fast a tick is, and how well the server keeps time: `python -m sim.benchmarks.loop`.

The headless part steps a session in this process; the other part starts a real server and talks to it as browsers do.
Deadlines and processor shares are meaningful on an otherwise quiet machine only.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco
import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.joints import JOINT_NAMES, NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION, WHEEL_JOINT_NAMES
from control.pipeline import PipelineConfig
from control.robot_model import RobotModel
from control.timing import SLOT_COUNT, TICK_S
from sim import scenes
from sim.benchmarks.report import Report, argument_parser, at_least, at_most
from sim.benchmarks.server_process import ServerProcess, watch
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SNAPSHOT

ESTIMATOR = "hybrid"
WARM_UP_TICKS = 500

DEADLINE_WINDOWS = 6
"""Windows of the other measurements that deadlines are watched for: one stall of the machine misses 20 deadlines at once."""


def row(report: Report, case: str, metric: str, values: np.ndarray, unit: str) -> float:
    """Add p50, p99 and max of `values`; returns p50."""
    p50, p99 = np.percentile(values, [50, 99])
    report.rows.append(
        {"case": case, "metric": metric, "p50": float(p50), "p99": float(p99), "max": float(values.max()), "unit": unit}
    )
    return float(p50)


def value(report: Report, case: str, metric: str, figure: float, unit: str) -> float:
    """Add a row of one figure."""
    report.rows.append({"case": case, "metric": metric, "p50": figure, "p99": None, "max": None, "unit": unit})
    return figure


def durations_us(call: Callable[[], object], count: int) -> np.ndarray:
    """Duration of each of `count` calls."""
    result = np.empty(count)
    for i in range(count):
        start = time.perf_counter()
        call()
        result[i] = time.perf_counter() - start
    return result * 1e6


def headless(report: Report, ticks: int) -> np.ndarray:
    """Ticks of a session alone on one core; returns their durations, us."""
    session = Simulation(SimulationConfig(seed=report.seed, pipeline=PipelineConfig(estimator=ESTIMATOR)))
    for _ in range(WARM_UP_TICKS):
        session.tick(DEFAULT_COMMAND)
    started = time.perf_counter()
    durations = durations_us(lambda: session.tick(DEFAULT_COMMAND), ticks)
    tick = row(report, "headless", "full tick", durations, "us")
    factor = value(report, "headless", "real-time factor", ticks * TICK_S / (time.perf_counter() - started), "x")

    record = np.zeros(1, SNAPSHOT)[0]
    row(report, "headless", "snapshot", durations_us(lambda: session.fill(record), ticks // 10), "us")
    physics = row(report, "headless", "bare mj_step", durations_us(bare_physics(session), ticks), "us")
    terms = row(report, "headless", "bare Pinocchio terms", durations_us(bare_terms(session), ticks), "us")
    value(report, "headless", "share of bare mj_step in the tick", 100 * physics / tick, "%")
    value(report, "headless", "share of bare Pinocchio terms in the tick", 100 * terms / tick, "%")
    report.bars += [
        at_most("full tick, median", tick, 500.0, "us"),
        at_least("headless real-time factor on one core", factor, 3.0, "x"),
    ]
    return durations


def bare_physics(session: Simulation) -> Callable[[], None]:
    """mj_step of the same scene with the drives of the MJCF holding the nominal posture."""
    model = scenes.build(session.backend.scene).model
    data = mujoco.MjData(model)
    for name, position in zip(JOINT_NAMES, NOMINAL_POSITION, strict=True):
        data.qpos[model.joint(name).qposadr] = position
        if name not in WHEEL_JOINT_NAMES:
            data.ctrl[model.actuator(name).id] = position
    data.qpos[2] = NOMINAL_BASE_HEIGHT_M
    for _ in range(WARM_UP_TICKS):
        mujoco.mj_step(model, data)
    return lambda: mujoco.mj_step(model, data)


def bare_terms(session: Simulation) -> Callable[[], None]:
    """Update of the Pinocchio model at the session's posture."""
    model = RobotModel()
    sensor, base = session.backend.read(), session.output.base

    def update() -> None:
        model.update(
            base.rotation_base_to_world,
            sensor.joint_position,
            base.linear_velocity_in_base,
            base.angular_velocity_in_base,
            sensor.joint_velocity,
        )

    return update


def served(report: Report, seconds: float, calls: int) -> None:
    """Start-up, latencies, deadlines, processor and memory of a real server."""
    server = ServerProcess("--estimator", ESTIMATOR, "--seed", str(report.seed))
    try:
        value(report, "server", "command to usable page", server.start_s, "s")
        latencies(report, server, calls)
        realtime = bool(server.state()["loop"]["realtime_scheduling"])
        if realtime:
            missed_fifo = deadlines(report, server, DEADLINE_WINDOWS * seconds, "SCHED_FIFO")
            report.bars.append(at_most("missed deadlines with SCHED_FIFO, one client at 30 Hz", missed_fifo, 0.1, "%"))
            os.sched_setscheduler(server.control_pid, os.SCHED_OTHER, os.sched_param(0))
        missed = deadlines(report, server, DEADLINE_WINDOWS * seconds, "no real-time scheduling")
        report.bars.append(at_most("missed deadlines without real-time scheduling, one client at 30 Hz", missed, 3.0, "%"))
        if realtime:
            os.sched_setscheduler(server.control_pid, os.SCHED_FIFO, os.sched_param(20))
        for clients, limit in ((1, 30.0), (16, 50.0)):
            share = processor(report, server, clients, seconds)
            report.bars.append(at_most(f"web process with {clients} client(s) at 30 Hz", share, limit, "% of a core"))
        memory = value(report, "server", "resident memory, all processes", server.resident_mb(), "MB")
        report.bars += [
            at_most("command to usable page", server.start_s, 10.0, "s"),
            at_most("resident memory, all processes", memory, 1500.0, "MB"),
        ]
    finally:
        server.stop()


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


def deadlines(report: Report, server: ServerProcess, seconds: float, case: str) -> float:
    """Share of ticks that missed their deadline while one browser's worth of sockets is read, %."""
    counts: list[int] = []

    def measure() -> None:
        counts.append(server.state()["loop"]["overruns"])
        time.sleep(seconds)
        counts.append(server.state()["loop"]["overruns"])

    watch(server.port, 1, 30.0, measure)
    loop = server.state()["loop"]
    value(report, case, "lateness p99 over 5 s", loop["lateness_p99_ms"], "ms")
    value(report, case, "tick median over 5 s", loop["tick_median_us"], "us")
    return value(report, case, "missed deadlines", 100 * (counts[1] - counts[0]) * TICK_S / seconds, "%")


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


def plot(folder: Path, durations: np.ndarray) -> None:
    """Draw how long ticks take, apart for those that run the controller."""
    from matplotlib import pyplot  # plots are optional, so the library is only needed for them

    folder.mkdir(parents=True, exist_ok=True)
    figure, axes = pyplot.subplots(figsize=(7, 3.5))
    phase = (WARM_UP_TICKS + np.arange(len(durations))) % SLOT_COUNT
    bins = np.linspace(0.0, 2000.0, 101).tolist()
    axes.hist(durations[phase == 0], bins, label="with the 50 Hz controller")
    axes.hist(durations[phase != 0], bins, alpha=0.6, label="without")
    axes.axvline(1e6 * TICK_S, color="black", linewidth=1.0)
    axes.set(xlabel="tick [us]", ylabel="ticks", title="Duration of a tick, headless")
    axes.legend()
    figure.tight_layout()
    figure.savefig(folder / "loop.png", dpi=150)
    pyplot.close(figure)


def main() -> None:
    """Run the benchmark."""
    arguments = argument_parser(__doc__ or "").parse_args()
    report = Report("loop", arguments.seed)
    report.progress("headless ticks")
    durations = headless(report, 500 if arguments.quick else 5000)
    if arguments.plot is not None:
        plot(arguments.plot, durations)
    report.progress("server")
    served(report, 2.0 if arguments.quick else 10.0, 20 if arguments.quick else 300)
    report.finish(arguments.json)


if __name__ == "__main__":
    main()
