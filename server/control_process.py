"""Entry point of the control process: a spawned interpreter of its own around one ControlLoop.

It asks for SCHED_FIFO, ignores the terminal's interrupts (its web process ends it), and ends when that process is gone.
"""

import gc
import logging
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

from control.timing import TICK_S
from server.control_loop import ControlLoop
from server.control_memories import ControlMemories
from server.estop_lane import EstopLane
from server.logs import LogConfig, configure
from server.messages import Fatal, Ready
from server.pacing import Pacer
from server.session_events import describe
from sim.backends.protocol import Backend, BackendError
from sim.processes.heap import return_freed_memory
from sim.processes.realtime import request_realtime
from sim.processes.resident_code import release_code
from sim.processes.shared_record import SharedRecord
from sim.processes.standard_streams import protect_standard_streams
from sim.recording.tap import Tap
from sim.runtime.session import Session
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SETPOINT, SNAPSHOT

FIFO_PRIORITY = 20

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ControlLaunch:
    """What a control process is started with; picklable.

    Attributes:
        session: how to make the simulation; a robot's session takes its pipeline.
        make_session: makes the one or the other, in the control process.
        paused: start in a hold.
        estopped: start with the e-stop latched, because it was when the process before this one died.
        log: what it logs.
    """

    session: SimulationConfig = field(default_factory=SimulationConfig)
    make_session: Callable[[SimulationConfig], Session[Backend]] = Simulation
    paused: bool = False
    estopped: bool = False
    log: LogConfig = field(default_factory=LogConfig)


def control_process(launch: ControlLaunch, memories: ControlMemories, pipe: Connection) -> None:
    """Run until closed. Errors that end it go through the pipe before it dies with them."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # or the I/O process would never hear it
    protect_standard_streams()
    return_freed_memory()
    configure(launch.log, "control process")
    try:
        session = _make_session(launch, pipe)
        if launch.estopped:
            session.estop()
        pipe.send(Ready(describe(session)))
        loop = ControlLoop(
            session,
            SharedRecord(memories.state, SNAPSHOT),
            SharedRecord(memories.setpoint, SETPOINT),
            EstopLane(memories.estops),
            pipe,
            Pacer(TICK_S),
            paused=launch.paused,
            realtime=request_realtime(FIFO_PRIORITY),
            tap=Tap(memories.tap),
        )
        gc.collect()
        gc.freeze()
        release_code()
        loop.run()
        session.backend.close()
    except Exception as error:
        pipe.send(Fatal(f"{type(error).__name__}: {error}"))
        raise


def _make_session(launch: ControlLaunch, pipe: Connection) -> Session[Backend]:
    """The session. What it is refused for, such as a name or the weights, ends the process."""
    try:
        return launch.make_session(launch.session)
    except (ValueError, BackendError) as error:
        pipe.send(Fatal(str(error)))  # the message says what to do; a traceback would hide it
        sys.exit(1)
