"""Of the benchmark of recordings: deadlines that a real console misses while it records, and while it does not."""

import time
from pathlib import Path

from control.timing import TICK_S
from sim.benchmarks.report import Report, at_most
from sim.benchmarks.server_process import ServerProcess


def deadlines(report: Report, folder: Path, blocks: int, block_s: float) -> None:
    """Blocks of time without and with a recording, in turn; the recorder's start is part of them."""
    server = ServerProcess("--data", str(folder), "--seed", str(report.seed))
    missed = {False: 0, True: 0}
    try:
        for block in range(2 * blocks):
            recording = bool(block % 2)
            before = _overruns(server)
            if recording:
                server.request("POST", "/api/v1/recordings", {"name": f"block-{block}"})
            time.sleep(block_s)
            if recording:
                server.request("DELETE", "/api/v1/recordings/current")
            missed[recording] += _overruns(server) - before
    finally:
        server.stop()
    shares = {recording: 100.0 * count * TICK_S / (blocks * block_s) for recording, count in missed.items()}
    for recording, name in ((False, "without recording"), (True, "with recording")):
        report.rows.append({"case": "console", "metric": f"missed deadlines {name}", "value": shares[recording], "unit": "%"})
    report.bars.append(at_most("missed deadlines that recording adds", shares[True] - shares[False], 0.2, "points"))


def _overruns(server: ServerProcess) -> int:
    return server.state()["loop"]["overruns"]
