"""What programs wait for beside the simulation itself: `python -m sim.benchmarks.client`.

Steps of a paused console, asked for as `server.client` does, its metrics, and the Gymnasium vector environment in turn with the
bare training world. Meaningful on an otherwise quiet machine only. It needs `pip install -e ".[gym]"`.
"""

import http.client
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from control.timing import TICK_S
from sim.benchmarks.report import Report, argument_parser, at_least, at_most
from sim.benchmarks.server_process import ServerProcess

TICKS = 500
BLOCK = 20
"""Steps of the batch from one measurement to the next."""


def _times_s(call: Callable[[], Any], count: int) -> np.ndarray:
    """(count,) s."""
    times = []
    for _ in range(count):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return np.array(times)


def console(report: Report, steps: int, scrapes: int) -> None:
    """`step` and `/metrics` of a console that stands."""
    server = ServerProcess("--seed", str(report.seed))
    try:
        server.request("POST", "/api/v1/run", {"state": "paused"})

        def step() -> None:
            server.request("POST", "/api/v1/step", {"ticks": TICKS})
            server.request("GET", "/api/v1/state")

        step()
        over_ms = 1e3 * (_times_s(step, steps) - TICKS * TICK_S)
        connection = http.client.HTTPConnection("127.0.0.1", server.port)

        def scrape() -> None:
            connection.request("GET", "/metrics")
            connection.getresponse().read()

        metrics_ms = 1e3 * _times_s(scrape, scrapes)
        connection.close()
    finally:
        server.stop()
    for metric, times in ((f"step({TICKS}) over its ticks", over_ms), ("/metrics", metrics_ms)):
        report.rows.append({"metric": metric, "p50": float(np.median(times)), "max": float(times.max()), "unit": "ms"})
    report.bars.append(at_most(f"step({TICKS}) over its ticks, worst", float(over_ms.max()), 10.0, "ms"))
    report.bars.append(at_most("/metrics, median", float(np.median(metrics_ms)), 5.0, "ms"))


def vector_env(report: Report, count: int, blocks: int) -> None:
    """Steps per second of the vector environment over those of the bare training world, the same robots in turn."""
    envs = gymnasium.make_vec("sim.gym:Forcelens/Press-v0", count)
    envs.reset(seed=report.seed)
    bare: Any = envs.unwrapped
    actions = np.random.default_rng(report.seed).uniform(-0.3, 0.3, envs.action_space.shape).astype(np.float32)
    calls = {"bare training world": lambda: bare.training.step(actions), "VectorEnv": lambda: envs.step(actions)}
    times_s: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(blocks):
        for name, call in calls.items():
            times_s[name].append(float(_times_s(call, BLOCK).sum()))
    for name, taken in times_s.items():
        report.rows.append({"metric": name, "p50": count * BLOCK / float(np.median(taken)), "max": None, "unit": "steps/s"})
    share = float(np.median(times_s["bare training world"]) / np.median(times_s["VectorEnv"]))
    report.bars.append(at_least("VectorEnv, share of the bare training world", share, 0.9, "1"))


def main() -> None:
    """Run the benchmark."""
    arguments = argument_parser(__doc__ or "").parse_args()
    report = Report("client", arguments.seed)
    console(report, *((2, 20) if arguments.quick else (12, 300)))
    report.progress("vector environment")
    vector_env(report, *((16, 2) if arguments.quick else (256, 8)))
    report.finish(arguments.json)


if __name__ == "__main__":
    main()
