"""Spawns control processes. One may be spawned ahead: it imports what it needs while this one still reads what it shall run."""

import contextlib
import multiprocessing
import os
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, NamedTuple

from server.control_memories import ControlMemories, allocate
from sim.processes.starting import deaf_children

if TYPE_CHECKING:  # takes a second to import
    from server.control_process import ControlLaunch


class Spawned(NamedTuple):
    """A control process and this side's end of its pipe."""

    process: BaseProcess
    pipe: Connection


class ControlSpawner:
    """
    Attributes:
        memories: of all processes that it spawns.
    """

    def __init__(self) -> None:
        self.memories = allocate()
        self._context = multiprocessing.get_context("spawn")
        self._ahead: Spawned | None = None

    def spawn_ahead(self) -> None:
        """Spawn the process that the next launch is for."""
        self._ahead = self._spawn()

    def launch(self, launch: "ControlLaunch") -> Spawned:
        """A process that runs what the launch says, without waiting for it."""
        spawned, self._ahead = self._ahead or self._spawn(), None
        with contextlib.suppress(OSError):  # it has died, which whoever reads the pipe will notice
            spawned.pipe.send(launch)
        return spawned

    def close(self) -> None:
        """End a process that was spawned ahead and never launched."""
        if self._ahead is not None:
            self._ahead.process.kill()
            self._ahead.process.join()
            self._ahead.pipe.close()
            self._ahead = None

    def _spawn(self) -> Spawned:
        # Read by BLAS and OpenMP when the child imports numpy: their threads would fight for the loop's core.
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ[name] = "1"
        ours, theirs = self._context.Pipe()
        process = self._context.Process(target=_run, args=(self.memories, theirs), name="forcelens-control", daemon=True)
        with deaf_children():
            process.start()
        theirs.close()  # so that the child's end is the only one and its death ends the channel
        return Spawned(process, ours)


def _run(memories: ControlMemories, pipe: Connection) -> None:
    from server.control_process import control_process

    try:
        launch = pipe.recv()
    except EOFError:
        return  # the web process has ended before it had one
    control_process(launch, memories, pipe)
