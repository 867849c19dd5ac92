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
    c = command
    # A record is written to slowly field by field.
    numbers = np.concatenate((c.mask, c.force_n, c.position_m, c.orientation_wxyz, c.base_velocity), dtype=float)
    return numbers.view(COMMAND)


def from_record(values: np.ndarray, guidance: bool) -> Command:
    """A Command of the numbers in a record (1,), copied."""
    numbers = values.view(float).copy()
    return Command(numbers[0:3], numbers[3:6], numbers[6:9], numbers[9:13], numbers[13:16], guidance)
