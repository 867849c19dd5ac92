"""The command as a record, for kernels and for batches of robots."""

import numpy as np

from control.kernels.records import record
from control.types import Command

COMMAND = record(mask=3, force_n=3, position_m=3, orientation_wxyz=4, base_velocity=3)
"""The arrays of a Command, by the same names."""


def commands(count: int) -> np.ndarray:
    """Records (count,) that ask for nothing: zeros, and no rotation."""
    records = np.zeros(count, COMMAND)
    records["orientation_wxyz"][:, 0] = 1.0
    return records


def to_record(command: Command) -> np.ndarray:
    """The command's arrays as one record (1,)."""
    values = np.zeros(1, COMMAND)
    for name in COMMAND.names or ():
        values[name] = getattr(command, name)
    return values


def from_record(values: np.ndarray, guidance: bool) -> Command:
    """The Command whose arrays are those of the record (1,), without a copy."""
    return Command(
        mask=values["mask"][0],
        force_n=values["force_n"][0],
        position_m=values["position_m"][0],
        orientation_wxyz=values["orientation_wxyz"][0],
        base_velocity=values["base_velocity"][0],
        guidance=guidance,
    )
