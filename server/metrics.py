"""What Prometheus scrapes: read off the newest snapshot when it asks, so that a scrape costs the control process nothing.

Names end with their base unit; what is not available is left out. Nothing is labelled by caller.
"""

import math
import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4
from prometheus_client.registry import Collector

from control.faults import Fault
from control.frames import AXES
from server.build_info import BuildInfo
from server.clients import Clients
from server.operator import Operator
from server.pacing import TICK_BOUNDS_S
from server.readiness import unready_because
from server.state import estimator_errors
from sim.runtime.snapshot import Mode

CONTENT_TYPE = CONTENT_TYPE_PLAIN_0_0_4


def _gauge(name: str, words: str, values: Iterable[tuple[dict[str, str], Any]]) -> GaugeMetricFamily:
    """A gauge with a sample for each labelled value that is a number."""
    values = [(labels, float(value)) for labels, value in values if value is not None and math.isfinite(value)]
    family = GaugeMetricFamily(f"forcelens_{name}", words, labels=list(values[0][0]) if values else [])
    for labels, value in values:
        family.add_metric(list(labels.values()), value)
    return family


def _one(name: str, words: str, value: Any) -> GaugeMetricFamily:
    return _gauge(name, words, [({}, value)])


def _counter(name: str, words: str, value: Any) -> CounterMetricFamily:
    return CounterMetricFamily(f"forcelens_{name}", words, value=float(value))


class Metrics(Collector):
    """The metrics of one console.

    Args:
        operator: of the control process.
        clients: that are connected.
        build: that runs.
    """

    def __init__(self, operator: Operator, clients: Clients, build: BuildInfo) -> None:
        self._operator = operator
        self._clients = clients
        self._build = build
        self._registry = CollectorRegistry()
        self._registry.register(self)
        ProcessCollector(registry=self._registry)  # of the web process

    def text(self) -> bytes:
        """In Prometheus's text format."""
        return generate_latest(self._registry)

    def collect(self) -> Iterator[Metric]:
        """All families."""
        operator, client = self._operator, self._operator.client
        build = {"version": self._build.version, "commit": self._build.commit}
        yield _gauge("build_info", "Version and commit.", [(build, 1)])
        yield _one("uptime_seconds", "Of the web process.", time.monotonic() - operator.started_s)
        yield _one("ready", "1 while GET /api/v1/ready answers 200.", unready_because(client) is None)
        yield _one("control_alive", "1 while a control process runs.", client.alive)
        yield _one("lease_held", "1 while an operator holds the lease.", operator.leadership.seen()[0] is not None)
        counts = [({"kind": kind}, count) for kind, count in self._clients.counts().items()]
        yield _gauge("clients", "Open sockets: readers of the stream, browsers with the scene.", counts)
        if client.alive and client.pid is not None:
            yield from _process("control", client.pid)
        yield from self._recorder()
        record = client.snapshot()
        if record is not None:
            yield _one("snapshot_age_seconds", "Since the newest snapshot.", client.snapshot_age_s())
            yield from _loop(record)
            yield from _robot(record)

    def _recorder(self) -> Iterator[Metric]:
        recordings = self._operator.recordings
        current, pid = recordings.current, recordings.recorder_pid
        yield _one("recording", "1 while a recording is under way.", current is not None)
        yield _one("recorder_alive", "1 while a recorder process runs.", pid is not None)
        if current is not None:
            yield _one("recording_bytes", "Of the recording under way, so far.", current.size_bytes)
        yield _counter("recording_lost_ticks", "Ticks that the recorder came too late for.", recordings.lost_ticks)
        if pid is not None:
            yield from _process("recorder", pid)

    def describe(self) -> Iterator[Metric]:
        """None: what there is depends on the snapshot."""
        return iter(())


def _loop(record: np.void) -> Iterator[Metric]:
    counts = np.cumsum(record["tick_histogram"])
    buckets = [(str(bound), float(count)) for bound, count in zip((*TICK_BOUNDS_S, "+Inf"), counts, strict=True)]
    histogram = HistogramMetricFamily("forcelens_loop_tick_duration_seconds", "Work of a tick, which is due every 2 ms.")
    histogram.add_metric([], buckets, float(record["tick_total_s"]))
    yield histogram
    yield _counter("loop_missed_deadlines", "Ticks that ended after the next one was due.", record["overruns"])
    yield _counter("loop_rebases", "Times the loop dropped lost time.", record["rebases"])
    yield _counter("loop_held_seconds", "Spent on slow work that was asked for.", record["held_s"])
    yield _one("loop_rate_hertz", "Ticks per second.", record["loop_rate_hz"])
    yield _one("loop_real_time_ratio", "Simulated over wall-clock time.", record["real_time_factor"])
    yield _one("loop_lateness_p99_seconds", "99 % of the last ticks began at most this late.", 1e-3 * record["lateness_p99_ms"])
    yield _one("loop_realtime_scheduling", "1 where SCHED_FIFO was granted.", record["realtime_scheduling"])


def _robot(record: np.void) -> Iterator[Metric]:
    mode, faults = Mode(int(record["mode"])), Fault(int(record["faults"]))
    yield _gauge("mode", "1 for the present mode.", [({"mode": each.name.lower()}, each is mode) for each in Mode])
    named = [({"fault": str(fault.name)}, fault in faults) for fault in Fault]
    named.append(({"fault": "BACKEND_FAILED"}, bool(record["failure"])))
    yield _gauge("fault", "1 while a fault or a limit acts.", named)
    errors = [({"estimator": name}, error) for name, error in estimator_errors(record).items()]
    yield _gauge("estimator_error_newtons", "RMS error of the last seconds against the simulator's truth.", errors)
    forces = [
        ({"kind": kind, "axis": axis}, record[f"force_{kind}_n"][index])
        for kind in ("estimated", "true")
        for index, axis in enumerate(AXES)
    ]
    yield _gauge("hand_force_newtons", "Of the environment on the hand, heading frame.", forces)
    scales = [({"kind": kind}, record[f"mass_scale_{kind}"]) for kind in ("estimated", "true")]
    yield _gauge("mass_scale_ratio", "Mass of the robot over the model's.", scales)


def _process(name: str, pid: int) -> Iterator[Metric]:
    """Processor time and memory of a process of ours, where Linux tells."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return
    ticks = int(fields[11]) + int(fields[12])
    yield _counter(f"{name}_cpu_seconds", f"Processor time of the {name} process.", ticks / os.sysconf("SC_CLK_TCK"))
    memory = int(fields[21]) * os.sysconf("SC_PAGE_SIZE")
    yield _one(f"{name}_resident_memory_bytes", f"Memory of the {name} process.", memory)
