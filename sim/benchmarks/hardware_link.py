"""The link to the robot against its bars: round trip, losses, processor share, codec cost, watchdog and e-stop reaction.

Everything runs over real DDS and UDP on loopback, in three processes as on a robot: the emulated robot, the I/O process, and
this one in the place of the control process. Protocol-verified, not robot-verified: no number here was taken on a robot.

Lost are states that never reached the driver (gaps in the robot's tick) and commands that never reached a reader beside the
robot's, both with a depth of 16. After a stall the driver takes in all states that wait and answers the newest; how many were
skipped so is a row without a bar, as is the longest pause of this process: neither can be told from a stall of the machine.

    python -m sim.benchmarks.hardware_link [--quick] [--minutes 10] [--json PATH]
"""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import numpy as np

from control.joints import DAMPING, NOMINAL_POSITION, STIFFNESS
from control.timing import TICK_S
from control.types import JointCommand
from sim.backends.hardware.backend import HONESTY, HardwareBackend, unavailable_because
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.io.command_limiter import stack
from sim.backends.hardware.io.motions import MotionConfig
from sim.backends.hardware.robot import Robot
from sim.backends.hardware.states import DriveState, Request
from sim.backends.unitree.dds import DdsBaseLink, DdsConfig
from sim.backends.unitree.driver import BaseDriver
from sim.backends.unitree.messages import LowState
from sim.backends.z1.driver import Z1Config
from sim.benchmarks.hardware_probe import Watch, run
from sim.benchmarks.report import Report, argument_parser, at_least, at_most
from sim.emulator.memory_link import MemoryBaseLink, MemoryWire
from sim.emulator.process import free_udp_port
from sim.processes.realtime import request_realtime

FIFO_PRIORITY = 20
_PATIENCE_S = 20.0
_UP = {
    DriveState.OBSERVE: Request.ENGAGE,
    DriveState.DAMPED: Request.STAND,
    DriveState.READY: Request.START,
    DriveState.FAULT: Request.CLEAR,
}
_DOWN = {DriveState.POLICY: Request.SIT, DriveState.READY: Request.SIT, DriveState.DAMPED: Request.RELEASE}


class Control:
    """This process in the place of the control process: heartbeats and commands from a thread, requests from the outside."""

    def __init__(self, config: HardwareConfig) -> None:
        self.backend = HardwareBackend(config)
        self.backend.open()
        request_realtime(FIFO_PRIORITY)  # as the control process does
        self.silent = False
        self.last_write_s = time.monotonic()
        self.longest_pause_s = 0.0
        self._lock = threading.Lock()
        threading.Thread(target=self._live, daemon=True).start()

    def _live(self) -> None:
        hold = JointCommand(NOMINAL_POSITION, np.zeros(22), STIFFNESS, DAMPING)
        while True:
            if not self.silent:
                with self._lock:
                    self.backend.write(hold)
                    now = time.monotonic()
                    self.longest_pause_s = max(self.longest_pause_s, now - self.last_write_s)
                    self.last_write_s = now
            time.sleep(TICK_S)

    def request(self, request: Request) -> None:
        with self._lock:
            self.backend.request(request)

    def bring_to(self, goal: DriveState) -> None:
        """Through the states up to `goal`, or down to OBSERVE, asking again where something was refused.

        Raises:
            TimeoutError: with the last refusal.
        """
        deadline = time.monotonic() + _PATIENCE_S
        steps = _DOWN if goal == DriveState.OBSERVE else _UP
        asked_s = 0.0
        while True:
            status = self.backend.status()
            if status.state == goal:
                return
            wanted = steps.get(status.state)
            if wanted is not None and not status.engaging and time.monotonic() - asked_s > 0.3:
                self.request(wanted)
                asked_s = time.monotonic()
            if time.monotonic() > deadline:
                raise TimeoutError(f"not {goal.name} but {status.state.name}: {status.message}")
            time.sleep(0.01)


class Stage:
    """Emulator and I/O process, and this control."""

    def __init__(self, domain: int) -> None:
        port = free_udp_port()
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=run, args=(domain, port, theirs), daemon=True)
        self._process.start()
        self.emulator_realtime = bool(self._pipe.recv())
        self.config = HardwareConfig(
            DdsConfig(domain),
            Z1Config("127.0.0.1", port, port + 1, gain_ramp_s=0.3),
            motion=MotionConfig(fold_s=0.6, rise_s=1.6),
            dry_run=False,
            echo_tick=True,
        )
        self.control = Control(self.config)
        self.io_pid = self.control.backend.io_pid

    def faults(self, **changes: object) -> None:
        _ask(self._pipe, changes)

    def clear(self) -> None:
        _ask(self._pipe, "clear")

    def watch(self) -> Watch:
        report = _ask(self._pipe, "watch")
        assert isinstance(report, Watch)
        return report

    def close(self) -> None:
        self.control.silent = True
        os.kill(self.io_pid, signal.SIGTERM)
        _ask(self._pipe, "end")


