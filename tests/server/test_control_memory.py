"""The control process runs for days: what its loop allocates, natively too, it gives back."""

import ctypes
import gc
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import pytest

from control.timing import TICK_S
from server import estop_lane
from server.control_loop import ControlLoop
from server.estop_lane import EstopLane
from server.pacing import Pacer
from server.setpoint import default_setpoint
from sim.processes import shared_record
from sim.processes.shared_record import SharedRecord
from sim.runtime.simulation import Simulation
from sim.runtime.snapshot import SETPOINT, SNAPSHOT

WARM_UP_TICKS = 10_000
"""Until what the interpreter and numpy keep for reuse grows no more."""

TICKS = 4000
BYTES_PER_HOUR = 5e6
BLOCKS_PER_TICK = 0.1
"""Of Python's own allocator, whose pools malloc does not see; some tens come and go."""

_HAS_MALLINFO = hasattr(ctypes.CDLL(None), "mallinfo2")


class MallInfo(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_size_t)
        for name in ["arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"]
    ]


def allocated() -> tuple[int, int]:
    """Bytes in use by malloc, which Python's tools do not see, and blocks in use by Python."""
    gc.collect()
    mallinfo2 = ctypes.CDLL(None).mallinfo2
    mallinfo2.restype = MallInfo
    info = mallinfo2()
    return info.uordblks + info.hblkhd, sys.getallocatedblocks()


def growth() -> tuple[float, float]:
    """Bytes of malloc and blocks of Python per tick of the real loop with an operator who watches."""
    context = multiprocessing.get_context("spawn")
    state = SharedRecord(shared_record.allocate(SNAPSHOT), SNAPSHOT)
    setpoints = SharedRecord(shared_record.allocate(SETPOINT), SETPOINT)
    _, theirs = context.Pipe()
    pacer = Pacer(TICK_S, sleep=lambda _: None)
    estops = EstopLane(estop_lane.allocate())
    loop = ControlLoop(Simulation(), state, setpoints, estops, theirs, pacer, paused=False, realtime=False)
    loop._history = None  # the last minute takes a minute to fill, and no more
    setpoint = default_setpoint()

    def run(ticks: int) -> None:
        for tick in range(ticks):
            if tick % 25 == 0:
                setpoint[0]["heartbeat_s"] = time.monotonic()
                setpoints.write(setpoint)
            pacer.wait()
            loop.turn()
            pacer.finish(tick * TICK_S)

    run(WARM_UP_TICKS)
    before = allocated()
    run(TICKS)
    after = allocated()
    return (after[0] - before[0]) / TICKS, (after[1] - before[1]) / TICKS


@pytest.mark.skipif(not _HAS_MALLINFO, reason="needs glibc's account of its memory")
def test_an_idle_hour_leaves_less_than_five_megabytes() -> None:
    # In a process of its own, so that no thread of another test allocates meanwhile.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        malloc_bytes, python_blocks = pool.submit(growth).result(300.0)
    assert malloc_bytes * 3600.0 / TICK_S < BYTES_PER_HOUR
    assert python_blocks < BLOCKS_PER_TICK
