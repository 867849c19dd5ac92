"""Of the benchmark of recordings: killed recorders, and what a long file costs to mend, open and look about in."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from control.timing import TICK_S
from sim.benchmarks.recording_ticks import Recorder, described, drive
from sim.benchmarks.report import Report, at_most
from sim.recording import tap as tap_module
from sim.recording.body_tree import BodyTree
from sim.recording.folder import RecordingFolder
from sim.recording.reader import Recording
from sim.recording.recorder import CHUNK_TICKS, RecordingWriter
from sim.recording.repair import repair
from sim.recording.tap import EVENT, Tap
from sim.runtime.simulation import Simulation, SimulationConfig

_REPEATED = 4000
_NO_EVENTS = np.zeros(0, EVENT)


def kills(report: Report, folder: Path, count: int) -> None:
    """SIGKILL a recorder at a moment drawn at random, and see what is left."""
    rng = np.random.default_rng(report.seed)
    session = Simulation(SimulationConfig(seed=report.seed))
    drop = RecordingFolder(folder / "kills")
    unreadable, lost_s = 0, []
    for kill in range(count):
        path = drop.new_file(f"kill-{kill:03d}")
        listening = Recorder(session, path)
        part = path.with_name(path.name + ".part")
        while not part.exists():
            time.sleep(0.01)
        drive(session, listening.tap, int(rng.integers(300, 900)), pace_s=TICK_S)
        written_s = TICK_S * listening.tap.count
        assert listening.process.pid is not None
        os.kill(listening.process.pid, signal.SIGKILL)
        listening.process.join()
        drop.repair()
        try:
            recording = Recording(path)
            lost_s.append(written_s - len(recording.sensors()) * TICK_S)
            recording.close()
        except (ValueError, OSError):
            unreadable += 1
    worst = max(lost_s, default=float("nan"))
    report.rows += [
        {"case": "kills", "metric": "unreadable", "value": unreadable, "unit": f"of {count}"},
        {"case": "kills", "metric": "lost, most", "value": worst, "unit": "s"},
    ]
    report.bars += [
        at_most("killed recorders, unreadable files", unreadable, 0.0, "1"),
        at_most("killed recorders, lost", worst, 1.0, "s"),
    ]


def files(report: Report, folder: Path, minutes: float) -> None:
    """A file of that length, without an end: mended, opened, looked about in."""
    path = folder / "long.mcap"
    write_long(report.seed, path, minutes)
    started = time.perf_counter()
    repair(path)
    repair_s = time.perf_counter() - started
    started = time.perf_counter()
    recording = Recording(path)
    open_s = time.perf_counter() - started
    rng = np.random.default_rng(report.seed)
    seeks_ms = []
    for time_s in rng.uniform(1.0, recording.duration_s, 40):
        started = time.perf_counter()
        recording.snapshot(float(time_s))
        seeks_ms.append(1e3 * (time.perf_counter() - started))
    started = time.perf_counter()
    recording.estimates_n()
    chart_s = time.perf_counter() - started
    recording.close()
    seek_ms = float(np.quantile(seeks_ms, 0.95))
    measured = (("repair", repair_s, 0.5, "s"), ("open", open_s, 0.1, "s"), ("seek p95", seek_ms, 20.0, "ms"))
    for metric, value, limit, unit in (*measured, ("chart of all", chart_s, 2.0, "s")):
        report.rows.append({"case": f"file of {minutes:g} min", "metric": metric, "value": value, "unit": unit})
        report.bars.append(at_most(f"file of {minutes:g} min, {metric}", value, limit, unit))


def write_long(seed: int, path: Path, minutes: float) -> None:
    """The same eight seconds again and again, as a recorder that was killed leaves it."""
    session = Simulation(SimulationConfig(seed=seed))
    tap = Tap(tap_module.allocate())
    description = described(session)
    tap.start("long")
    drive(session, tap, _REPEATED)
    ticks, moments = tap.ticks.take(0, _REPEATED).records, tap.moments.take(0, _REPEATED).records
    writer = RecordingWriter(path, description, BodyTree.from_mjcf(), time.time_ns())
    for first in range(0, round(60.0 * minutes / TICK_S), CHUNK_TICKS):
        start = first % (_REPEATED - CHUNK_TICKS)
        stop = start + CHUNK_TICKS
        shown = moments[(moments["tick"] > start) & (moments["tick"] <= stop)]
        shown["tick"] += np.uint64(first - start)
        writer.write(first, ticks[start:stop], shown, _NO_EVENTS)
    writer.abandon()