def _ask(pipe: Connection, order: object) -> object:
    pipe.send(order)
    return pipe.recv()


def _cpu_s(pid: int) -> float:
    fields = open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()  # noqa: SIM115
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _percentiles(report: Report, case: str, metric: str, values: np.ndarray, unit: str) -> tuple[float, float, float]:
    p50, p99, worst = (float(np.percentile(values, p)) for p in (50, 99, 100))
    row = {"case": case, "metric": metric, "p50": p50, "p99": p99, "max": worst, "unit": unit, "samples": len(values)}
    report.rows.append(row)
    return p50, p99, worst


def _single(report: Report, case: str, metric: str, value: float, unit: str) -> None:
    report.rows.append({"case": case, "metric": metric, "p50": value, "unit": unit})


def measure_codec(report: Report, repetitions: int) -> None:
    """Cost of a command (five arrays, CRC, bytes) and of a state (CRC, all fields)."""
    wire = MemoryWire()
    driver = BaseDriver(MemoryBaseLink(wire))
    targets = np.tile(np.linspace(0.1, 1.6, 16), (5, 1))
    sample = LowState().encode()

    def encode() -> None:
        driver.write(targets)

    def decode() -> None:
        wire.states.append(sample)
        driver.poll(0.0)

    for name, work, limit in (("encode command", encode, 30.0), ("decode state", decode, 60.0)):
        batches = []
        for _ in range(repetitions):
            start = time.perf_counter()
            for _ in range(200):
                work()
            batches.append((time.perf_counter() - start) / 200 * 1e6)
        p50, _, _ = _percentiles(report, "codec", name, np.array(batches), "us")
        report.bars.append(at_most(f"{name} with CRC", p50, limit, "us"))


def measure_round_trip(report: Report, stage: Stage, seconds: float) -> None:
    """Round trips, losses, rate and processor share while the robot stands under commands.

    Losses are counted from OBSERVE to OBSERVE, where nothing is sent, so nothing is under way.
    """
    control = stage.control
    control.bring_to(DriveState.OBSERVE)
    before, seen = control.backend.status(), stage.watch().frames_ever
    control.bring_to(DriveState.POLICY)
    time.sleep(0.5)
    stage.clear()
    cpu, start = _cpu_s(stage.io_pid), time.monotonic()
    time.sleep(seconds)
    watch = stage.watch()
    share = 100.0 * (_cpu_s(stage.io_pid) - cpu) / (time.monotonic() - start)
    control.bring_to(DriveState.OBSERVE)
    time.sleep(0.5)
    after = control.backend.status()
    lost_states = after.states_missed - before.states_missed
    lost_commands = after.frames_sent - before.frames_sent - (stage.watch().frames_ever - seen)
    p50, p99, _ = _percentiles(report, "link", "round trip", 1e3 * watch.round_trips_s(), "ms")
    rate = (len(watch.frame_s) - 1) / (watch.frame_s[-1] - watch.frame_s[0])
    _single(report, "link", "command rate", rate, "Hz")
    _single(report, "link", "lost states", lost_states, f"of {after.states_received - before.states_received}")
    _single(report, "link", "lost commands", lost_commands, f"of {after.frames_sent - before.frames_sent}")
    _single(report, "link", "states skipped", watch.skipped(), f"of {len(watch.state_s)}")
    _single(report, "link", "I/O process", share, "% of a core")
    _single(report, "link", "emulator", 100.0 * watch.cpu_s / watch.wall_s, "% of a core")
    report.bars += [
        at_most("round trip p50", p50, 0.6, "ms"),
        at_most("round trip p99", p99, 1.5, "ms"),
        at_most("lost states and commands", lost_states + lost_commands, 0, ""),
        at_most("command rate off 500 Hz", abs(rate - 500.0), 1.0, "Hz"),
        at_most("I/O process", share, 25.0, "% of a core"),
    ]


def measure_reaction(
    report: Report, stage: Stage, name: str, repetitions: int, limit_ms: float, provoke: Callable[[], float]
) -> None:
    """From the moment that `provoke` returns to the first damping frame on the wire."""
    reactions = []
    for repetition in range(repetitions):
        report.progress(f"{name} {repetition + 1}/{repetitions}")
        stage.control.bring_to(DriveState.POLICY)
        stage.clear()
        time.sleep(0.6)
        moment = provoke()
        time.sleep(0.4)
        reactions.append(1e3 * stage.watch().damped_after_s(moment))
        stage.faults(freeze=False)
        stage.control.silent = False
        time.sleep(1.5)
    _percentiles(report, "reaction", name, np.array(reactions), "ms")
    report.bars.append(at_most(f"{name}, p95", float(np.percentile(reactions, 95)), limit_ms, "ms"))


