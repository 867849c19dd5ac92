"""Set-points that ask for nothing: the one before any operator spoke, and the one after a restart."""

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from sim.runtime.snapshot import SETPOINT, command_to_record


def default_setpoint() -> np.ndarray:
    """SETPOINT array (1,): the default command, sequence 0, no drag, never heard of."""
    setpoint = np.zeros(1, SETPOINT)
    command_to_record(DEFAULT_COMMAND, setpoint[0]["command"])
    return setpoint


def released(setpoint: np.void) -> np.void:
    """A SETPOINT record with its command at the default and no drag; sequence and sign of life as they were."""
    asked = default_setpoint()[0]
    for field in ("sequence", "heartbeat_s"):
        asked[field] = setpoint[field]
    return asked
