"""Of the benchmark of recordings: what they cost the tick, history, the recorder, and the pipeline run again."""

import gc
import multiprocessing
import os
import time
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from control.state.capture import Moment
from control.timing import TICK_S
from sim.benchmarks.report import Report, at_least, at_most
from sim.recording import tap as tap_module
from sim.recording.body_tree import BodyTree
from sim.recording.describe import describe_session, standing_attachments
from sim.recording.description import Description
from sim.recording.reader import Recording
from sim.recording.recorder import recorder_process
from sim.recording.rerun import reestimate, rerun
from sim.recording.tap import TICK_SLOTS, Heads, Tap
from sim.runtime.history import History
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT, command_to_record
from sim.runtime.tick_row import TickRow

BLOCK = 250
_PUBLISHED_EVERY = 5
_ASKED_EVERY = 10
"""Ticks between two set-points: more of them than a console writes while nobody drives."""


def setpoint() -> np.void:
    """The default command."""
    record = np.zeros(1, SETPOINT)[0]
    command_to_record(DEFAULT_COMMAND, record["command"])
    return record


def described(session: Simulation) -> Description:
    """What a console would describe it by."""
    own = describe_session(session)
    metadata = {**own.metadata, "name": "benchmark", "note": "", "started": "1970-01-01T00:00:00Z"}
    return replace(own, metadata=metadata, attachments=standing_attachments())


class Recorder:
    """A recorder process that listens to a session of this process."""

    def __init__(self, session: Simulation, path: Path) -> None:
        memory = tap_module.allocate()
        self.tap = Tap(memory)
        description = described(session)
        self.tap.start("benchmark")
        arguments = (memory, path, description, BodyTree.from_mjcf(), time.time_ns(), Heads(), 10**12)
        context = multiprocessing.get_context("spawn")
        self.process: BaseProcess = context.Process(target=recorder_process, args=arguments)
        self.process.start()

    def stop(self) -> None:
        """Let it finish."""
        self.tap.stop()
        self.process.join()


def drive(session: Simulation, tap: Tap, count: int, *, pace_s: float = 0.0) -> None:
    """Tick, tell the tap, publish; at a pace, or as fast as it goes."""
    asked, snapshot, row = setpoint(), np.zeros(1, SNAPSHOT)[0], TickRow()
    due = time.perf_counter()
    for tick in range(count):
        session.tick_setpoint(asked, 0.0)
        tap.put_tick(row.write(session))
        if tick % _PUBLISHED_EVERY == 0:
            session.fill(snapshot)
            tap.put_moment(snapshot)
        due += pace_s
        time.sleep(max(due - time.perf_counter(), 0.0))


def ticks(report: Report, blocks: int) -> None:
    """Processor time of a tick with recording and history, and without, in turn."""
    session = Simulation(SimulationConfig(seed=report.seed))
    tap, asked, row = Tap(tap_module.allocate()), setpoint(), TickRow()
    taken_us: dict[bool, list[float]] = {False: [], True: []}
    tap.start("benchmark")
    past = History(session)
    snapshot = np.zeros(1, SNAPSHOT)[0]
    session.tick_setpoint(asked, 0.0)
    for _ in range(TICK_SLOTS):  # once around, as after 16 s: the first time, the memory is paged in
        tap.put_tick(row.write(session))
        tap.put_moment(snapshot)
    _settle()
    for block in range(2 * blocks):
        told = bool(block % 2)
        past.clear()
        for tick in range(BLOCK):
            if tick % _ASKED_EVERY == 0:
                asked = setpoint()
            started = time.thread_time_ns()
            session.tick_setpoint(asked, 0.0)
            if tick % _PUBLISHED_EVERY == 0:
                session.fill(snapshot)
            if told:
                past.ticked(asked, 0.0)
                tap.put_tick(row.write(session))
                if tick % _PUBLISHED_EVERY == 0:
                    past.published(snapshot)
                    tap.put_moment(snapshot)
            taken_us[told].append(1e-3 * (time.thread_time_ns() - started))
    plain, told_us = (float(np.median(taken_us[told])) for told in (False, True))
    share = float(np.mean(taken_us[True]) / np.mean(taken_us[False]) - 1.0)
    report.rows += [
        _row("tick", "without", plain, "us"),
        _row("tick", "with recording and history", told_us, "us"),
        _row("tick", "more", 100.0 * share, "%"),
    ]
    report.bars.append(at_most("recording and history, share of the tick", 100.0 * share, 8.0, "%"))


