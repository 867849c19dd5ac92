"""Records: named float64 numbers in one piece of memory, which kernels and Python read by the same names.

A kernel takes a one-element array of records as fast as a single array, however many fields there are, and a batch of robots
is an array of records with one element per robot.
"""

from dataclasses import fields
from typing import Any

import numpy as np


def record(**shapes: int | tuple[int, ...] | np.dtype) -> np.dtype:
    """Layout of a record: `record(height=(), position=3, jacobian=(6, 6), command=COMMAND)`.

    Args:
        shapes: of each field: () for a number, or the layout of a record within.
    """
    parts = [(name, shape) if isinstance(shape, np.dtype) else (name, "f8", shape) for name, shape in shapes.items()]
    return np.dtype((np.record, np.dtype(parts, align=True)))


def config_record(config: Any, **more: int | tuple[int, ...] | np.dtype) -> np.dtype:
    """Layout with the numbers and tuples of numbers of a dataclass, of which `config` is any instance, and `more`."""
    return record(**{field.name: np.shape(getattr(config, field.name)) for field in fields(config)}, **more)


def packed(layout: np.dtype, config: Any = None, **more: Any) -> np.ndarray:
    """One record (1,) with the values of a dataclass, if any, and those of `more`."""
    values = np.zeros(1, layout)
    if config is not None:
        more = {field.name: getattr(config, field.name) for field in fields(config)} | more
    for name in layout.names or ():
        values[name] = more[name]
    return values
