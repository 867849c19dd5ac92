"""The set-point before any operator spoke."""

import numpy as np

from control.command.limits import DEFAULT_COMMAND
from sim.runtime.snapshot import SETPOINT, command_to_record


def default_setpoint() -> np.ndarray:
    """SETPOINT array (1,): the default command, sequence 0, no drag, never heard of."""
    setpoint = np.zeros(1, SETPOINT)
    command_to_record(DEFAULT_COMMAND, setpoint[0]["command"])
    return setpoint
