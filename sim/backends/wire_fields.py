"""Where the same fields of many structures lie in a message, so that one index reads or writes all of them at once.

At 500 Hz numpy's access field by field costs more than the rest of a message's way through the driver.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np


def byte_index(layout: np.dtype, array: str, names: Sequence[str], slots: Sequence[int] | np.ndarray) -> np.ndarray:
    """Index into the bytes of a message, (len(names), len(slots) * size of one field).

    `data[index].view("<f4")` then is (len(names), len(slots)) for fields of four bytes, and
    `data[index] = values.astype("<f4").view(np.uint8)` writes them.

    Args:
        layout: of the message.
        array: its field that is an array of structures.
        names: fields of such a structure, all of one size.
        slots: elements of the array, in the order wanted.
    """
    fields: Any = layout.fields
    kind, start = fields[array][:2]
    structure: Any = kind.base
    places = []
    for name in names:
        field, offset = structure.fields[name][:2]
        first = start + offset + structure.itemsize * np.asarray(slots)
        places.append((first[:, None] + np.arange(field.itemsize)).ravel())
    return np.array(places)