def history(report: Report, seconds: float) -> None:
    """Kept moments, beside a snapshot which needs the truth of then too; and stepping back by amounts drawn at random."""
    session = Simulation(SimulationConfig(seed=report.seed))
    past, asked = History(session), setpoint()
    kept_ms, size_kb = [], float("nan")
    _settle()
    for tick in range(round(seconds / TICK_S)):
        session.tick_setpoint(asked, 0.0)
        past.ticked(asked, 0.0)
        if tick % BLOCK == 100:
            session.truth()
            started = time.perf_counter()
            moment = Moment(session)
            kept_ms.append(1e3 * (time.perf_counter() - started))
            size_kb = moment.array_bytes / 1e3
    back_s = []
    rng = np.random.default_rng(report.seed)
    end_s = past.end_s
    for time_s in sorted(rng.uniform(past.start_s, end_s, 10), reverse=True):
        started = time.perf_counter()
        past.go_back(float(time_s))
        back_s.append(time.perf_counter() - started)
    quantile, worst = float(np.quantile(kept_ms, 0.95)), max(back_s)
    report.rows += [
        _row("history", "keyframe p95", quantile, "ms"),
        _row("history", "keyframe arrays", size_kb, "kB"),
        _row("history", "step back, worst", worst, "s"),
    ]
    report.bars += [
        at_most("keyframe p95", quantile, 0.3, "ms"),
        at_most("keyframe arrays", size_kb, 150.0, "kB"),
        at_most("step back", worst, 0.3, "s"),
    ]


def recorder(report: Report, folder: Path, seconds: float) -> Path:
    """A recorder beside a session at the robot's own pace; the file."""
    session = Simulation(SimulationConfig(seed=report.seed))
    drive(session, Tap(tap_module.allocate()), BLOCK)
    path = folder / "paced.mcap"
    listening = Recorder(session, path)
    pid = listening.process.pid
    drive(session, listening.tap, 500, pace_s=TICK_S)  # while it starts
    before_s, started = _cpu_s(pid), time.perf_counter()
    drive(session, listening.tap, round(seconds / TICK_S), pace_s=TICK_S)
    share = 100.0 * (_cpu_s(pid) - before_s) / (time.perf_counter() - started)
    resident_mb = _resident_mb(pid)
    lost = listening.tap.missed
    drive(session, listening.tap, round(seconds / TICK_S), pace_s=TICK_S / 4.0)
    listening.stop()
    recording = Recording(path)
    mb_per_minute = path.stat().st_size / 1e6 / recording.duration_s * 60.0
    lost_faster = listening.tap.missed - lost
    report.rows += [
        _row("recorder", "processor", share, "% of a core"),
        _row("recorder", "memory", resident_mb, "MB"),
        _row("recorder", "file", mb_per_minute, "MB/min"),
        _row("recorder", "ticks lost", lost, "1"),
        _row("recorder", "ticks lost at 4x", lost_faster, "1"),
    ]
    report.bars += [
        at_most("recorder, processor", share, 3.0, "% of a core"),
        at_most("recorder, memory", resident_mb, 80.0, "MB"),
        at_most("file", mb_per_minute, 20.0, "MB/min"),
        at_most("ticks lost at 1x", lost, 0.0, "1"),
        at_most("ticks lost at 4x", lost_faster, 0.0, "1"),
    ]
    recording.close()
    return path


def again(report: Report, path: Path) -> None:
    """The pipeline over a recording: the bits, and how fast one estimator goes."""
    recording = Recording(path)
    result = rerun(recording)
    recorded = recording.estimates_n()
    differing = int((np.ascontiguousarray(result.estimates_n).view("u8") != np.ascontiguousarray(recorded).view("u8")).sum())
    started = time.perf_counter()
    count = sum(1 for _ in reestimate(recording, "gmo_cqp"))
    factor = count * TICK_S / (time.perf_counter() - started)
    report.rows += [
        _row("again", "differing values", differing, "1"),
        _row("again", "gmo_cqp alone", factor, "times real time"),
    ]
    report.bars += [
        at_most("pipeline again, differing values", differing, 0.0, "1"),
        at_least("one estimator again", factor, 5.0, "times real time"),
    ]
    recording.close()


def _settle() -> None:
    """As the control process does: what stands for good is looked through for garbage no more."""
    gc.collect()
    gc.freeze()


def _row(case: str, metric: str, value: float, unit: str) -> dict[str, Any]:
    return {"case": case, "metric": metric, "value": value, "unit": unit}


def _cpu_s(pid: int | None) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _resident_mb(pid: int | None) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text(encoding="utf-8").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
