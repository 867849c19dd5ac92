"""What of the missed deadlines is the machine's own: bare mj_steps, paced as the loop is, that take as long as its tick."""

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from control.timing import TICK_S
from sim.benchmarks.loop_headless import bare_physics
from sim.processes.realtime import request_realtime

FIFO_PRIORITY = 20
"""Of the loop that is compared."""
CALIBRATION = 2000
"""Calls whose median tells how long one takes."""


def missed_by_physics(seconds: float, turn_s: float, realtime: bool) -> float:
    """Share of turns, %, that miss the deadline of a tick though they only compute for some `turn_s`.

    Args:
        seconds: for which they are paced, in a process of their own.
        turn_s: median duration of a turn, made of whole mj_steps.
        realtime: with SCHED_FIFO at the loop's priority.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(_missed, seconds, turn_s, realtime).result()


def _missed(seconds: float, turn_s: float, realtime: bool) -> float:
    if realtime:
        request_realtime(FIFO_PRIORITY)
    step = bare_physics("free")
    durations = np.empty(CALIBRATION)
    for call in range(CALIBRATION):
        started = time.perf_counter()
        step()
        durations[call] = time.perf_counter() - started
    steps = max(1, round(turn_s / float(np.median(durations))))
    turns = round(seconds / TICK_S)
    missed, due_s = 0, time.perf_counter()
    for _ in range(turns):
        time.sleep(max(0.0, due_s - time.perf_counter()))
        for _ in range(steps):
            step()
        due_s += TICK_S
        missed += time.perf_counter() > due_s
    return 100.0 * missed / turns
