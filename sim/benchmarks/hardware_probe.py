"""The emulated robot of the hardware link benchmark, in a process of its own, with a stopwatch on the wire.

A second participant watches `rt/lowcmd`: for every frame the time of its arrival, the state it answers, and whether it damps.
"""

import os
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from sim.backends.unitree.dds import COMMAND_TOPIC, DdsConfig, DdsRobotLink, Endpoint, samples
from sim.backends.unitree.messages import LowCommand
from sim.backends.unitree.motors import used_slots
from sim.emulator.arm_controller import ArmPorts
from sim.emulator.emulator import Emulator, EmulatorConfig
from sim.processes.realtime import request_realtime

FIFO_PRIORITY = 25


@dataclass(frozen=True, slots=True)
class Watch:
    """What was seen on the wire since the last question. Times are monotonic seconds.

    Attributes:
        state_tick_ms, state_s: (n,) states published.
        frame_tick_ms, frame_s, frame_damps: (m,) commands that arrived.
        frames_ever: commands that arrived since the process started.
        cpu_s, wall_s: processor and wall-clock time of the emulator.
    """

    state_tick_ms: np.ndarray
    state_s: np.ndarray
    frame_tick_ms: np.ndarray
    frame_s: np.ndarray
    frame_damps: np.ndarray
    frames_ever: int
    cpu_s: float
    wall_s: float

    def round_trips_s(self) -> np.ndarray:
        """From publishing a state to the arrival of the first frame that answers it, for all that were answered."""
        answered, first = np.unique(self.frame_tick_ms, return_index=True)
        published = dict(zip(self.state_tick_ms.tolist(), self.state_s.tolist(), strict=True))
        pairs = [
            (self.frame_s[i] - published[t]) for t, i in zip(answered.tolist(), first.tolist(), strict=True) if t in published
        ]
        return np.array(pairs)

    def skipped(self) -> int:
        """States between the first and the last answered one that no frame answers: mostly because a newer one was there."""
        answered = set(self.frame_tick_ms.tolist())
        inside = (self.state_tick_ms >= min(answered)) & (self.state_tick_ms <= max(answered))
        return sum(tick not in answered for tick in self.state_tick_ms[inside].tolist())

    def damped_after_s(self, moment_s: float) -> float:
        """From `moment_s` to the first damping frame after it; NaN if there is none."""
        hits = self.frame_s[(self.frame_s > moment_s) & self.frame_damps]
        return float(hits[0] - moment_s) if len(hits) else float("nan")


class _Probe:
    def __init__(self, domain: int, arm_port: int) -> None:
        network = DdsConfig(domain)
        ports = ArmPorts(arm_port, arm_port + 1)
        self.emulator = Emulator(EmulatorConfig(mode="", arm=ports), DdsRobotLink(network))
        self._endpoint = Endpoint(network)
        from sim.backends.unitree.idl import LowCmd_

        self._frames = self._endpoint.reader(COMMAND_TOPIC, LowCmd_, wakes=True)
        self.frames_ever = 0
        self.clear()
        publish = self.emulator.base.publish

        def timed_publish() -> None:
            publish()
            if not self.emulator.faults.freeze:
                self.states.append((round(1000 * self.emulator.body.time_s), time.monotonic()))

        self.emulator.base.publish = timed_publish  # type: ignore[method-assign]

    def clear(self) -> None:
        self.states: list[tuple[int, float]] = []
        self.seen: list[tuple[int, float, bool]] = []
        self.started = (time.process_time(), time.monotonic())

    def watch(self) -> None:
        while True:
            self._endpoint.wait(0.1)
            now = time.monotonic()
            for sample in samples(self._frames):
                self.frames_ever += 1
                command = LowCommand.decode(sample)
                damps = not command.motor["kp"].any() and bool((used_slots(command.motor["kd"]) > 0).all())
                self.seen.append((int(command.record["reserve"]), now, damps))

    def report(self) -> Watch:
        states, seen = list(self.states), list(self.seen)
        cpu_s, wall_s = time.process_time() - self.started[0], time.monotonic() - self.started[1]
        return Watch(
            np.array([tick for tick, _ in states]),
            np.array([at for _, at in states]),
            np.array([tick for tick, _, _ in seen]),
            np.array([at for _, at, _ in seen]),
            np.array([damps for _, _, damps in seen], dtype=bool),
            self.frames_ever,
            cpu_s,
            wall_s,
        )


def run(domain: int, arm_port: int, pipe: Connection) -> None:
    """Entry point of the process: answers "clear", "watch" and fault dictionaries until "end"."""
    realtime = request_realtime(FIFO_PRIORITY)
    probe = _Probe(domain, arm_port)
    threading.Thread(target=probe.watch, daemon=True).start()
    threading.Thread(target=probe.emulator.run_realtime, daemon=True).start()
    pipe.send(realtime)
    while True:
        order = pipe.recv()
        if order == "end":
            pipe.send(None)
            os._exit(0)
        if order == "clear":
            probe.clear()
            pipe.send(None)
        elif order == "watch":
            pipe.send(probe.report())
        else:
            for name, value in order.items():
                setattr(probe.emulator.faults, name, value)
            pipe.send(probe.emulator.body.time_s)
