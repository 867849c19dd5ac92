"""What the web process shares with its control processes, one after the other."""

from typing import Any, NamedTuple

from server import estop_lane
from sim.processes import shared_record
from sim.recording import tap
from sim.runtime.snapshot import SETPOINT, SNAPSHOT


class ControlMemories(NamedTuple):
    """Handed to a spawned process as an argument of its own.

    Attributes:
        state, setpoint: records (sim.processes.shared_record) of SNAPSHOT and SETPOINT.
        estops: see server.estop_lane.
        tap: where the control process tells a recorder of its ticks.
    """

    state: Any
    setpoint: Any
    estops: Any
    tap: Any


def allocate() -> ControlMemories:
    """Zeroed."""
    return ControlMemories(
        shared_record.allocate(SNAPSHOT), shared_record.allocate(SETPOINT), estop_lane.allocate(), tap.allocate()
    )