def measure_false_trips(report: Report, stage: Stage, seconds: float) -> None:
    """How often the healthy link trips."""
    trips, end = 0, time.monotonic() + seconds
    control = stage.control
    control.bring_to(DriveState.POLICY)
    control.longest_pause_s = worst = 0.0
    while time.monotonic() < end:
        time.sleep(0.1)
        status, pause_s = control.backend.status(), control.longest_pause_s
        worst = max(worst, pause_s)
        if status.state != DriveState.POLICY:
            report.progress(
                f"false trip: {status.message}; control paused for {1e3 * pause_s:.0f} ms, "
                f"the I/O process for {status.worst_period_ms:.0f} ms"
            )
            trips += 1
            control.bring_to(DriveState.POLICY)
        control.longest_pause_s = 0.0
    _single(report, "link", "false trips", trips, f"in {seconds:.0f} s")
    _single(report, "link", "longest pause of control", 1e3 * worst, "ms")
    report.bars.append(at_most("false trips", trips, 0, f"in {seconds:.0f} s"))


def measure_lockstep(report: Report, domain: int, steps: int) -> None:
    """Steps per second when the emulator waits for every answer, over the same DDS."""
    port = free_udp_port()
    command = [sys.executable, "-m", "sim.emulator", "--lockstep", "--released", "--domain", str(domain)]
    emulator = subprocess.Popen([*command, "--arm-port", str(port)], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
    config = HardwareConfig()
    robot = Robot(DdsBaseLink(DdsConfig(domain)), Z1Config("127.0.0.1", port, port + 1), config.limits, False, True)
    targets = stack(JointCommand(NOMINAL_POSITION, np.zeros(22), STIFFNESS, DAMPING))
    answered, start = 0, time.perf_counter()
    while answered < steps:
        robot.base.link.wait(_PATIENCE_S)
        if robot.poll(time.monotonic()) and robot.frame is not None:
            if answered == 1:
                start = time.perf_counter()
            robot.write(time.monotonic(), targets)
            answered += 1
    rate = (answered - 1) / (time.perf_counter() - start)
    robot.close()
    emulator.kill()
    _single(report, "lockstep", "steps", rate, "1/s")
    report.bars.append(at_least("lockstep", rate, 1000.0, "steps/s"))


def main() -> None:
    """Run every case and print rows and bars."""
    parser = argument_parser(__doc__ or "")
    parser.add_argument("--minutes", type=float, help="how long to watch for false trips (default 10, with --quick 0.1)")
    options = parser.parse_args()
    minutes = options.minutes or (0.1 if options.quick else 10.0)
    report = Report("hardware_link", options.seed)
    reason = unavailable_because()
    if reason is not None:
        raise SystemExit(reason)
    domain = 2 + options.seed % 200
    measure_codec(report, 5 if options.quick else 50)
    report.progress("lockstep")
    measure_lockstep(report, domain, 500 if options.quick else 5000)
    stage = Stage(domain + 1)
    try:
        repetitions = 2 if options.quick else 25
        limits = stage.config.limits
        report.progress("round trip")
        measure_round_trip(report, stage, 3.0 if options.quick else 60.0)

        def freeze() -> float:
            stage.faults(freeze=True)
            return float(stage.watch().state_s[-1])

        def silence() -> float:
            stage.control.silent = True
            time.sleep(2 * TICK_S)
            return stage.control.last_write_s

        def estop() -> float:
            moment = time.monotonic()
            stage.control.backend.estop()
            return moment

        frozen_ms, silent_ms = 1e3 * limits.state_damp_s, 1e3 * limits.command_damp_s
        measure_reaction(report, stage, "states stop", repetitions, frozen_ms + 6.0, freeze)
        measure_reaction(report, stage, "control silent", repetitions, silent_ms + 6.0, silence)
        measure_reaction(report, stage, "e-stop", repetitions, 10.0, estop)
        report.progress("false trips")
        measure_false_trips(report, stage, 60.0 * minutes)
        status = stage.control.backend.status()
        scheduling = status.realtime_scheduling and stage.emulator_realtime
        _single(report, "machine", "real-time scheduling", float(scheduling), "1 = granted")
        _single(report, "machine", "load average", os.getloadavg()[0], "")
    finally:
        stage.close()
    report.finish(options.json)
    print(f"\n{HONESTY}")


if __name__ == "__main__":
    main()
